"""Selection of the inverse and the plant gain of a model, also by drive frequency."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, TypedDict, cast

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import BLOCKS
from piezo_hysteresis.blocks.base import InterSample, InverseRole, Slot
from piezo_hysteresis.blocks.gain import BLOCK as STRAIGHT
from piezo_hysteresis.common.wording import choices
from piezo_hysteresis.compensation.drive_selection import DriveSelector
from piezo_hysteresis.compensation.inverses.block_inverse import OscillatorInverse
from piezo_hysteresis.compensation.inverses.chain_inverse import ChainInverse
from piezo_hysteresis.compensation.inverses.inverse_link import HISTORY, InverseLink
from piezo_hysteresis.compensation.inverses.physical import (
    ExtendedInverse,
    Law,
    PhysicalInverse,
    SlopeSelectedInverse,
    structure_coefficients,
)
from piezo_hysteresis.compensation.linear_gain import ModeGain, PulseGain
from piezo_hysteresis.compensation.link import (
    INVERSES,
    Limits,
    Measured,
    ReferencePoint,
    Transition,
)
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.chain import Model
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.models.schedule import OperatingPoint

# Hysteresis blocks that `PhysicalInverse` solves in closed form.
_LAWS: dict[InverseRole | None, Law] = {
    InverseRole.EXACT: 'exact',
    InverseRole.EULER: 'euler',
    InverseRole.PLAYS: 'plays',
    InverseRole.GAIN: 'gain',
}
_EXTENDED = (InverseRole.EULER, InverseRole.RECURSION)
# Chains with an inverse of their own.
_ALONE: dict[tuple[InverseRole | None, ...], str] = {
    _EXTENDED: 'solved',
    (InverseRole.OSCILLATOR,): 'oscillator',
    (InverseRole.SELECTOR,): 'selector',
}
# Laws of papers by the names of their inverses; Fang 2019 (feedforward) is one of them.
_OWN = {
    'fujii2018': 'solved', 'tatebatake2017': 'printed', 'zhou2021': 'delayed',
    'fang2019': 'exact', 'xiao2014': 'selector',
}  # fmt: skip
# Length of the response that gives the gain of a model [s]: several time constants of the mode.
_PULSE = 3.0


class _Anatomy(NamedTuple):
    """Structure of a chain for the choice of an inverse in closed form."""

    core: tuple[
        InverseRole | None, ...
    ]  # roles of its blocks without added tones, delays and zero
    delayed: bool
    simple: bool  # whether its zero, if it has one, is one constant at the end


def _anatomy(model: Model) -> _Anatomy:
    blocks = [block for block in model.blocks if block.slot is not Slot.ADDED]
    delays = [block for block in blocks if block.between is InterSample.DELAY]
    zeros = [place for place, block in enumerate(blocks) if block.role is InverseRole.ZERO]
    core = tuple(b.role for b in blocks if b.role is not InverseRole.ZERO and b not in delays)
    return _Anatomy(core, bool(delays), zeros in ([], [len(blocks) - 1]))


def inverse_for(
    model: Model,
    values: Mapping[str, float],
    dt: float,
    *,
    limits: Limits | None = None,
    start: float = 0.5,
    transition: float = 0.2,
    scale: float = 1.0,
    law: str = 'auto',
) -> InverseLink:
    """Return the inverse of `model` by a law, by default the most accurate one for the model.

    The extended model has Fujii 2018 (16), (17); one hysteresis with or without a mode the
    physical inverse; an oscillator and the law of Xiao 2014 their own; every other chain the
    numerical one. Added tones are ignored.

    Parameters
    ----------
    model : Model
        The chain.
    values : mapping of str to float
        Its parameters, SI units; missing ones take their default.
    dt : float
        Sampling interval [s].
    limits, start, transition
        As in `InverseLink`.
    scale : float
        Typical voltage [V], for the numerical inverse.
    law : str
        One of `INVERSES`. ``fujii2018`` is Fujii 2018 (16), (17), ``tatebatake2017`` Tatebatake
        2017 (12) as printed, both for the extended model; ``zhou2021`` Zhou 2021 (8), with h of
        the previous sample, for one Bouc-Wen block with or without a structure; ``xiao2014`` the
        selector of Xiao 2014; ``fang2019`` the modified or the classical model of Fang 2019,
        solved exactly, because the equation of its feedforward is missing from the text.

    Raises
    ------
    CompensationError
        If the model has no inverse, or not by that law.
    """
    if law not in INVERSES:
        raise CompensationError(f'there is no inverse {law!r}{choices(law, INVERSES)}')
    named = model.unpack(model.pack(values))
    own = _best(model) if law == 'auto' else _own_law(model, law)
    options: _Options = {'limits': limits, 'start': start, 'transition': transition}
    if own == 'numeric':
        return ChainInverse(model, named, dt, scale=scale, **options)
    if own == 'oscillator':
        return OscillatorInverse(named, dt, **options)
    if own == 'selector':
        return SlopeSelectedInverse(named, dt, **options)
    if own in ('solved', 'printed'):
        return ExtendedInverse(named, dt, law=own, **options)
    if law == 'gain':
        mean = float(named.get('offset', 0.0)) + _mean_by_asymmetry(model, named, scale, dt)
        named = {'A1': model_gain(model, values, dt, scale)(0.0).real, 'offset': mean}
    return PhysicalInverse(named, dt, law=cast('Law', own), **options)


def _best(model: Model) -> str:
    """Return the own name of the most accurate law for a model."""
    core, delayed, simple = _anatomy(model)
    if simple and not delayed and core in _ALONE:
        return _ALONE[core]
    structured = len(core) == 1 or core[1:] == (InverseRole.STRUCTURE,)
    if simple and structured and core[0] in _LAWS:
        return _LAWS[core[0]]
    if InverseRole.OSCILLATOR in core:
        raise CompensationError(
            f'model {model.name} has an oscillator with further blocks, which has no inverse '
            'here; use a model whose hysteresis stands before the structure'
        )
    return 'numeric'


class _Options(TypedDict):
    """Arguments common to all inverses."""

    limits: Limits | None
    start: float
    transition: float


# Blocks of the chain, without delay, offset and structure, to which a law applies.
_FOR: dict[str, tuple[tuple[InverseRole, ...], ...]] = {
    'fujii2018': (_EXTENDED,),
    'tatebatake2017': (_EXTENDED,),
    'zhou2021': ((InverseRole.EXACT,), (InverseRole.EULER,)),
    'exact': ((InverseRole.EXACT,), (InverseRole.EULER,)),
    'xiao2014': ((InverseRole.SELECTOR,),),
    'fang2019': ((InverseRole.MODIFIED,), (InverseRole.EXACT,), (InverseRole.EULER,)),
}


def _called(part: InverseRole) -> str:
    """Return the names of the blocks with a given role."""
    return ' or '.join(block.name for block in BLOCKS.values() if block.role is part)


def _own_law(model: Model, law: str) -> str:
    """Return the own name of a law, also of Fang 2019 (feedforward); refuse another model."""
    core = tuple(part for part in _anatomy(model).core if part is not InverseRole.STRUCTURE)
    if law in _FOR and core not in _FOR[law]:
        blocks = [block.name for block in model.blocks if block.slot is not Slot.ADDED]
        needed = ' or '.join(' and '.join(map(_called, each)) for each in _FOR[law])
        raise CompensationError(
            f'the law {law} inverts {needed}, but model {model.name} is {" -> ".join(blocks)}; '
            'take another law or identify that model'
        )
    if law == 'fang2019' and core == (InverseRole.MODIFIED,):
        return 'numeric'
    return _OWN.get(law, law)


def _mean_by_asymmetry(
    model: Model, values: Mapping[str, float], amplitude: float, dt: float
) -> float:
    """Return by how much A0 shifts the mean of a loop [m]; 0 of a model without it.

    The RLS of Fujii 2018 balances a mean of up to 400 µm by A0 with an offset of the other sign:
    only their sum is a displacement.
    """
    if values.get('A0', 0.0) == 0.0:
        return 0.0
    # h takes a way of some 1 / beta to settle
    way = 8.0 / max(values.get('beta', 0.0), 1e-3)
    cycles = min(max(math.ceil(way / (4.0 * amplitude)), 20), 5000)
    phase = 2.0 * np.pi * np.arange(200 * cycles) / 200.0
    drive, frequency = np.asarray(amplitude * np.sin(phase), np.float64), 1.0 / (200.0 * dt)
    means = [
        float(model.respond(drive, model.pack(each), dt, frequency=frequency)[-1000:].mean())
        for each in (values, {**values, 'A0': 0.0})
    ]
    return means[0] - means[1]


def model_gain(
    model: Model, values: Mapping[str, float], dt: float, amplitude: float = 1.0
) -> PulseGain:
    """Return the complex gain [m/V] of a model for a small tone on top of a large drive.

    The hysteresis contributes its mean local slope along a full loop, the rest of the chain its
    response to a small pulse. Added tones, friction, drift and offset are ignored.

    Parameters
    ----------
    model : Model
        The chain.
    values : mapping of str to float
        Its parameters, SI units.
    dt : float
        Sampling interval [s].
    amplitude : float
        Amplitude of the drive [V].
    """
    pulse = np.zeros(round(_PULSE / dt))
    pulse[0] = 1e-3 * amplitude
    small, packed = _for_small_tones(model, model.pack(values), amplitude, dt)
    response = small.respond(pulse, packed, dt)
    rest = small.respond(np.zeros_like(pulse), packed, dt)
    return PulseGain((response - rest) / pulse[0], dt)


def _for_small_tones(
    model: Model, packed: FloatArray, amplitude: float, dt: float
) -> tuple[Model, FloatArray]:
    """Return the chain with its hysteresis as a gain and without friction and tones."""
    blocks, values = [], []
    first = 0
    for block in model.blocks:
        own = packed[first : first + len(block.parameters)]
        first += len(block.parameters)
        if block.slot is Slot.HYSTERESIS:
            slope = _mean_slope(Model(block.name, (block,)), own, amplitude, dt)
            block, own = STRAIGHT, np.array([slope])
        elif block.slot is Slot.ADDED or block.between is InterSample.PATH:
            continue
        blocks.append(block)
        values.append(own)
    return Model(model.name, tuple(blocks)), np.concatenate(values)


def _mean_slope(model: Model, packed: FloatArray, amplitude: float, dt: float) -> float:
    """Return the response of a hysteresis to a small third harmonic on a large drive."""
    phase = 2.0 * np.pi * np.arange(4000) / 1000.0
    drive, probe = amplitude * np.sin(phase), 0.01 * amplitude * np.sin(3.0 * phase + 0.7)
    frequency = 1.0 / (1000.0 * dt)
    with_probe = model.respond(drive + probe, packed, dt, frequency=frequency)
    against_probe = model.respond(drive - probe, packed, dt, frequency=frequency)
    difference = 0.5 * (with_probe - against_probe)[2000:]
    small = probe[2000:]
    return float(difference @ small / (small @ small))


def mode_of(values: Mapping[str, float], gain: float, dt: float) -> ModeGain:
    """Return the model of a node without a model file: a gain, a mode and a delay.

    Parameters
    ----------
    values : mapping of str to float
        Parameters of the model, SI units.
    gain : float
        Its quasi-static gain [m/V].
    dt : float
        Sampling interval [s].
    """
    delay = values.get('delay', 0.0)
    k1, k2 = structure_coefficients(values)
    if k2 == 0.0:
        return ModeGain(gain, 0.0, 1.0, dt, delay)
    frequency = 1.0 / (2.0 * math.pi * math.sqrt(k2))
    return ModeGain(gain, frequency, 0.5 * k1 / math.sqrt(k2), dt, delay)


class ScheduledInverse:
    """The inverse of the entry of a schedule that is nearest to the drive, see `DriveSelector`.

    Before the first frequency it is that of all drives. The voltage moves over without a step,
    within the slew limit.
    """

    def __init__(
        self,
        model: ModelFile,
        invert: Callable[[ModelFile], InverseLink],
        dt: float,  # [s]
        limits: Limits,
        transition: float,  # [s]
    ) -> None:
        assert model.schedule is not None
        self.dt, self._invert = dt, invert
        self._of_all = invert(model)
        self._inverses = {p.name: invert(p.model) for p in model.schedule.points}
        self._inverse = self._of_all
        self._fade = Transition(dt, transition, limits.slew)
        self._past: deque[ReferencePoint] = deque(maxlen=HISTORY)
        self._selector = DriveSelector(model.schedule, dt)
        self.reset()

    @property
    def point(self) -> OperatingPoint | None:
        """The entry in use, None before the first frequency."""
        return self._selector.point

    def step(
        self, point: ReferencePoint, received: float = 0.0, measured: Measured | None = None
    ) -> float:
        """Return the voltage for this tick: `received` plus that of the inverse [V]."""
        before = self.point
        chosen = self._selector.select(point)
        if chosen is not None and chosen is not before:
            self._change_to(chosen)
        self._past.append(point)
        return received + self._fade.apply(self._inverse.step(point, 0.0, measured))

    def update(self, model: ModelFile) -> None:
        """Take changed entries, and new ones; the voltage changes smoothly."""
        assert model.schedule is not None
        fresh = {p.name: self._invert(p.model) for p in model.schedule.points}
        of_all = self._invert(model)
        for name, link in fresh.items():
            known = self._inverses.get(name)
            if type(known) is type(link) and known.parameters.keys() == link.parameters.keys():
                if known.parameters != link.parameters:
                    known.set_parameters(link.parameters)
                fresh[name] = known
        in_use = self._inverse
        self._inverses, self._of_all = fresh, of_all
        self._selector.replace(model.schedule)
        self._inverse = of_all if self.point is None else fresh[self.point.name]
        if self._inverse is not in_use and self._past:
            self._inverse.follow(self._past)
            self._fade.start()

    def follow(self, past: Iterable[ReferencePoint]) -> None:
        """Take the memory that the last points of a running reference leave."""
        self.reset()
        for point in past:
            self._selector.select(point)
            self._past.append(point)
        if self.point is not None:
            self._inverse = self._inverses[self.point.name]
        self._inverse.follow(self._past)

    def counters(self) -> dict[str, int]:
        """Return the error counters by name, and the changes of the inverse."""
        total: dict[str, int] = {}
        for each in (self._of_all, *self._inverses.values()):
            for name, count in each.counters().items():
                total[name] = total.get(name, 0) + count
        return {**total, 'schedule_changes': self._changes}

    def reset(self) -> None:
        """Reset the memory; the schedule stays."""
        for each in (self._of_all, *self._inverses.values()):
            each.reset()
        self._fade.reset()
        self._past.clear()
        self._inverse, self._changes = self._of_all, 0
        self._selector.reset()

    def _change_to(self, chosen: OperatingPoint) -> None:
        """Take the inverse of an entry over, with the history of the reference."""
        self._inverse = self._inverses[chosen.name]
        if not self._past:
            return
        self._changes += 1
        self._inverse.follow(self._past)
        self._fade.start()
