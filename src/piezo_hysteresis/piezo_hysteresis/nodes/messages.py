"""Pairs of conversions between messages and the objects of the core; nothing else knows both."""

from __future__ import annotations

from piezo_hysteresis.compensation.base import Measured, ReferencePoint
from piezo_hysteresis.identification.estimate import Estimate
from piezo_interfaces.msg import ActuatorState, ModelEstimate, Reference


def point_from(message: Reference) -> ReferencePoint:
    """Return the reference point of `message`."""
    return ReferencePoint(
        message.sample,
        message.displacement,
        message.velocity,
        message.acceleration,
        message.frequency,
        message.phase,
    )


def point_into(point: ReferencePoint, message: Reference) -> None:
    """Write `point` into `message`; the header stays as it is."""
    message.sample = point.sample
    message.displacement = point.displacement
    message.velocity = point.velocity
    message.acceleration = point.acceleration
    message.frequency = point.frequency
    message.phase = point.phase


def measured_from(message: ActuatorState) -> Measured:
    """Return the measurement of `message`."""
    return Measured(message.sample, message.voltage, message.displacement)


def estimate_into(estimate: Estimate, message: ModelEstimate) -> None:
    """Write `estimate` into `message`; header, sample and method stay as they are."""
    message.model = estimate.model
    message.names = list(estimate.names)
    message.units = list(estimate.units)
    message.values = [float(value) for value in estimate.values]
    message.standard_deviations = [float(value) for value in estimate.standard_deviations]
    message.one_step_rms = float(estimate.one_step_rms)
    message.condition_number = float(estimate.condition_number)
    message.message = ' '.join(estimate.notes)


def parameters_from(message: ModelEstimate) -> dict[str, float]:
    """Return the parameters of `message` by name."""
    return dict(zip(message.names, message.values, strict=True))
