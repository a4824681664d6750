"""The simulated actuator: takes voltages, answers displacements, in lock-step or real time."""

from __future__ import annotations

import sys
import time

from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from piezo_interfaces.msg import ActuatorState, LoopStatus, VoltageCommand
from piezo_interfaces.srv import InjectFault, LoadPreset
from piezo_ros_common import topics
from piezo_ros_common.parameters import NodeParameters
from piezo_ros_common.qos import LATCHED, LOOP
from piezo_ros_common.running import run_node
from piezo_ros_common.stamps import stamp_into, tick_nanoseconds
from piezo_ros_common.table import Value
from piezo_sim.errors import SimulationError
from piezo_sim.nodes.pacing import CommandBook, Pace
from piezo_sim.nodes.tables import command_range, plant_table, simulator_table
from piezo_sim.plant import Plant

# No more than this many ticks at a time, so that parameters and commands are served in between.
CATCH_UP = 50


class Simulator(Node):
    """A plant behind two topics; everything about it is a ROS parameter."""

    def __init__(self) -> None:
        super().__init__('simulator')
        self.exit_code = 0
        self._tick = 0
        self._waiting_since: float | None = None
        self._newest_command = -1
        self._last_command_tick = -1
        self._missed_in_a_row = 0
        self._table = simulator_table()
        self._params = NodeParameters(self, self._table, self._apply)
        value = self._params
        self._plant = self._make_plant(value.text('preset'))
        self._params.extend(plant_table(self._plant), self._apply_plant, self._refuse_plant)
        self._rate = value.number('rate')
        self._plant.exchange(0.0)  # compiles the plant before the first tick
        self._plant.reset()
        limits = command_range(self._plant)
        self._book = CommandBook(
            limits[0], limits[1], value.number('safe_voltage'), value.number('ramp')
        )
        self._pace = Pace(self._rate, value.number('speed_factor'))
        self._lock_step = value.text('clock') == 'lock_step'
        self._make_topics()
        self._make_timers()
        self.get_logger().info(
            f'{value.text("preset")} at {self._rate:g} Hz, {value.text("clock")}, commands '
            f'{limits[0]:g} .. {limits[1]:g} V'
        )

    def _make_plant(self, preset: str) -> Plant:
        try:
            return Plant.from_preset(
                preset,
                rate=self._params.number('rate'),
                seed=self._params.integer('seed'),
            )
        except SimulationError as error:
            self.get_logger().fatal(str(error))
            raise SystemExit(2) from None

    def _make_topics(self) -> None:
        self._state = ActuatorState()
        self._state_publisher = self.create_publisher(ActuatorState, topics.STATE, LOOP)
        self._status_publisher = self.create_publisher(LoopStatus, topics.LOOP_STATUS, LATCHED)
        self._clock_publisher = None
        if self._params.flag('publish_clock'):
            self._clock_publisher = self.create_publisher(Clock, '/clock', LOOP)
        self.create_subscription(VoltageCommand, topics.VOLTAGE_COMMAND, self._on_command, LOOP)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.create_service(LoadPreset, '~/load_preset', self._on_load_preset)
        self.create_service(InjectFault, '~/inject_fault', self._on_inject_fault)

    def _make_timers(self) -> None:
        self._status_tick, self._status_time = 0, time.monotonic()
        self._publish_status()
        self.create_timer(1.0, self._watch)
        if not self._lock_step:
            self._pace.restart(time.monotonic(), 0)
            self.create_timer(0.5 / (self._rate * self._pace.speed_factor), self._run_due)

    # --- ticks ---------------------------------------------------------------------------------

    def _on_command(self, message: VoltageCommand) -> None:
        sample = message.sample
        if sample <= self._newest_command:
            self._answer_again(sample)
            return
        if self._lock_step:
            self._step_with(sample, message.voltage)
            return
        self._newest_command = sample
        self._book.counts['late'] += sample < self._tick
        if self._book.accept(message.voltage):
            self._last_command_tick = self._tick

    def _answer_again(self, sample: int) -> None:
        """Repeat the state of a command that came again in lock-step: somebody missed it."""
        if self._lock_step and sample == self._state.sample:
            self._state_publisher.publish(self._state)
        else:
            self._book.counts['doubled'] += 1

    def _step_with(self, sample: int, voltage: float) -> None:
        if sample != self._tick:
            self._book.counts['doubled' if sample < self._tick else 'missed'] += 1
            if sample > self._tick:
                self.get_logger().error(
                    f'command {sample} arrived where {self._tick} was expected: a link of the '
                    'chain lost a message; restart the excitation',
                    throttle_duration_sec=5.0,
                )
            return
        if sample == 0 and not self._listened_to():
            return  # the excitation says it again
        self._newest_command = sample
        self._waiting_since = time.monotonic()
        self._book.accept(voltage)
        self._advance()

    def _listened_to(self) -> bool:
        wanted = self._params.integer('wait_for')
        return bool(self._state_publisher.get_subscription_count() >= wanted)

    def _run_due(self) -> None:
        due = self._pace.due(time.monotonic())
        for _ in range(min(due - self._tick, CATCH_UP)):
            self._hold_or_ramp()
            self._advance()

    def _hold_or_ramp(self) -> None:
        if self._newest_command < self._tick and self._newest_command >= 0:
            self._book.counts['missed'] += 1
        silent = (self._tick - self._last_command_tick) / self._rate
        if silent > self._params.number('command_timeout'):
            self._book.ramp_to_safe(1.0 / self._rate)

    def _advance(self) -> None:
        voltage = self._book.voltage
        state = self._state
        state.sample = self._tick
        state.voltage = voltage
        state.displacement = self._plant.exchange(voltage)
        stamp_into(state.header.stamp, tick_nanoseconds(self._tick, self._rate))
        self._tick += 1
        self._state_publisher.publish(state)
        if self._clock_publisher is not None:
            self._clock_publisher.publish(Clock(clock=state.header.stamp))

    # --- watching ------------------------------------------------------------------------------

    def _watch(self) -> None:
        deadline = self._params.number('lock_step_deadline')
        if self._lock_step and self._waiting_since is not None:
            waited = time.monotonic() - self._waiting_since
            if waited > deadline:
                self.get_logger().error(
                    f'no command for tick {self._tick} within {deadline:g} s: a link of the '
                    'chain died or was stopped; start it again or end the experiment'
                )
                self._waiting_since = None
        self._publish_status()

    def _publish_status(self) -> None:
        now = time.monotonic()
        status = LoopStatus(sample=self._tick)
        status.late = self._book.counts['late']
        status.missed = self._book.counts['missed']
        status.refused = self._book.counts['refused']
        status.doubled = self._book.counts['doubled']
        if now > self._status_time:
            status.rate = (self._tick - self._status_tick) / (now - self._status_time)
        self._status_tick, self._status_time = self._tick, now
        self._status_publisher.publish(status)

    # --- parameters and services ---------------------------------------------------------------

    def _apply(self, changes: dict[str, Value]) -> None:
        self._book.safe_voltage = self._params.number('safe_voltage')
        self._book.ramp = self._params.number('ramp')
        if 'speed_factor' in changes:
            self._pace.speed_factor = self._params.number('speed_factor')
            self._pace.restart(time.monotonic(), self._tick)

    def _refuse_plant(self, changes: dict[str, Value]) -> str:
        try:
            self._plant.check(_for_plant(changes))
        except SimulationError as error:
            return str(error)
        return ''

    def _apply_plant(self, changes: dict[str, Value]) -> None:
        self._plant.set_parameters(_for_plant(changes))
        self._book.low, self._book.high = command_range(self._plant)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._plant.reset()
        self._book.voltage = 0.0
        response.success, response.message = True, f'at rest from tick {self._tick}'
        return response

    def _on_load_preset(
        self, request: LoadPreset.Request, response: LoadPreset.Response
    ) -> LoadPreset.Response:
        try:
            plant = Plant.from_preset(
                request.preset, rate=self._rate, seed=self._params.integer('seed')
            )
        except SimulationError as error:
            response.success, response.message = False, str(error)
            return response
        self._plant = plant
        self._book.low, self._book.high = command_range(plant)
        self._params.overwrite(dict(plant.parameters))
        response.success, response.message = True, f'{request.preset} loaded, at rest'
        return response

    def _on_inject_fault(
        self, request: InjectFault.Request, response: InjectFault.Response
    ) -> InjectFault.Response:
        try:
            self._plant.inject(request.fault, request.duration)
            response.success, response.message = True, f'{request.fault} injected'
        except SimulationError as error:
            response.success, response.message = False, str(error)
        return response


def _for_plant(changes: dict[str, Value]) -> dict[str, float | bool]:
    return {name: value for name, value in changes.items() if isinstance(value, bool | float)}


def main() -> None:
    """Run the simulator as a process."""
    sys.exit(run_node(Simulator))
