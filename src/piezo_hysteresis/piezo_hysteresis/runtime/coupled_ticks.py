"""A loop of several axes without ROS: ticks that are complete, and what is asked of all axes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from piezo_hysteresis.compensation.coupled.axes_chain import AxesChain, axes_chain
from piezo_hysteresis.compensation.coupled.matrix_attenuation import static_gains
from piezo_hysteresis.compensation.coupled.matrix_settings import MatrixSettings
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint
from piezo_hysteresis.runtime.link_health import SensorSign, StuckSensor

if TYPE_CHECKING:
    from piezo_hysteresis.axes.modal_model import ModalModel

# Largest number of stored messages of an axis.
_LONGEST = 5000


def matrix_settings(values: Mapping[str, Any]) -> MatrixSettings | None:
    """Return the attenuation that the parameters of the node describe; None where it is off."""
    own = tuple(values['orders']), values['step'], values['largest_correction']
    return MatrixSettings(*own) if values['enabled'] else None


class CoupledTick(NamedTuple):
    """What all axes have for one tick."""

    points: list[ReferencePoint]  # the references of the tick
    measured: list[Measured | None]  # the measurements of the tick before
    tags: list[bytes]  # data attached to the references


class CoupledBook:
    """Collects the messages of all axes until a tick is complete, in any order of arrival.

    Tick k is complete with the references of all axes and their measurements of tick k - 1; if a
    reference is repeated, without those.
    """

    def __init__(self, axes: int) -> None:
        self.dropped = 0
        self.done = -1
        self._points: list[dict[int, tuple[ReferencePoint, bytes]]] = [{} for _ in range(axes)]
        self._measured: list[dict[int, Measured]] = [{} for _ in range(axes)]
        self._newest: list[Measured | None] = [None for _ in range(axes)]
        self._repeated = -1

    def add_reference(self, axis: int, point: ReferencePoint, tag: bytes) -> None:
        """Add the reference of an axis, counted from 0, for one tick."""
        if point.sample > self.done:
            if point.sample in self._points[axis]:
                self._repeated = point.sample
            self._points[axis][point.sample] = point, tag
            self._points[axis].pop(point.sample - _LONGEST, None)

    def add_measured(self, axis: int, measured: Measured) -> None:
        """Add the measurement of an axis."""
        self._measured[axis][measured.sample] = self._newest[axis] = measured
        self._measured[axis].pop(measured.sample - _LONGEST, None)

    def take(self) -> CoupledTick | None:
        """Return the newest complete tick once; older ones that are not complete are dropped."""
        for sample in sorted(self._points[0], reverse=True):
            if all(sample in each for each in self._points) and self._is_measured(sample):
                return self._taken(sample)
        return None

    def _is_measured(self, sample: int) -> bool:
        there = all(sample - 1 in each for each in self._measured)
        return there or sample in (0, self._repeated)

    def _taken(self, sample: int) -> CoupledTick:
        pairs = [each[sample] for each in self._points]
        measured = [
            each.get(sample - 1, newest)
            for each, newest in zip(self._measured, self._newest, strict=True)
        ]
        self.done = sample
        for points, reads in zip(self._points, self._measured, strict=True):
            for old in [each for each in points if each <= sample]:
                del points[old]
                self.dropped += old < sample
            for old in [each for each in reads if each < sample - 1]:
                del reads[old]
        return CoupledTick([point for point, _ in pairs], measured, [tag for _, tag in pairs])


class CoupledLoop:
    """Voltages of all axes, as the parameters of the node describe them."""

    def __init__(
        self, model: ModalModel, values: Mapping[str, Any], limits: Sequence[Limits]
    ) -> None:
        self._model, self._limits, self._dt = model, limits, 1.0 / values['rate']
        self._held = [ReferencePoint(0, 0.0, 0.0, 0.0, 0.0, 0.0) for _ in limits]
        self._refused = 0
        self._sensors = [StuckSensor(self._dt) for _ in limits]
        self._signs = [SensorSign(self._dt) for _ in limits]
        self.withheld = False
        self.use(values)
        gain = static_gains(model)
        omega, damping = (each[0] for each in model.modes_at(np.array([model.full_level])))
        lowest = int(np.argmin(omega))
        for own, sign, each in zip(gain, self._signs, limits, strict=True):
            mode = float(omega[lowest]) / (2.0 * math.pi), float(damping[lowest])
            sign.expect(ModeGain(float(own), *mode, self._dt), each.high - each.low)

    def use(self, values: Mapping[str, Any]) -> None:
        """Take other settings over; the feedforward continues, the correction begins anew."""
        before: AxesChain | None = getattr(self, 'chain', None)
        self.chain = axes_chain(self._model, self._limits, matrix_settings(values), values['rate'])
        self._checks = bool(values['sensor_check'])
        self._warm_up()
        if before is not None:
            self.chain.decoupling = before.decoupling

    def _warm_up(self) -> None:
        """Compile the kernels before the first tick."""
        for k in range(2):
            points = [ReferencePoint(k, 0.0, 0.0, 0.0, 0.1 / self._dt, 0.0) for _ in self._limits]
            self.chain.step(points, [Measured(k - 1, 0.0, 0.0) for _ in points])
        self.chain.reset()

    def take_state(self, axis: int, measured: Measured) -> None:
        """Check the sensor of an axis: what no command waits for."""
        self._sensors[axis].update(measured.voltage, measured.displacement)
        self._signs[axis].update(measured.voltage, measured.displacement)

    def voltages(self, tick: CoupledTick) -> list[float]:
        """Return what is asked of all axes for a tick [V].

        A reference that is not a number is replaced by the last one, and nothing is learnt.
        """
        measured = tick.measured
        for axis, point in enumerate(tick.points):
            if math.isfinite(sum(point)):
                self._held[axis] = point
            else:
                self._refused += 1
                self._held[axis] = self._held[axis]._replace(sample=point.sample)
                measured = [None for _ in measured]
        may_close = [sign.may_close() for sign in self._signs]  # each counts its time
        self.withheld = self._checks and not all(may_close)
        return self.chain.step(self._held, measured, closed=not self.withheld)

    def restart(self) -> None:
        """Start again from rest."""
        self.chain.reset()
        for sign in self._signs:
            sign.reset()

    def reset_correction(self) -> None:
        """Begin the correction anew; the feedforward continues."""
        if self.chain.attenuation is not None:
            self.chain.attenuation.reset()
        for sign in self._signs:
            sign.reset()

    def counters(self) -> dict[str, int]:
        """Return what was counted, by name."""
        signs = [sign.counters() for sign in self._signs] if self.withheld else []
        return {
            'refused_references': self._refused,
            'stuck_sensor': max(sensor.ticks for sensor in self._sensors),
            **{name: max(each[name] for each in signs) for name in (signs[0] if signs else ())},
            **self.chain.counters(),
        }
