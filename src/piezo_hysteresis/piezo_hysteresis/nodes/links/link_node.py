"""Base class of the links: limits, watchdog, life cycle, counters, publishing."""

from __future__ import annotations

import math
from collections.abc import Callable

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.node_sheet import Health, Level
from piezo_hysteresis.common.parameter_table import ParameterTable, Value
from piezo_hysteresis.common.stamps import SequenceFilter, StampValidator
from piezo_hysteresis.compensation.limiter import EnergyLimits, Limiter
from piezo_hysteresis.compensation.link import Limits, Transition
from piezo_hysteresis.compensation.operating_limits import above_nyquist, operating_limits
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.nodes.messages import voltage_bytes
from piezo_hysteresis.ros.guarded import GuardedLifecycleNode, sends_floats
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.qos import LATCHED, LOOP
from piezo_hysteresis.ros.readiness import Diagnostics
from piezo_hysteresis.ros.running import wall_timer
from piezo_hysteresis.ros.starting import refuse_start
from piezo_hysteresis.runtime.link_health import ALARMS, CORRECTS, LinkHealth, Watchdog
from piezo_interfaces.msg import LoopStatus, VoltageCommand

_ENERGY = ('energy_limit', 'energy_window', 'capacitance')


class LinkNode(GuardedLifecycleNode):
    """A managed node that receives a voltage, adds its share and passes it on.

    While it is not active its share is zero and the limited voltage passes through. After every
    change the share follows a smooth transition within the slew limit. If the input is missing
    while the actuator runs, the voltage ramps to the safe voltage.

    Parameters
    ----------
    name : str
        Of the node.
    table : ParameterTable
        Its parameters.
    topic : str
        Topic of its output.
    source : str
        Topic of its input; its publisher distinguishes a pause from a node that has ended.
    """

    def __init__(self, name: str, table: ParameterTable, topic: str, source: str) -> None:
        super().__init__(name)
        self._source = source
        Diagnostics(self, self.health)
        self.active = False
        self.exit_code = 0
        self.intake = SequenceFilter()
        self._refused = 0
        self._late = 0
        self._sample = -1
        self._logged: tuple[bytes, int, float] | None = None
        self._next: Callable[[bytes, int, float], None] | None = None
        self.idle_publishers = 0  # publishers of the input in this process that publish nothing
        self._alarms: set[str] = set()
        self.parameters = NodeParameters(self, table)
        value = self.parameters.number
        self._warnings = self._limits_of_model()
        self.dt = 1.0 / value('rate')
        self.stamps = StampValidator(self.dt)
        self._limiter = Limiter(self.limits(), self.dt, energy=self.energy())
        self._watchdog = Watchdog(
            self._limiter, self._timeout(), value('safe_voltage'), value('safe_ramp')
        )
        self._fade = self.new_fade()
        self._voltage_publisher = self.plain_publisher(VoltageCommand, topic, LOOP)
        # Next to the voltage topic, also if that is remapped.
        slew_topic = topics.slew_of(self._voltage_publisher.topic_name)
        self._slew_publisher = self.plain_publisher(Float64, slew_topic, LATCHED)
        self._slew_sample = -1
        self._status_publisher = self.plain_publisher(LoopStatus, '~/status', LATCHED)
        self._health = LinkHealth(self.limits())
        wall_timer(self, 1.0, self._publish_status)

    def plain_publisher(self, kind: type, topic: str, qos: QoSProfile) -> Publisher:
        """Return a publisher that publishes while the node is inactive too."""
        return sends_floats(Node.create_publisher(self, kind, topic, qos))

    def autostart(self) -> None:
        """Serve parameters and activate if configured; to be called at the end of __init__."""
        self.parameters.serve(self.apply, self.refuse)
        if self.parameters.flag('autostart'):
            self.trigger_configure()
            self.trigger_activate()

    def destroy_node(self) -> None:
        """Destroy the node and its life cycle, which otherwise keeps the node alive."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    # --- parameters ----------------------------------------------------------------------------

    def _limits_of_model(self) -> tuple[str, ...]:
        """Take the limits that are not given from the model file; return what to know of it."""
        dt = 1.0 / self.parameters.number('rate')
        path = str(self.parameters.values.get('model_file', ''))
        try:
            model = ModelFile.load(path) if path else None
        except PiezoError as error:
            refuse_start(error)
        own = self.parameters

        def given(name: str) -> float | None:
            return own.number(name) if own.is_given(name) else None

        found = operating_limits(
            model, low=given('limits.low'), high=given('limits.high'), slew=given('limits.slew')
        )
        settings: dict[str, Value] = {
            'limits.low': found.limits.low, 'limits.high': found.limits.high,
            'limits.slew': found.limits.slew, 'safe_voltage': found.rest,
            'safe_ramp': found.safe_ramp,
        }  # fmt: skip
        if model is not None:
            own.overwrite({k: v for k, v in settings.items() if not own.is_given(k)})
        for sentence in (warnings := (*found.warnings, *above_nyquist(model, dt))):
            self.get_logger().warning(sentence)
        return warnings

    def limits(self) -> Limits:
        """Return the limits in force."""
        value = self.parameters.number
        return Limits(value('limits.low'), value('limits.high'), value('limits.slew'))

    def energy(self) -> EnergyLimits:
        """Return the energy limits in force."""
        value = self.parameters.number
        supply = value('limits.high') - value('limits.low')
        return EnergyLimits(
            value('energy_limit'), value('capacitance'), value('energy_window'), supply
        )

    def _timeout(self) -> int:
        seconds = self.parameters.number('watchdog')
        return max(2, round(seconds / self.dt)) if seconds > 0.0 else 0

    def apply(self, changes: dict[str, Value]) -> None:
        """Apply accepted parameter changes."""
        limits = any(name.startswith('limits.') for name in changes)
        if limits or not changes.keys().isdisjoint(_ENERGY):
            self._limiter.retune(self.limits(), self.energy())
            self._health.set_limits(self.limits())
        if limits or 'transition' in changes:
            self._fade.retune(self.parameters.number('transition'), self.limits().slew)
            self._publish_slew()
        self._watchdog.timeout = self._timeout()
        self._watchdog.safe_voltage = self.parameters.number('safe_voltage')
        self._watchdog.ramp = self.parameters.number('safe_ramp')

    @property
    def work(self) -> str:
        """What the node does while it is active."""
        return CORRECTS

    def refuse(self, changes: dict[str, Value]) -> str:
        """Return why `changes` are impossible, '' if they are possible."""
        return ''

    # --- life cycle ----------------------------------------------------------------------------

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate the share of the node."""
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
        self.cross_fade()

    def go_safe(self, reason: str) -> None:
        """Deactivate the node, because a callback fails persistently: the voltage passes."""
        self.get_logger().error(f'the node deactivates itself: {reason}')
        if self.active:
            self.trigger_deactivate()

    # --- the voltage ---------------------------------------------------------------------------

    def new_fade(self) -> Transition:
        """Return the transition of the share."""
        return Transition(self.dt, self.parameters.number('transition'), self.limits().slew)

    def cross_fade(self) -> None:
        """Start a smooth transition from the last share to the next one."""
        self._fade.start()

    def restart_at(self, sample: int) -> None:
        """Reset for a restarted loop at tick `sample`; at tick 0 from rest."""
        self._watchdog.reset()
        self._fade = self.new_fade()
        if sample == 0:
            limits = self._limiter.limits
            self.start_at(min(max(0.0, limits.low), limits.high))

    def start_at(self, voltage: float) -> None:
        """Log the source of the voltage before the first one is published."""
        self._limiter.follow(voltage)

    def pass_on(self, head: bytes, sample: int, received: float, voltage: float) -> None:
        """Limit `voltage` and publish it for tick `sample`; `received` is the input.

        A voltage that is not finite is refused and the last voltage is held.
        """
        share = voltage - received
        if math.isfinite(share):
            faded = self._fade.apply(share)
            voltage = voltage if faded == share else received + faded
        else:
            self._refused += 1
            voltage = self._limiter.voltage
        if self._watchdog.stale:
            if sample <= self._sample:  # the ramp to the safe voltage was faster
                self._late += 1
                return
            self.get_logger().info(f'input is back at tick {sample}', throttle_duration_sec=5.0)
        self._watchdog.received(sample)
        self._send(head, sample, self._limiter.apply(voltage))

    def _send(self, head: bytes, sample: int, voltage: float) -> None:
        if sample == 0 or sample != self._sample + 1:  # another node may have commanded
            self._publish_slew()
        self._sample = sample
        self._logged = (head, sample, voltage)
        self._log(*self._logged)

    def _log(self, head: bytes, sample: int, voltage: float) -> None:
        if self._next is not None:
            self._next(head, sample, voltage)
        self._voltage_publisher.publish(voltage_bytes(head, sample, voltage))

    def _publish_slew(self) -> None:
        """Publish the slew limit for the receiver, which also applies it to late commands."""
        self._slew_sample = self._sample
        self._slew_publisher.publish(Float64(data=self._limiter.limits.slew))

    def deliver_to(self, take: Callable[[bytes, int, float], None]) -> None:
        """Call `take` with head, tick and voltage [V] of every command before it is published."""
        self._next = take

    def pass_on_again(self, sample: int) -> None:
        """Send the last voltage again to a link that missed it, if it was for tick `sample`."""
        if sample == self._sample and self._logged is not None:
            self._log(*self._logged)

    def watch(self, head: bytes, sample: int) -> None:
        """Process that the actuator has reached tick `sample`; ramp to the safe voltage if due."""
        watchdog = self._watchdog
        if not watchdog.overdue(sample + 1):
            return
        before = watchdog.stale
        voltage = watchdog.voltage(sample + 1)
        if voltage is not None:
            self._send(head, sample + 1, voltage)
        if watchdog.stale and not before:
            self._log_stale()

    def _log_stale(self) -> None:
        watchdog = self._watchdog
        message = f'no input since tick {watchdog.newest}: the voltage goes to '
        message += f'{watchdog.safe_voltage:g} V'
        if self.has_publisher():
            self.get_logger().info(
                f'{message}; the publisher of {self._source} pauses', throttle_duration_sec=5.0
            )
        else:
            self.get_logger().warning(
                f'{message}; no node publishes {self._source} any more: start that node again',
                throttle_duration_sec=5.0,
            )

    def has_publisher(self) -> bool:
        """Return whether the publisher of the input still exists."""
        there = self.count_publishers(self.resolve_topic_name(self._source))
        return bool(there > self.idle_publishers)

    # --- counting ------------------------------------------------------------------------------

    def counters(self) -> dict[str, int]:
        """Return the counters of the node's own law."""
        return {}

    def all_counters(self) -> dict[str, int]:
        """Return every counter of the node."""
        own = {
            'refused': self._refused,
            'late': self._late,
            'stale': self._watchdog.episodes,
            'stamp_jumps': self.stamps.jumps,
        }
        limited = self._limiter.counters()
        law = {
            f'measured_{name}' if name in limited else name: count
            for name, count in self.counters().items()
        }
        return {**self.intake.counters(), **own, **limited, **law}

    def health(self) -> Health:
        """Return the health of the node."""
        numbers = {
            'active': self.active,
            'sample': self._sample,
            'voltage_V': self._limiter.voltage,
            'mean_power_W': self._limiter.mean_power,
        }
        paused = self._watchdog.stale and self.has_publisher()
        findings = [(Level.WARN, sentence) for sentence in self._warnings]
        return self._health.judge(
            numbers, self.all_counters(), self._watchdog, paused, findings, self.work
        )

    def _publish_status(self) -> None:
        if self._sample != self._slew_sample:
            self._publish_slew()
        counts = self.all_counters()
        status = LoopStatus(sample=max(0, self._sample))
        status.missed, status.late = counts['missed'], counts['late']
        status.refused = counts['refused'] + counts['strays']
        status.doubled = counts['doubled'] + counts['reordered']
        status.limited = sum(self._limiter.counters().values())
        status.names = list(counts)
        status.counts = list(counts.values())
        self._status_publisher.publish(status)
        alarms = {name for name in ALARMS if counts.get(name)}
        for name in alarms - self._alarms:
            self.get_logger().error(f'{ALARMS[name]}; then call ~/reset')
        self._alarms = alarms
