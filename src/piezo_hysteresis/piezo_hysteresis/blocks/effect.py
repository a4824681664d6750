"""Definition of an effect: a block, and how discovery adds it to a model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import NamedTuple

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, InverseRole, Slot


class Residual(NamedTuple):
    """Input of a start guess: one record and the response of the model without the effect.

    Attributes
    ----------
    voltage, simulated, residual : ndarray, shape (n,)
        Input [V], free run of the model before its offset [m], measured minus simulated [m].
    dt : float
        Sampling interval [s].
    frequency : float
        Fundamental frequency of the excitation [Hz]; 0 if there is none.
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


# Frequency [Hz] below which the gain does not distinguish a lag from a delay.
HIGH_FREQUENCY = 100.0
# Number of sines that determine a dependence on the rate.
FEWEST_FREQUENCIES = 5


class Coverage(Enum):
    """Content of records that is required to distinguish effects, and how to record it."""

    FAST = f'add a chirp above {HIGH_FREQUENCY:g} Hz: there a lag loses gain, a delay not'
    WIDE = f'sweep {FEWEST_FREQUENCIES} frequencies or more, from 1 Hz to the highest in use'
    LADDER = 'record the same frequencies at half the amplitude'
    REST = 'record half a minute at 0 V'
    STEP = 'record a step and hold it for 30 s'
    REVERSALS = 'record first-order reversal curves (small loops inside the large one)'


@dataclass(frozen=True)
class Effect:
    """One variant of an effect: how it can enter a model.

    Several effects may share a name (variants): ``hysteresis`` of the input or of the restoring
    force, ``creep`` of one element or logarithmic.

    Attributes
    ----------
    name : str
        Name in verdicts, such as ``creep``.
    block : Block or None
        Block added to the chain; None if held parameters of the model become free, those of
        `starts`.
    neutral : mapping of str to float
        Values without an effect; empty if it refits the parameters of the model.
    physics : str
        What happens in the actuator, one or two sentences.
    experiment : str
        The experiment that distinguishes it.
    mistaken_for : tuple of str
        Names of the effects that leave a similar residual.
    required_coverage : tuple of Coverage
        Coverage of the records that its identification requires.
    starts : tuple of mapping
        Start values of a fit for an input amplitude of 1 V and a displacement amplitude of 130 µm.
        Each further one completes the first, for several local optima (signs, frequencies).
    holds : mapping of str to float
        Parameters of the block that are not fitted.
    variant : str
        Distinguishes the variants of one effect; by default the name of the block.
    zeros : tuple of str
        Parameters of the block for the displacement about which it acts. It is only offered for
        fixed baselines: if the baseline is fitted, its offset and gain absorb them. Those of a
        static block are nuisance parameters.
    replaces : tuple of str
        Names of blocks: `block` takes the place of the first, the others are removed; empty if it
        is added, as `first` states.
    requires : tuple of str
        Blocks of which the model must have one; empty for any model.
    repeatable : bool
        Whether a model may have it several times (modes, tones, creep elements).
    refines : str
        The variant that is its special case, if there is one: a model with the block is not
        extended by that variant.
    inexactness : float
        Relative error of the law of the effect [1]. The residual after the effect is at least this
        large, so that a smaller one is not named.
    guess : callable or None
        ``guess(residual)`` returns better start values of some parameters, or several such
        mappings for several local optima.
    convert : callable or None
        ``convert(values)`` converts the values of the replaced blocks for `block`, and dependent
        values of other blocks; the result with `neutral` reproduces the model.
    absent : callable or None
        ``absent(values)`` returns whether fitted values, of `block` and by name of the rest of the
        chain, describe another change than this effect, such as a mode that does not ring.
    """

    name: str
    block: Block | None
    neutral: Mapping[str, float]
    physics: str
    experiment: str
    mistaken_for: tuple[str, ...] = ()
    required_coverage: tuple[Coverage, ...] = ()
    starts: tuple[Mapping[str, float], ...] = ({},)
    holds: Mapping[str, float] = field(default_factory=dict)
    variant: str = ''
    zeros: tuple[str, ...] = ()
    replaces: tuple[str, ...] = ()
    requires: tuple[str, ...] = ()
    repeatable: bool = False
    refines: str = ''
    inexactness: float = 0.02
    guess: Guess | None = None
    convert: Convert | None = None
    absent: Callable[[Mapping[str, float]], bool] | None = None

    def __post_init__(self) -> None:
        if not self.variant:
            object.__setattr__(self, 'variant', (self.block or self).name)

    @property
    def refits(self) -> bool:
        """Whether it has no own parameters but refits those of the model."""
        return not self.neutral

    @property
    def frees(self) -> tuple[str, ...]:
        """Held parameters of the model that become free."""
        return tuple(self.starts[0]) if self.block is None else ()

    @property
    def first(self) -> bool:
        """Whether it is added before the other blocks of its slot instead of after them.

        A sensor errs before its offset is added, and friction acts on the drive of a mode.
        """
        if self.block is None or self.block.role is InverseRole.ZERO:
            return False
        slot, between = self.block.slot, self.block.between
        return slot is Slot.SENSOR or (slot is Slot.STRUCTURE and between is InterSample.PATH)
