"""What every link of the voltage chain does: limits, life cycle, counting, publishing."""

from __future__ import annotations

from typing import NoReturn, Protocol

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from piezo_hysteresis.compensation.base import Limits
from piezo_hysteresis.compensation.limiter import Limiter
from piezo_hysteresis.compensation.transition import Transition
from piezo_interfaces.msg import LoopStatus, VoltageCommand
from piezo_ros_common.parameters import NodeParameters
from piezo_ros_common.qos import LATCHED, LOOP
from piezo_ros_common.table import ParameterTable, Value
from piezo_ros_common.timers import wall_timer

# Counters that mean that a law has switched itself off.
_ALARMS = {
    'inverted_plant': 'the actuator answers with the opposite sign: check the sensor or amplifier',
    'diverged': 'the loop swings between its limits: lower the gains',
}


class Fade(Protocol):
    """What carries the share of a link over a change."""

    def start(self) -> None:
        """Make the next share begin where the last one was."""

    def apply(self, raw: float) -> float:
        """Answer the share for this tick [V]."""

    def retune(self, duration: float, slew: float) -> None:
        """Change how long [s] and how fast [V/s] changes may be."""


class LinkNode(LifecycleNode):
    """A managed node that receives a voltage, adds its share and passes it on.

    While it is not active its share is zero and the voltage passes through, limited. Whatever
    changes while it runs, the share goes over smoothly, no faster than the slew limit.
    """

    def __init__(self, name: str, table: ParameterTable, topic: str) -> None:
        super().__init__(name)
        self.active = False
        self.exit_code = 0
        self._doubled = 0
        self._passed = False
        self._alarms: set[str] = set()
        self.parameters = NodeParameters(self, table, self.apply, self.refuse)
        self.dt = 1.0 / self.parameters.number('rate')
        self._limiter = Limiter(self.limits(), self.dt)
        self._fade = self.new_fade()
        self._output = VoltageCommand()
        self._voltage_publisher = self.plain_publisher(VoltageCommand, topic, LOOP)
        self._status_publisher = self.plain_publisher(LoopStatus, '~/status', LATCHED)
        wall_timer(self, 1.0, self._publish_status)

    def plain_publisher(self, kind: type, topic: str, qos: QoSProfile) -> Publisher:
        """Return a publisher that publishes while the node is inactive too."""
        return super(LifecycleNode, self).create_publisher(kind, topic, qos)

    def autostart(self) -> None:
        """Configure and activate, where the parameter says so; call at the end of __init__."""
        if self.parameters.flag('autostart'):
            self.trigger_configure()
            self.trigger_activate()

    def give_up(self, reason: str) -> NoReturn:
        """End the process at start because it cannot work as it was told."""
        self.get_logger().fatal(f'{reason} (mend the parameter file or argument)')
        raise SystemExit(2)

    def limits(self) -> Limits:
        """Return the limits in force."""
        value = self.parameters.number
        return Limits(value('limits.low'), value('limits.high'), value('limits.slew'))

    def apply(self, changes: dict[str, Value]) -> None:
        """Take accepted parameter changes over."""
        limits = any(name.startswith('limits.') for name in changes)
        if limits:
            self._limiter = Limiter(self.limits(), self.dt, self._limiter.voltage)
        if limits or 'transition' in changes:
            self._fade.retune(self.parameters.number('transition'), self.limits().slew)

    def refuse(self, changes: dict[str, Value]) -> str:
        """Return '' or why `changes` cannot be made."""
        return ''

    # --- life cycle ----------------------------------------------------------------------------

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let the node's share act."""
        self._become(True)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Set the node's share to zero; the voltage still passes."""
        self._become(False)
        return super().on_deactivate(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Set the node's share to zero, as `on_deactivate` does."""
        self._become(False)
        return super().on_shutdown(state)

    def _become(self, active: bool) -> None:
        self.active = active
        self.go_over()

    # --- the voltage ---------------------------------------------------------------------------

    def new_fade(self) -> Fade:
        """Return what carries the share over a change."""
        return Transition(self.dt, self.parameters.number('transition'), self.limits().slew)

    def go_over(self) -> None:
        """Let the share go over smoothly from the last one to what comes next."""
        self._fade.start()

    def start_at(self, voltage: float) -> None:
        """Say what the voltage is, before the first one is passed on."""
        self._limiter.reset(voltage)

    def pass_on(self, header: Header, sample: int, received: float, wanted: float) -> None:
        """Limit `wanted` and publish it for tick `sample`; `received` is what came in."""
        share = wanted - received
        faded = self._fade.apply(share)
        output = self._output
        output.header = header
        output.sample = sample
        output.voltage = self._limiter.apply(wanted if faded == share else received + faded)
        self._voltage_publisher.publish(output)
        self._passed = True

    def pass_on_again(self, sample: int) -> None:
        """Repeat the last voltage, if it was for tick `sample`, to a link that missed it."""
        if sample == self._output.sample and self._passed:
            self._voltage_publisher.publish(self._output)
        else:
            self._doubled += 1

    # --- counting ------------------------------------------------------------------------------

    def counters(self) -> dict[str, int]:
        """Return the counters of the node's own law."""
        return {}

    def _publish_status(self) -> None:
        limited = self._limiter.counters()
        counts = {**limited, **self.counters()}
        status = LoopStatus(sample=self._output.sample, doubled=self._doubled)
        status.limited = sum(limited.values())
        status.names = ','.join(counts)
        status.counts = list(counts.values())
        self._status_publisher.publish(status)
        alarms = {name for name in _ALARMS if counts.get(name)}
        for name in alarms - self._alarms:
            self.get_logger().error(f'{_ALARMS[name]}; then call ~/reset')
        self._alarms = alarms
