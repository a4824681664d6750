"""What discovery knows about a missing effect besides the block that models it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import NamedTuple

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block


class Residual(NamedTuple):
    """What a start guess may look at: one record and what the model without the effect says.

    Attributes
    ----------
    voltage, simulated, residual : ndarray, shape (n,)
        Input [V], free run of the model [m], measured minus simulated [m].
    dt : float
        Sampling interval [s].
    frequency : float
        Fundamental frequency of the excitation [Hz]; 0 where there is none.
    start : float
        Time of the first sample [s].
    values : mapping of str to float
        Parameters of the model without the effect.
    """

    voltage: FloatArray
    simulated: FloatArray
    residual: FloatArray
    dt: float
    frequency: float = 0.0
    start: float = 0.0
    values: Mapping[str, float] = MappingProxyType({})


Guess = Callable[[Residual], Mapping[str, float] | Sequence[Mapping[str, float]]]
Convert = Callable[[Mapping[str, float]], Mapping[str, float]]


# A gain that differs by less over the band below does not tell a lag from a delay [Hz].
HIGH_FREQUENCY = 100.0
# So many sines tell what follows the rate.
FEWEST_FREQUENCIES = 5


class Coverage(Enum):
    """What records must hold for some effects to be distinguished, and how to record it."""

    FAST = f'add a chirp above {HIGH_FREQUENCY:g} Hz: there a lag loses gain, a delay not'
    WIDE = f'sweep {FEWEST_FREQUENCIES} frequencies or more, from 1 Hz to the highest in use'
    LADDER = 'record the same frequencies at half the amplitude'
    REST = 'record half a minute at 0 V'
    STEP = 'record a step and hold it for 30 s'
    REVERSALS = 'record first-order reversal curves (small loops inside the large one)'


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
    neutral : mapping of str to float
        Values with which the effect changes nothing.
    physics : str
        What happens in the actuator, one or two sentences.
    experiment : str
        What settles it.
    mistaken_for : tuple of str
        Names of the effects that leave a similar residual.
    shown_by : tuple of Coverage
        What records must hold for it to be distinguished from others that need the same.
    where : str
        Of what it is, where variants are of different things: ``of the input``.
    replaces : tuple of str
        Names of the blocks one of which `block` takes the place of; empty where it is added.
    absorbs : tuple of str
        Blocks that the model must have and that leave the chain with the replaced one.
    requires : tuple of str
        Blocks one of which the model must have; empty where any model will do.
    first : bool
        Added before the other blocks of its slot instead of behind them.
    frees : tuple of str
        Parameters that the model must hold and that become free.
    holds : mapping of str to float
        Parameters of the block that are not fitted.
    zeros : tuple of str
        Parameters of the block that only say where its zero lies: nuisances, no evidence.
    held : bool
        Whether it is for baselines whose values stay: where they are fitted besides, offset and
        gain take up where it has its zero, and another way of the effect does the same with less.
    refines : mapping of str to str
        Parameters of the block to those of the variant that it has as a special case, where there
        is one: a model that has it does not take up that one besides.
    refits : bool
        Whether it has no parameters of its own, but changes those that the model has.
    inexactness : float
        Share of the effect that its law is known not to describe [1]. What is left of an actuator
        after it is that large at least, so nothing smaller is given a name.
    repeatable : bool
        Whether a model may have it several times (modes, tones, creep elements).
    start : mapping of str to float
        Where a fit starts, for an input amplitude of 1 V and a displacement amplitude of 130 um.
    alternatives : tuple of mapping
        Further starts, each completing `start`, where several basins are to be tried (signs,
        frequencies).
    guess : callable or None
        ``guess(residual)`` returns better start values for some of the parameters, or several
        such mappings where several basins are to be tried.
    convert : callable or None
        ``convert(values)`` translates the values of the replaced blocks for `block`, and those of
        other blocks that change with them; the result with `neutral` reproduces the model.
    """

    name: str
    variant: str
    block: Block | None
    neutral: Mapping[str, float]
    physics: str
    experiment: str
    mistaken_for: tuple[str, ...] = ()
    shown_by: tuple[Coverage, ...] = ()
    where: str = ''
    replaces: tuple[str, ...] = ()
    absorbs: tuple[str, ...] = ()
    requires: tuple[str, ...] = ()
    first: bool = False
    frees: tuple[str, ...] = ()
    holds: Mapping[str, float] = field(default_factory=dict)
    zeros: tuple[str, ...] = ()
    held: bool = False
    refines: Mapping[str, str] = field(default_factory=dict)
    refits: bool = False
    inexactness: float = 0.02
    repeatable: bool = False
    start: Mapping[str, float] = field(default_factory=dict)
    alternatives: tuple[Mapping[str, float], ...] = ()
    guess: Guess | None = None
    convert: Convert | None = None
