"""Node of the simulated actuator: voltages in, displacements out, lock-step or real time."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from functools import partial

from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.node_sheet import Health
from piezo_hysteresis.common.parameter_table import Value
from piezo_hysteresis.common.stamps import NANOSECONDS, StampValidator, tick_nanoseconds
from piezo_hysteresis.ros.cdr_header import FlatCodec, head_of, nanoseconds_of_head
from piezo_hysteresis.ros.guarded import GuardedNode
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.qos import LATCHED, LOOP
from piezo_hysteresis.ros.readiness import Diagnostics, Neighbours
from piezo_hysteresis.ros.running import run_node, wall_timer
from piezo_interfaces.msg import ActuatorState, LoopStatus, VoltageCommand
from piezo_interfaces.srv import InjectFault, LoadPreset
from piezo_sim.axes_plant import AxesPlant
from piezo_sim.nodes.pacing import COUNTS, ActuatorHealth, CommandQueue, Pace
from piezo_sim.nodes.simulator_tables import axes_of, plant_of, plant_table, simulator_table
from piezo_sim.plant import Plant
from piezo_sim.simulation_errors import SimulationError

STATE = FlatCodec(ActuatorState)
COMMAND = FlatCodec(VoltageCommand)

# Largest number of ticks per callback, so that parameters and commands are served in between.
CATCH_UP = 50

# Shortest period of the real-time timer [s].
SHORTEST_WAIT = 2e-4


class Simulator(GuardedNode):
    """Node of a plant with two topics an axis; all of its settings are ROS parameters."""

    def __init__(self) -> None:
        super().__init__('simulator')
        Diagnostics(self, self._judge)
        self.exit_code = 0
        self._tick = 0
        self._waiting_since: float | None = None
        self._warned = self._refuses = False
        self._newest_command = -1
        self._axes = range(0)
        self._table = simulator_table()
        self._params = NodeParameters(self, self._table)
        self._params.serve(self._apply, self._refuse)
        value = self._params
        self._rate = value.number('rate')
        self._stamps = StampValidator(1.0 / self._rate)
        self._preset = value.text('preset')
        self._plant = _plant(value.values)
        self._params.extend(plant_table(self._plant), self._apply_plant, self._refuse_plant)
        self._plant.set_parameters(_for_plant(self._params.values, self._plant))
        self._axes = _numbers(self._plant)
        self._exchange([0.0 for _ in self._axes])  # compiles the plant before the first tick
        self._plant.reset()
        self._counts = dict.fromkeys(COUNTS, 0)
        self._books = [
            CommandQueue(*each.command_range, counts=self._counts) for each in axes_of(self._plant)
        ]
        self._given: dict[int, float] = {}  # commands of the next tick by axis [V] (lock_step)
        self._set_books()
        self._pace = Pace(self._rate, value.number('speed_factor'))
        self._lock_step = value.text('clock') == 'lock_step'
        self._make_topics()
        self._make_timers()
        self._health = ActuatorHealth()
        self._neighbours = Neighbours(self)
        low, high = self._range()
        self.get_logger().info(
            f'{value.text("preset")} at {self._rate:g} Hz, {value.text("clock")}, commands '
            f'{low:g} .. {high:g} V'
        )

    def _make_topics(self) -> None:
        self._state_publishers = [
            self.create_publisher(ActuatorState, topics.of_axis(topics.STATE, axis), LOOP)
            for axis in self._axes
        ]
        self._status_publisher = self.create_publisher(LoopStatus, topics.LOOP_STATUS, LATCHED)
        self._clock_publisher = None
        if self._params.flag('publish_clock'):
            self._clock_publisher = self.create_publisher(Clock, '/clock', LOOP)
        for place, axis in enumerate(self._axes):
            topic = topics.of_axis(topics.VOLTAGE_COMMAND, axis)
            commands = self.create_subscription(
                VoltageCommand, topic, partial(self._on_command, place), LOOP, raw=True
            )
            slew_topic = topics.slew_of(commands.topic_name)
            on_slew = partial(self._on_slew, self._books[place])
            self.create_subscription(Float64, slew_topic, on_slew, LATCHED)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.create_service(LoadPreset, '~/load_preset', self._on_load_preset)
        self.create_service(InjectFault, '~/inject_fault', self._on_inject_fault)

    def _make_timers(self) -> None:
        self._status_tick, self._status_time = 0, time.monotonic()
        if self._lock_step:
            self._publish_status()  # informs an excitation that the node waits for commands
        wall_timer(self, 1.0, self._watch)
        self._pacer: Timer | None = None
        if not self._lock_step:
            self._restart_pace()

    def _restart_pace(self) -> None:
        if self._pacer is not None:
            self.destroy_timer(self._pacer)
        self._pace.restart(time.monotonic(), self._tick)
        period = max(0.5 * self._pace.interval, SHORTEST_WAIT)
        self._pacer = wall_timer(self, period, self._run_due)

    # --- ticks ---------------------------------------------------------------------------------

    def _on_command(self, place: int, payload: bytes) -> None:
        head, (sample, voltage) = COMMAND.decode(payload)
        if not self._lock_step:
            if self._books[place].arrive(sample, voltage, self._tick):
                self._check_stamp(head, sample)
        elif sample <= self._newest_command:
            self._publish_next_tick()
        else:
            self._step_with(place, head, sample, voltage)

    def _on_slew(self, book: CommandQueue, message: Float64) -> None:
        """Apply the slew rate limit of the commanding node [V/s], also to a late command."""
        if not book.limit(message.data):
            self.get_logger().error(
                f'{message.data:g} V/s is no slew limit: the one before stays in force',
                throttle_duration_sec=5.0,
            )

    def _check_stamp(self, head: bytes, sample: int) -> None:
        """Count time stamps that are inconsistent with the sample numbers.

        They have no other use.
        """
        self._stamps.true_time(sample, nanoseconds_of_head(head))
        self._counts['stamp_jumps'] = self._stamps.jumps

    def _publish_next_tick(self) -> None:
        """Publish the next tick for a client that repeats a command because it missed the state.

        The state itself is not repeated, because it would occur twice in every record.
        """
        self._counts['doubled'] += 1
        self._publish_status()

    def _step_with(self, place: int, head: bytes, sample: int, voltage: float) -> None:
        if sample != self._tick:
            self._counts['doubled' if sample < self._tick else 'missed'] += 1
            if sample > self._tick:
                self.get_logger().error(
                    f'command {sample} arrived where {self._tick} was expected: a link of the '
                    'chain lost a message; restart the excitation',
                    throttle_duration_sec=5.0,
                )
            return
        if sample == 0 and not self._listened_to():
            return  # the excitation repeats the command
        self._given[place] = voltage
        if len(self._given) < len(self._books):
            return  # one tick of all axes
        self._newest_command = sample
        self._waiting_since, self._warned = time.monotonic(), False
        accepted = [book.accept(self._given.pop(i)) for i, book in enumerate(self._books)]
        refused = not all(accepted)
        for book in self._books:
            book.follow(1.0 / self._rate)
        if refused and not self._refuses:
            self._publish_status()  # at once, so that the commanding node need not wait
        self._refuses = refused
        self._advance()
        self._check_stamp(head, sample)

    def _listened_to(self) -> bool:
        count = self._params.integer('wait_for')
        return all(each.get_subscription_count() >= count for each in self._state_publishers)

    def _run_due(self) -> None:
        due = self._pace.due(time.monotonic()) - self._tick
        self._counts['overruns'] += max(0, min(due, CATCH_UP) - 1)
        for _ in range(min(due, CATCH_UP)):
            timeout = self._params.number('command_timeout')
            for book in self._books:
                book.hold(self._tick, 1.0 / self._rate, timeout)
            self._advance()

    def _exchange(self, voltages: list[float]) -> list[float]:
        """Return the readings of all axes [m], then hold `voltages` [V]."""
        if isinstance(self._plant, AxesPlant):
            return self._plant.exchange(voltages)
        return [self._plant.exchange(voltages[0])]

    def _advance(self) -> None:
        voltages = [book.voltage for book in self._books]
        read = self._exchange(voltages)
        sec, nanosec = divmod(tick_nanoseconds(self._tick, self._rate), NANOSECONDS)
        head, tick = head_of(sec, nanosec), self._tick
        self._tick += 1
        for publisher, *pair in zip(self._state_publishers, voltages, read, strict=True):
            publisher.publish(head + STATE.pack(tick, *pair))
        if self._clock_publisher is not None:
            clock = Clock()
            clock.clock.sec, clock.clock.nanosec = sec, nanosec
            self._clock_publisher.publish(clock)

    # --- monitoring ----------------------------------------------------------------------------

    def _watch(self) -> None:
        deadline = self._params.number('lock_step_deadline')
        if self._lock_step and self._waiting_since is not None:
            waited = min(time.monotonic() - self._waiting_since, self._neighbours.silence())
            if waited > deadline and not self._warned:
                self._warned = True
                self.get_logger().warning(
                    f'no command for tick {self._tick} within {deadline:g} s: the experiment is '
                    'over, or a link of the chain died and must be started again'
                )
        self._publish_status()

    def _judge(self) -> Health:
        waited = 0.0
        if self._lock_step and self._waiting_since is not None:
            silent = min(time.monotonic() - self._waiting_since, self._neighbours.silence())
            waited = silent if silent > self._params.number('lock_step_deadline') else 0.0
        remark = self._plant.idle_effects
        return self._health.judge(self._books, self._tick, self._plant.fault, waited, remark)

    def _range(self) -> tuple[float, float]:
        """Return the lowest and the highest command that all axes accept [V]."""
        return max(book.low for book in self._books), min(book.high for book in self._books)

    def _publish_status(self) -> None:
        now = time.monotonic()
        counts = dict(self._counts)
        low, high = self._range()
        status = LoopStatus(sample=self._tick, low=low, high=high)
        for name in ('late', 'missed', 'refused', 'doubled'):
            setattr(status, name, counts.pop(name))
        status.names, status.counts = list(counts), list(counts.values())
        if now > self._status_time:
            status.rate = (self._tick - self._status_tick) / (now - self._status_time)
        self._status_tick, self._status_time = self._tick, now
        self._status_publisher.publish(status)

    # --- parameters and services ---------------------------------------------------------------

    def _refuse(self, changes: dict[str, Value]) -> str:
        try:
            if 'preset' in changes:
                plant = _plant({**self._params.values, **changes})
                if self._axes and self._axes != _numbers(plant):
                    return 'preset: it has other axes; start the simulator with it'
        except SimulationError as error:
            return str(error)
        return ''

    def _apply(self, changes: dict[str, Value]) -> None:
        self._set_books()
        # A saved parameter file contains the preset as well; it must not reset the other values.
        if changes.get('preset', self._preset) != self._preset:
            self._become_preset()
        if 'speed_factor' in changes:
            self._pace.speed_factor = self._params.number('speed_factor')
            if not self._lock_step:
                self._restart_pace()

    def _set_books(self) -> None:
        for book in self._books:
            book.safe_voltage = self._params.number('safe_voltage')
            book.ramp = self._params.number('ramp')
            book.slew = self._params.number('command_slew')
            book.timeout = self._params.number('command_timeout') * self._rate

    def _take_ranges(self) -> None:
        for book, plant in zip(self._books, axes_of(self._plant), strict=True):
            book.low, book.high = plant.command_range

    def _become_preset(self) -> None:
        """Load the preset of the parameter, at rest; its values become the parameters."""
        self._preset = self._params.text('preset')
        self._plant = _plant(self._params.values)
        self._rest()
        self._params.overwrite(dict(self._plant.parameters))
        self._take_ranges()

    def _rest(self) -> None:
        for book in self._books:
            book.rest()

    def _refuse_plant(self, changes: dict[str, Value]) -> str:
        try:
            self._plant.check(_for_plant(changes, self._plant))
        except SimulationError as error:
            return str(error)
        return ''

    def _apply_plant(self, changes: dict[str, Value]) -> None:
        self._plant.set_parameters(_for_plant(changes, self._plant))
        if remark := self._plant.idle_effects:
            self.get_logger().warning(remark)
        before = [(book.low, book.high) for book in self._books]
        self._take_ranges()
        if before != [(book.low, book.high) for book in self._books]:
            self._publish_status()  # the commanding node checks the range first

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._plant.reset()
        self._rest()
        response.success, response.message = True, f'at rest from tick {self._tick}'
        return response

    def _on_load_preset(
        self, request: LoadPreset.Request, response: LoadPreset.Response
    ) -> LoadPreset.Response:
        self._preset = ''
        reason = self._params.overwrite({'preset': request.preset})
        self._preset = self._params.text('preset')
        response.success = not reason
        response.message = reason or f'{request.preset} loaded, at rest'
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


def _plant(values: Mapping[str, Value]) -> Plant | AxesPlant:
    rate, seed = values['rate'], values['seed']
    assert isinstance(rate, float)
    assert isinstance(seed, int)
    return plant_of(str(values['preset']), rate, seed)


def _numbers(plant: Plant | AxesPlant) -> range:
    """Return the numbers of the axes, of which 0 is the only one."""
    return range(1, plant.axes + 1) if isinstance(plant, AxesPlant) else range(1)


def _for_plant(values: dict[str, Value], plant: Plant | AxesPlant) -> dict[str, Value]:
    known = plant.parameters
    return {name: value for name, value in values.items() if name in known}


def main() -> None:
    """Run the simulator as a process."""
    sys.exit(run_node(Simulator))
