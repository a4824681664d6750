"""Effects of a model, and start values by dimensional analysis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.blocks import EFFECTS, Effect, Slot
from piezo_hysteresis.blocks.base import Block, Parameter
from piezo_hysteresis.blocks.effect import Residual
from piezo_hysteresis.blocks.parameter_shift import PARAMETER_SHIFT
from piezo_hysteresis.common.wording import choices
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models.chain import Model

REFERENCE_INPUT = 1.0
REFERENCE_DISPLACEMENT = 130e-6


def powers(unit: str) -> tuple[int, int]:
    """Return the powers of volt and metre in `unit`; (0, 0) for mechanical units.

    Units are written ``a*b/c*d`` with powers as ``m^2``: ``m/V``, ``1/m^2``, ``V/s``.
    """
    volt = metre = 0
    for sign, part in zip((1, -1), unit.split('/'), strict=False):
        for factor in part.split('*'):
            symbol, _, power = factor.partition('^')
            if symbol in ('N', 'kg'):
                return 0, 0
            volt += sign * int(power or 1) * (symbol == 'V')
            metre += sign * int(power or 1) * (symbol == 'm')
    return volt, metre


def factor(parameter: Parameter, ratios: tuple[float, float]) -> float:
    """Return the factor of `parameter` for the input and displacement `ratios`."""
    volt, metre = parameter.powers or powers(parameter.unit)
    return float(ratios[0] ** volt * ratios[1] ** metre)


def suited(block: Block, ratios: tuple[float, float]) -> Block:
    """Return `block` with defaults and scales for amplitudes `ratios` times the reference.

    The result is fixed for these amplitudes: scaling it again has no effect.
    """
    parameters = []
    for q in block.parameters:
        ratio = factor(q, ratios)
        default = float(np.clip(q.default * ratio, q.low, q.high))
        parameters.append(replace(q, default=default, scale=q.scale * ratio, powers=(0, 0)))
    return replace(block, parameters=tuple(parameters))


def for_range(
    model: Model,
    input_amplitude: float,
    displacement_amplitude: float,
    input_swing: float | None = None,
) -> Model:
    """Return `model` with defaults, scales and held ranges for an actuator.

    Parameters
    ----------
    model : Model
        Any model.
    input_amplitude : float
        Largest absolute input [V or N] of the model.
    displacement_amplitude : float
        Half the span of the displacement [m].
    input_swing : float, optional
        Half the span of the input [V or N], if it is not symmetric: thresholds beyond it are never
        reached. Default: the largest input.

    Returns
    -------
    Model
        Same blocks; ``defaults()`` are start values, ``parameters[i].scale`` typical sizes. Blocks
        that were scaled before, and ranges held at other values than their default, are not
        changed.

    Raises
    ------
    ModelError
        If an amplitude is not positive.
    """
    for what, amplitude in (('input', input_amplitude), ('displacement', displacement_amplitude)):
        if not (np.isfinite(amplitude) and amplitude > 0):
            raise ModelError(
                f'the {what} amplitude is {amplitude:g}; give a record in which the {what} moves'
            )
    ratios = (input_amplitude / REFERENCE_INPUT, displacement_amplitude / REFERENCE_DISPLACEMENT)
    swing = ((input_swing or input_amplitude) / REFERENCE_INPUT, ratios[1])
    own = [q for block in model.blocks for q in block.parameters]
    held = {
        name: model.held[name] * (factor(q, swing) if _grows(q, model.held[name]) else 1.0)
        for q, name in zip(own, model.parameter_names, strict=True)
        if name in model.held
    }
    return Model(model.name, tuple(suited(block, ratios) for block in model.blocks), held)


def _grows(parameter: Parameter, held: float) -> bool:
    """Return whether a held value is the default range, and not a value set by the user."""
    return parameter.follows_range and held == parameter.default


EFFECT_NAMES: tuple[str, ...] = tuple(sorted({effect.name for effect in EFFECTS}))


# From this value on, a neutral value is a threshold that is never reached.
_NEVER = 1e3

# Factors to the frequencies of a model, from which a changed one is sought: an octave both ways in
# steps of three per cent, the width of a mode with a damping of 0.015.
_SCAN = tuple(2.0 ** (k / 24.0) for k in range(-24, 25) if k)


def is_never_reached(neutral: float) -> bool:
    """Return whether a neutral value is a threshold: larger values have no effect."""
    return abs(neutral) >= _NEVER


@dataclass(frozen=True)
class Candidate:
    """A model with one effect added.

    Attributes
    ----------
    effect : Effect
        The added effect.
    model : Model
        The chain with it.
    added : tuple of str
        Names of the free parameters of `model` that are new, or were held.
    neutral : mapping of str to float
        Values, under the names of `model`, that do not change the output.
    starts : tuple of mapping
        Starting values of `added`, the most likely first.
    renamed : mapping of str to str
        Names in `model` of the parameters of the block.
    """

    effect: Effect
    model: Model
    added: tuple[str, ...]
    neutral: Mapping[str, float]
    starts: tuple[Mapping[str, float], ...]
    renamed: Mapping[str, str]

    def values(
        self, before: Mapping[str, float], start: Mapping[str, float] | None = None
    ) -> dict[str, float]:
        """Return all values of `model` from those of the original model and a start.

        Parameters
        ----------
        before : mapping of str to float
            Values of the model without the effect.
        start : mapping of str to float, optional
            One of `starts`, or `neutral` (default).
        """
        every = self.model.defaults()
        kept = dict(before)
        if self.effect.convert is not None:
            converted = self.effect.convert(before)
            kept |= {self.renamed.get(k, k): v for k, v in converted.items()}
        every |= {k: v for k, v in kept.items() if k in every and k not in self.model.held}
        return every | dict(self.neutral if start is None else start)

    def guessed(self, seen: Residual) -> list[dict[str, float]]:
        """Return the first start, updated from the residual of a record."""
        if self.effect.guess is None:
            return []
        answer = self.effect.guess(seen)
        limits = {q.name: (q.low, q.high) for q in self.model.parameters}
        starts = []
        for guess in [answer] if isinstance(answer, Mapping) else answer:
            start = dict(self.starts[0])
            for key, value in guess.items():
                name = self.renamed[key]
                start[name] = min(max(value, limits[name][0]), limits[name][1])
            starts.append(start)
        return starts


def described(name: str) -> tuple[Effect, ...]:
    """Return all variants of the effect called `name`.

    Raises
    ------
    ModelError
        If there is no such effect.
    """
    found = tuple(effect for effect in (*EFFECTS, PARAMETER_SHIFT) if effect.name == name)
    if not found:
        raise ModelError(f'there is no effect {name}{choices(name, EFFECT_NAMES)}')
    return found


def applicable(model: Model, effect: Effect) -> bool:
    """Return whether `effect` can be added to `model`."""
    present = set(model.block_names)
    if effect.requires and not present & set(effect.requires):
        return False
    alone = {block.name for block in model.blocks}
    if not (present.issuperset(effect.replaces[:1]) and alone.issuperset(effect.replaces[1:])):
        return False
    if not set(effect.frees) <= set(model.held):
        return False
    if effect.block is None:
        return True
    displaced = any(block.slot is Slot.HYSTERESIS for block in model.blocks)
    if effect.block.in_parallel:
        return displaced and effect.block.name not in present
    if effect.first and effect.block.slot is Slot.STRUCTURE and not displaced:
        return False  # the signal before an oscillator is a force and not a displacement
    return effect.repeatable or effect.block.name not in present


def add_effect(
    model: Model,
    effect: Effect,
    input_amplitude: float = REFERENCE_INPUT,
    displacement_amplitude: float = REFERENCE_DISPLACEMENT,
) -> Candidate:
    """Add `effect` to `model`.

    Parameters
    ----------
    model : Model
        The model without the effect.
    effect : Effect
        One of `piezo_hysteresis.blocks.EFFECTS`.
    input_amplitude, displacement_amplitude : float
        Largest absolute input [V or N] and half the span of the displacement [m]; start values
        and ranges are scaled to them.

    Raises
    ------
    ModelError
        If the effect cannot be added to the model, or is already part of it.
    """
    if not applicable(model, effect):
        raise ModelError(
            f'model {model.name} cannot take up {effect.name} ({effect.variant}): it has it '
            f'already or lacks {", ".join((*effect.requires, *effect.replaces, *effect.frees))}'
        )
    ratios = (input_amplitude / REFERENCE_INPUT, displacement_amplitude / REFERENCE_DISPLACEMENT)
    # the name that `named` takes: an effect has several blocks, creep one of one or two elements
    name = f'{model.name}+{(effect.block or effect).name}'
    if effect.block is None:
        larger, renamed = model.free(*effect.frees), {each: each for each in effect.frees}
        own = {q.name: q for block in model.blocks for q in block.parameters}
    else:
        larger, renamed = _with_block(model, effect, name, ratios)
        own = {q.name: q for q in effect.block.parameters}
    larger = Model(name, larger.blocks, larger.held)

    def named(values: Mapping[str, float]) -> dict[str, float]:
        scaled = {k: v * factor(own[k], ratios) for k, v in values.items()}
        return {renamed[k]: min(max(v, own[k].low), own[k].high) for k, v in scaled.items()}

    added = tuple(each for each in larger.free_names if each not in model.free_names)
    defaults = larger.defaults()
    base = {each: defaults[each] for each in added} | named(effect.starts[0])
    starts = (base, *(base | named(each) for each in effect.starts[1:]))
    neutral = {renamed[k]: v for k, v in effect.neutral.items()}
    return Candidate(effect, larger, added, neutral, starts, renamed)


def _with_block(
    model: Model, effect: Effect, name: str, ratios: tuple[float, float]
) -> tuple[Model, dict[str, str]]:
    assert effect.block is not None
    block = suited(effect.block, ratios)
    if effect.replaces:
        replaced, *others = effect.replaces
        larger = model.with_replaced(replaced, block, name)
        for each in others:
            larger = larger.without_block(each)
    else:
        larger = model.with_block(block, name, first=effect.first)
    renamed = larger.names_of(block)
    own = {q.name: q for q in effect.block.parameters}
    held = {
        renamed[k]: v * (factor(own[k], ratios) if own[k].follows_range else 1.0)
        for k, v in effect.holds.items()
    }
    return larger.hold(**held), renamed


def shifted(model: Model, values: Mapping[str, float], names: Sequence[str]) -> Candidate:
    """Return a candidate whose parameters are fitted again, starting from `values`.

    A fit does not find a lightly damped mode from a frequency some bandwidths away, so it also
    starts from other values of each frequency.
    """
    start = {name: values[name] for name in names}
    own = {name: name for name in names}
    scanned = tuple(
        start | {q.name: factor * start[q.name]}
        for q in model.parameters
        if q.name in own and q.unit == 'Hz'
        for factor in _SCAN
        if q.low <= factor * start[q.name] <= q.high
    )
    return Candidate(PARAMETER_SHIFT, model, tuple(names), {}, (start, *scanned), own)


def candidates(
    model: Model,
    input_amplitude: float = REFERENCE_INPUT,
    displacement_amplitude: float = REFERENCE_DISPLACEMENT,
) -> tuple[Candidate, ...]:
    """Return `model` with each applicable effect added, one at a time."""
    return tuple(
        add_effect(model, effect, input_amplitude, displacement_amplitude)
        for effect in EFFECTS
        if applicable(model, effect)
    )
