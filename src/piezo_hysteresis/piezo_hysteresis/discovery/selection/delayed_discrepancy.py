"""Known discrepancy of a fixed baseline with a delay or a lag that was added to it.

The known discrepancy was measured without the effect and is subtracted from the data. An actuator
whose voltage or reading comes later has its discrepancy later, too. Without this, a delay by a
twentieth of a period leaves a third of the known discrepancy, which resembles a second effect.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from piezo_hysteresis.arrays import ComplexArray, FloatArray
from piezo_hysteresis.blocks.base import Between, Block, Slot
from piezo_hysteresis.blocks.transport_delay import in_ticks
from piezo_hysteresis.discovery.selection.candidate_fit import ModelSpec, effect_of
from piezo_hysteresis.discovery.selection.residual_model import Expectation
from piezo_hysteresis.identification.sensitivities import delays_by_ticks
from piezo_hysteresis.identification.targets import Target

# Share of a record, 1 / _PAD, by which it is extended, because the transform is periodic.
_PAD = 8

# Frequency response by frequency [Hz].
_Response = Callable[[FloatArray], ComplexArray]


def with_delayed_discrepancy(
    spec: ModelSpec,
    errors: Sequence[FloatArray],  # [m]
    views: Sequence[Target],
    expected: Sequence[Expectation],
    late: float,  # [s]
) -> tuple[FloatArray, ...]:
    """Return residuals beyond the known discrepancy as the added effects pass it on."""
    responses = _responses(spec, views[0].dt, late) if views else []
    if not responses:
        return tuple(errors)
    return tuple(
        error + x.repeated - _passed(x.repeated, view.dt * view.stride, responses)
        for error, view, x in zip(errors, views, expected, strict=True)
    )


def _passed(signal: FloatArray, dt: float, responses: Sequence[_Response]) -> FloatArray:
    """Return a signal after linear systems; its mean stays."""
    if not np.any(signal):
        return signal
    pad = signal.size // _PAD
    held = np.concatenate([np.full(pad, signal[0]), signal])
    frequency = np.asarray(np.fft.rfftfreq(held.size, dt), np.float64)
    spectrum = np.fft.rfft(held)
    for response in responses:
        spectrum *= response(frequency)
    return np.asarray(np.fft.irfft(spectrum, held.size)[pad:], np.float64)


def _responses(spec: ModelSpec, dt: float, late: float) -> list[_Response]:
    """Return the frequency responses of the added delays and lags."""
    found: list[_Response] = []
    for added in spec.added:
        block = effect_of(added).block
        if block is None or block.slot not in (Slot.INPUT, Slot.SENSOR):
            continue
        own = np.array([spec.values[added.names[each.name]] for each in block.parameters])
        if block.between is Between.DELAY:
            name = added.names[block.parameters[0].name]
            by_ticks = name in delays_by_ticks(spec.model)
            found.append(_delay(whole_delay(spec, name, dt, late) if by_ticks else float(own[0])))
        elif block.between is Between.LINEAR and _is_low_pass(block, own):
            found.append(_low_pass(block, own))
    return found


def whole_delay(spec: ModelSpec, name: str, dt: float, late: float) -> float:
    """Return a delay that moves a held voltage by ticks of `dt` [s], with its fraction [s].

    The fraction is a sampling offset from that of the baseline, `late` [s]: samples that are read
    earlier show a response that comes later.
    """
    return in_ticks(spec.values[name], dt)[0] * dt - (spec.sampling_offset - late)


def _delay(time: float) -> _Response:
    return lambda frequency: np.exp(-2j * np.pi * frequency * time)


def _is_low_pass(block: Block, own: FloatArray) -> bool:
    return block.system is not None and block.system(own).a.shape == (1, 1)


def _low_pass(block: Block, own: FloatArray) -> _Response:
    assert block.system is not None
    a, b, c, d = block.system(own)
    return lambda frequency: d + c[0] * b[0] / (2j * np.pi * frequency - a[0, 0])
