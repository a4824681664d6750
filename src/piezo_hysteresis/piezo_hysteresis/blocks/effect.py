"""What discovery knows about a missing effect besides the block that models it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from piezo_hysteresis.blocks.base import Block


@dataclass(frozen=True)
class Effect:
    """One way in which an effect can enter a model.

    Several effects may share a name (variants): ``hysteresis`` of the input or of the restoring
    force, ``creep`` of one element or logarithmic.

    Attributes
    ----------
    name : str
        The word that the verdict uses, ``creep``.
    variant : str
        Tells the ways of one effect apart; the name of the block, as a rule.
    block : Block or None
        What is added to the chain; None where parameters are freed only.
    replaces : tuple of str
        Names of the blocks one of which `block` takes the place of; empty where it is added.
    first : bool
        Added before the other blocks of its slot instead of behind them.
    absorbs : tuple of str
        Blocks that leave the chain with the replaced one.
    frees : tuple of str
        Parameters that the model held and that are now free.
    holds : mapping of str to float
        Parameters of the block that stay at these values while the effect is fitted.
    neutral : mapping of str to float
        Values with which the effect changes nothing.
    start : mapping of str to float
        Where a fit starts, for an input amplitude of 1 V and a displacement amplitude of 130 um;
        `piezo_hysteresis.models.add_effect` rescales it to the data.
    alternatives : tuple of mapping
        Further starts, each completing `start`, for parameters that decide the basin a fit ends
        in (frequencies, signs).
    physics : str
        What happens in the actuator, one or two sentences.
    mistaken_for : tuple of str
        Names of the effects that leave a similar residual.
    experiment : str
        What settles it.
    """

    name: str
    variant: str
    block: Block | None
    neutral: Mapping[str, float]
    physics: str
    experiment: str
    mistaken_for: tuple[str, ...] = ()
    replaces: tuple[str, ...] = ()
    first: bool = False
    absorbs: tuple[str, ...] = ()
    frees: tuple[str, ...] = ()
    holds: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    alternatives: tuple[Mapping[str, float], ...] = ()
