"""Drives the loop: publishes the reference, or an open-loop voltage, tick by tick."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.publisher import Publisher
from rclpy.task import Future
from std_msgs.msg import Float64

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.node_sheet import Health
from piezo_hysteresis.common.parameter_table import Value
from piezo_hysteresis.common.stamps import NANOSECONDS, ActuatorClock, SequenceFilter
from piezo_hysteresis.compensation.link import Measured, ReferencePoint
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.excitation.sweep_server import SweepServer, missing_subscribers
from piezo_hysteresis.nodes.messages import measured_of, point_of, reference_bytes, voltage_bytes
from piezo_hysteresis.parameters.node_tables import EXCITATION
from piezo_hysteresis.ros.cdr_header import head_of, nanoseconds_of_head
from piezo_hysteresis.ros.guarded import GuardedNode
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.qos import LATCHED, LOOP
from piezo_hysteresis.ros.readiness import Diagnostics, Neighbours
from piezo_hysteresis.ros.running import run_node, wall_timer
from piezo_hysteresis.runtime.excitation_plan import (
    SILENCE,
    Doing,
    ExcitationHealth,
    Experiment,
    SteadyCommand,
    extremes,
)
from piezo_hysteresis.runtime.sweep_plan import NOT_RUNNING, parse_options, waveform_of
from piezo_hysteresis.waveforms import Waveform
from piezo_interfaces.msg import ActuatorState, LoopStatus, Reference, VoltageCommand

# The last message is repeated after this time without a state [s].
REPEAT_AFTER = 0.2

# Slew limit that limits nothing [V/s]: published to lift a limit of the node itself.
UNLIMITED = 1e12

# Parameters that shape the waveform.
_SHAPE = (
    'waveform',
    'waveform_options',
    'frequency',
    'reference.amplitude',
    'reference.offset',
    'voltage.amplitude',
    'voltage.offset',
    'ramp',
)

# Exit code if the actuator or the chain stopped publishing.
NO_ANSWER = 3

# Takes the reference of a tick: head and point, and the message that holds both.
TakeReference = Callable[[bytes, ReferencePoint, bytes], None]


class Excitation(GuardedNode):
    """Responds to the state of tick k with the reference (or voltage) of tick k + 1.

    It thus follows the clock of the actuator, in lock-step or real time.

    Parameters
    ----------
    wired : bool
        Whether states come from the topic; False if the same process calls `take_state`.
    axis : int
        Number of its axis where there are several.
    """

    def __init__(self, *, wired: bool = True, axis: int = 0) -> None:
        super().__init__(f'excitation_{axis}' if axis else 'excitation')
        topic = partial(topics.of_axis, axis=axis)
        self.stop = Future()
        self.exit_code = 0
        self._experiment: Experiment | None = None
        self._emitted = -1
        self._newest_state = -1
        self._asked_again = False  # since the newest state
        # the tick for which the actuator waited at its newest status
        self._due = 0
        self._restarts = 0
        self._given_up = ''
        self._ready = False
        self._last: tuple[Publisher, bytes] | None = None
        self._deliver: TakeReference | None = None
        self._received = time.monotonic()
        self._params = NodeParameters(self, EXCITATION)
        self._rate = self._params.number('rate')
        # A single state with index 0 is ignored: a restart is reported in the status, or
        # confirmed.
        self._intake = SequenceFilter(restarts=False)
        self._times = ActuatorClock(self._rate)
        self._steady = SteadyCommand(self._rate)
        self._reference_publisher = self.create_publisher(Reference, topic(topics.REFERENCE), LOOP)
        self._voltage_publisher = self.create_publisher(
            VoltageCommand, topic(topics.VOLTAGE_COMMAND), LOOP
        )
        slew_topic = topics.slew_of(self._voltage_publisher.topic_name)
        self._slew_publisher = self.create_publisher(Float64, slew_topic, LATCHED)
        self._published_slew, self._chain_slew = 0.0, math.inf
        self.create_subscription(Float64, slew_topic, self._on_slew, LATCHED)
        if wired:
            self.create_subscription(
                ActuatorState, topic(topics.STATE), self._on_state, LOOP, raw=True
            )
        self.create_subscription(LoopStatus, topics.LOOP_STATUS, self._on_status, LATCHED)
        self._neighbours = Neighbours(self)
        self._sweeps = SweepServer(
            self,
            self._params,
            self._voltage_publisher,
            self._begin,
            self._answer,
            self._times.edge_at,
            axis,
        )
        self._params.serve(self._apply, self._refuse)
        self._health = ExcitationHealth()
        Diagnostics(self, self._judge)
        wall_timer(self, 0.5, self._watch)
        wall_timer(self, REPEAT_AFTER, self._repeat)

    def close(self) -> None:
        """Finish the bag of a running sweep."""
        self._sweeps.close()

    # --- ticks ---------------------------------------------------------------------------------

    def _on_status(self, message: LoopStatus) -> None:
        # States the tick for which the actuator waits without a state to respond to. The message
        # may be older than received states, so only a new start indicates a restart; it may also
        # be newer than states that are still on their way to a node that is behind: an answer to
        # those is too late. They are lost only if the node has asked again in vain.
        if message.sample == 0 < self._newest_state:
            self._intake.newest = -1
            self._follow_restart(-1)
        self._sweeps.note_range(message.low, message.high)
        self._sweeps.note_refused(message.refused, message.sample)
        self._due = message.sample
        ahead = message.sample > self._newest_state + 1
        if self._newest_state < 0 or (ahead and self._asked_again):
            self._newest_state = message.sample - 1
            self._ready = True
            self._emit(message.sample)

    @property
    def refers(self) -> bool:
        """Whether this node is the source of the reference."""
        return self._params.text('mode') == 'reference'

    def deliver_to(self, take: TakeReference) -> None:
        """Call `take` with every reference before it is published."""
        self._deliver = take

    def _on_state(self, payload: bytes) -> None:
        self.take_state(*measured_of(payload), payload)

    def take_state(self, head: bytes, measured: Measured, payload: bytes) -> None:
        """Respond to the state of one tick, received as `payload`."""
        sample, voltage = measured.sample, measured.voltage
        before = self._intake.newest
        if not self._intake.take(sample):
            return
        if sample < before:
            self._follow_restart(sample - 1)
        self._times.update(sample, nanoseconds_of_head(head))
        if sample <= self._newest_state:
            return
        self._newest_state, self._asked_again = sample, False
        self._steady.update(sample, voltage)
        self._sweeps.note_state(sample, voltage, payload)
        if not self._sweeps.waits:
            self._received = time.monotonic()
        self._emit(sample + 1)

    def _follow_restart(self, sample: int) -> None:
        """Restart: the actuator was restarted and has reached tick `sample`."""
        self.get_logger().warning('the actuator was restarted', throttle_duration_sec=5.0)
        self._restarts += 1
        self._newest_state = self._emitted = sample
        self._experiment = None
        self._last, self._asked_again, self._due = None, False, 0
        self._steady.reset()
        self._sweeps.follow_restart()

    def _begin(self) -> None:
        """Reply to the newest state, because the loop may wait for the reply."""
        self._received = time.monotonic()
        self._given_up = ''
        self._answer()

    def _answer(self) -> None:
        """Reply to the newest state, unless that is already done."""
        if self._newest_state >= 0 or self._ready:
            self._emit(self._newest_state + 1)

    def _emit(self, sample: int) -> None:
        if sample <= self._emitted or sample < self._due:
            return
        if self._sweeps.active:
            if self._sweeps.begins(sample):
                self._emit_sweep(sample)
        elif self._params.text('mode') != 'idle' and self._listened_to():
            self._emit_experiment(sample)

    def _listened_to(self) -> bool:
        """Return whether all subscribers that need the first tick are connected."""
        return self._emitted >= 0 or not self._missing_listeners()

    def _missing_listeners(self) -> str:
        """Return the missing subscribers before the first tick; empty if all are connected."""
        voltage = self._params.text('mode') == 'voltage'
        if self._deliver is not None and not voltage:
            return ''  # the controllers are in this process
        publisher = self._voltage_publisher if voltage else self._reference_publisher
        count = self._params.integer('wait_for')
        return missing_subscribers(publisher, publisher.topic_name, count)

    def _repeat(self) -> None:
        """Publish the last message again if the loop has stopped: it may have been lost."""
        if time.monotonic() - self._received < REPEAT_AFTER:
            return
        self._asked_again = True
        if self._last is None:
            self._answer()
            return
        publisher, payload = self._last
        if self._deliver is not None and publisher is self._reference_publisher:
            self._deliver(*point_of(payload), payload)
        publisher.publish(payload)

    def _emit_sweep(self, sample: int) -> None:
        late = self._steady.behind and self._sweeps.over(sample)
        voltage = 0.0 if late else self._sweeps.voltage(sample)
        if voltage is None:
            self._last = None
            return
        if self._last is None:
            self._received = time.monotonic()  # until now the wait was not for the actuator
        self._emitted = sample
        self._publish_voltage(sample, voltage)

    def _emit_experiment(self, sample: int) -> None:
        experiment = self._experiment
        if experiment is None:
            if reason := self._beyond_range({}):
                self._give_up(reason)
                return
            self.exit_code = 0
            experiment = self._experiment = self._new_experiment(sample)
        if experiment.over(sample):
            self._finish(sample)
            return
        self._emitted = sample
        if self._params.text('mode') == 'reference':
            self._emit_reference(experiment, sample)
        else:
            self._publish_voltage(sample, experiment.point(sample).displacement)

    def _emit_reference(self, experiment: Experiment, sample: int) -> None:
        head, point = self._head(sample), experiment.point(sample)
        payload = reference_bytes(head, point)
        if self._deliver is not None:
            self._deliver(head, point, payload)
        self._reference_publisher.publish(payload)
        self._last = (self._reference_publisher, payload)

    def _publish_voltage(self, sample: int, voltage: float) -> None:
        if self._last is None:
            self._drop_ended_chain()
        slew = min(self._params.number('slew') or UNLIMITED, self._chain_slew)
        is_new = self._last is None or slew != self._published_slew
        if is_new and (slew < UNLIMITED or self._published_slew):
            self._published_slew = slew
            self._slew_publisher.publish(Float64(data=slew))
        command = self._steady.next(sample, voltage, slew if slew < UNLIMITED else 0.0)
        payload = voltage_bytes(self._head(sample), sample, command)
        self._voltage_publisher.publish(payload)
        self._last = (self._voltage_publisher, payload)

    def _on_slew(self, message: Float64) -> None:
        """Note the limit of the voltage chain [V/s]: it stands for sweeps and mode voltage too."""
        if 0.0 < message.data < math.inf and message.data != self._published_slew:
            self._chain_slew = message.data

    def _drop_ended_chain(self) -> None:
        if self.count_publishers(self._slew_publisher.topic_name) <= 1:
            self._chain_slew = math.inf

    def _head(self, sample: int) -> bytes:
        return head_of(*divmod(self._times.time_of(sample), NANOSECONDS))

    def _finish(self, sample: int) -> None:
        self.get_logger().info(f'experiment over at tick {sample}')
        self._end()

    def _end(self) -> None:
        self._last = None
        self._params.overwrite({'mode': 'idle'})
        if self._params.flag('exit_when_done') and not self.stop.done():
            self.stop.set_result(True)

    # --- parameters ----------------------------------------------------------------------------

    def _new_experiment(self, sample: int) -> Experiment:
        duration = self._params.number('duration')
        return Experiment(self._waveform({}), sample, self._rate, round(duration * self._rate))

    def _waveform(self, changes: dict[str, Value]) -> Waveform:
        values: dict[str, Any] = {**self._params.values, **changes}
        kind = 'voltage' if values['mode'] == 'voltage' else 'reference'
        spec = {
            'frequency': values['frequency'],
            'amplitude': values[f'{kind}.amplitude'],
            'offset': values[f'{kind}.offset'],
            'ramp': values['ramp'],
        }
        if values['duration'] > 0:
            spec['duration'] = values['duration']
        options = parse_options(values['waveform_options'])
        return waveform_of(values['waveform'], spec, options, self._params.number('rate'))

    def _refuse(self, changes: dict[str, Value]) -> str:
        if changes.get('mode', 'idle') != 'idle' and self._sweeps.busy:
            return 'mode: a sweep is running; cancel it first'
        try:
            return self._beyond_range(changes)
        except PiezoError as error:
            return f'waveform: {error}'

    def _beyond_range(self, changes: dict[str, Value]) -> str:
        """Return why the actuator would refuse the voltage; empty if it accepts it."""
        waveform = self._waveform(changes)
        if changes.get('mode', self._params.text('mode')) != 'voltage':
            return ''
        return self._sweeps.beyond_range(*extremes(waveform, self._rate))

    def _apply(self, changes: dict[str, Value]) -> None:
        if 'mode' in changes:
            self._experiment = None
            self._begin()
        experiment = self._experiment
        if experiment is None:
            return
        if not changes.keys().isdisjoint(_SHAPE):
            ramp = self._params.number('ramp')
            experiment.change(self._waveform({}), self._emitted + 1, ramp)
        experiment.length = round(self._params.number('duration') * self._rate)

    def _watch(self) -> None:
        silent = time.monotonic() - self._received
        deadline = self._params.number('deadline')
        idle = self._params.text('mode') == 'idle' and not self._sweeps.active
        working = self._neighbours.working()
        if working and not idle and silent > SILENCE:
            self.get_logger().info(f'waits for {working}', throttle_duration_sec=10.0)
        if idle or min(silent, self._neighbours.silence()) < deadline:
            return
        if self._sweeps.waits:
            reason = (
                f'waited {silent:.0f} s for {self._sweeps.waits_for}: see that it runs, and run '
                'the sweep again'
            )
        else:
            reason = (
                f'no actuator/state for {silent:.0f} s after tick {self._newest_state}: '
                f'{NOT_RUNNING}'
            )
        self.go_safe(reason)

    def go_safe(self, reason: str) -> None:
        """Stop publishing, because a callback fails persistently: the actuator goes to safety."""
        if self._sweeps.active:
            self._sweeps.give_up(reason)
        self._give_up(reason)

    def _give_up(self, reason: str) -> None:
        self.get_logger().error(reason)
        self.exit_code = NO_ANSWER
        self._end()
        self._given_up = reason

    def _judge(self) -> Health:
        counts = {
            **self._intake.counters(),
            'stamp_jumps': self._times.jumps,
            'restarts': self._restarts,
            'limited': self._steady.limited,
            **self._sweeps.counters(),
        }
        return self._health.judge(self._doing(), counts, self._sweeps.last)

    def _doing(self) -> Doing:
        mode, sweeps = self._params.text('mode'), self._sweeps
        what, waits = sweeps.doing, sweeps.waits_for
        if not sweeps.active and mode != 'idle':
            shape, frequency = self._params.text('waveform'), self._params.number('frequency')
            what = f'{mode}: {shape}, {frequency:g} Hz'
            waits = '' if self._listened_to() else self._missing_listeners()
        silent = time.monotonic() - self._received
        if what and silent > SILENCE:
            waits = self._neighbours.working() or waits
        return Doing(what, waits, self._given_up, silent, self._newest_state)


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(Excitation))
