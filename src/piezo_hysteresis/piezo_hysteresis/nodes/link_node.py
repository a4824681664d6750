"""What every link of the voltage chain does: limits, life cycle, counting, publishing."""

from __future__ import annotations

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from std_msgs.msg import Header

from piezo_hysteresis.compensation.base import Limits
from piezo_hysteresis.compensation.limiter import Limiter
from piezo_interfaces.msg import LoopStatus, VoltageCommand
from piezo_ros_common.parameters import NodeParameters
from piezo_ros_common.qos import LATCHED, LOOP
from piezo_ros_common.table import ParameterTable, Value


class LinkNode(LifecycleNode):
    """A managed node that receives a voltage, adds its share and passes it on.

    While it is not active its share is zero and the voltage passes through, limited.
    """

    def __init__(self, name: str, table: ParameterTable, topic: str) -> None:
        super().__init__(name)
        self.active = False
        self.exit_code = 0
        self._doubled = 0
        self._passed = False
        self.parameters = NodeParameters(self, table, self.apply, self.refuse)
        self.dt = 1.0 / self.parameters.number('rate')
        self._limiter = Limiter(self.limits(), self.dt)
        self._output = VoltageCommand()
        # Plain publishers: the voltage must pass through while the node is inactive too.
        self._voltage_publisher = super(LifecycleNode, self).create_publisher(
            VoltageCommand, topic, LOOP
        )
        self._status_publisher = super(LifecycleNode, self).create_publisher(
            LoopStatus, '~/status', LATCHED
        )
        self.create_timer(1.0, self._publish_status)

    def autostart(self) -> None:
        """Configure and activate, where the parameter says so; call at the end of __init__."""
        if self.parameters.flag('autostart'):
            self.trigger_configure()
            self.trigger_activate()

    def limits(self) -> Limits:
        """Return the limits in force."""
        value = self.parameters.number
        return Limits(value('limits.low'), value('limits.high'), value('limits.slew'))

    def apply(self, changes: dict[str, Value]) -> None:
        """Take accepted parameter changes over."""
        if any(name.startswith('limits.') for name in changes):
            self._limiter = Limiter(self.limits(), self.dt, self._limiter.voltage)

    def refuse(self, changes: dict[str, Value]) -> str:
        """Return '' or why `changes` cannot be made."""
        return ''

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let the node's share act."""
        self.active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Set the node's share to zero; the voltage still passes."""
        self.active = False
        return super().on_deactivate(state)

    def count_doubled(self) -> None:
        """Count a message that came twice or out of order."""
        self._doubled += 1

    def pass_on(self, header: Header, sample: int, voltage: float) -> None:
        """Limit `voltage` and publish it for tick `sample`."""
        output = self._output
        output.header = header
        output.sample = sample
        output.voltage = self._limiter.apply(voltage)
        self._voltage_publisher.publish(output)
        self._passed = True

    def pass_on_again(self, sample: int) -> None:
        """Repeat the last voltage, if it was for tick `sample`, to a link that missed it."""
        if sample == self._output.sample and self._passed:
            self._voltage_publisher.publish(self._output)
        else:
            self.count_doubled()

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
