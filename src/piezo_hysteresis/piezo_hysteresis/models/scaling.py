"""Start values and scales of a model for a given actuator, by dimensional analysis.

Defaults are for an input amplitude of 1 V (or N) and a displacement amplitude of 130 um, a
bimorph; a stack with 20 µm at 150 V is the same model in other units.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from piezo_hysteresis.blocks.base import Block, Parameter
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
