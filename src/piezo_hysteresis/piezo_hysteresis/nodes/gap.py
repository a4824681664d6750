"""Simulates the model in parallel with the actuator and publishes the gap."""

from __future__ import annotations

import sys
from math import isfinite

from std_srvs.srv import Trigger

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.node_sheet import CounterWatch, Finding, Health, Level, judge
from piezo_hysteresis.common.parameter_table import Value
from piezo_hysteresis.common.stamps import SequenceFilter, StampValidator, nanoseconds_of
from piezo_hysteresis.discovery.gap_monitor import GapMonitor, GapReport
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.nodes.messages import requested_model
from piezo_hysteresis.nodes.model_parameters import ModelParameters
from piezo_hysteresis.parameters.node_tables import GAP_MONITOR
from piezo_hysteresis.ros.guarded import GuardedNode
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.qos import LATCHED, LOOP
from piezo_hysteresis.ros.readiness import Diagnostics
from piezo_hysteresis.ros.running import run_node
from piezo_hysteresis.ros.starting import refuse_start
from piezo_interfaces.msg import ActuatorState, Gap
from piezo_interfaces.srv import LoadModel

SENTENCES: dict[str, Finding] = {
    'refused': (Level.WARN, 'the sensor answers what is not a number'),
    'missed': (Level.WARN, 'ticks are missing: the model has not seen their voltage'),
    'strays': (Level.WARN, 'ticks are numbered far from the rest: is there a second actuator?'),
    'stamp_jumps': (Level.WARN, 'time stamps of ticks jump: the numbers of the samples hold'),
    'reordered': (Level.WARN, 'ticks come out of order: is there a second actuator?'),
}


class GapMonitorNode(GuardedNode):
    """Compares every tick with the model and publishes the gap window by window."""

    def __init__(self) -> None:
        super().__init__('gap_monitor')
        Diagnostics(self, self._judge)
        self._intake = SequenceFilter()
        self._refused = 0
        self._report: GapReport | None = None
        self._watch = CounterWatch(SENTENCES)
        self._monitor: GapMonitor | None = None
        self._loaded: ModelFile | None = None
        self._params = NodeParameters(self, GAP_MONITOR)
        self._params.serve(self._apply)
        self._stamps = StampValidator(1.0 / self._params.number('rate'))
        self._model_parameters = ModelParameters(self, self._params, self._take)
        self._message = Gap()
        self._publisher = self.create_publisher(Gap, topics.GAP, LATCHED)
        self.create_subscription(ActuatorState, topics.STATE, self._on_state, LOOP)
        self.create_service(LoadModel, '~/load_model', self._on_load_model)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self._load_at_start(self._params.text('model_file'))

    def _load_at_start(self, path: str) -> None:
        try:
            if path:
                self._model_parameters.load(ModelFile.load(path))
            self._model_parameters.follow()
        except PiezoError as error:
            refuse_start(error)

    def _take(self, loaded: ModelFile) -> None:
        self._loaded = loaded
        self._new_monitor()

    def _new_monitor(self) -> None:
        if self._loaded is None:
            return
        rate = self._params.number('rate')
        window = max(8, round(self._params.number('window') * rate))
        floor = self._params.number('noise_floor')
        self._monitor = GapMonitor(self._loaded, 1.0 / rate, floor, window)
        self._monitor.warm_up()
        self._report = None
        chain = ', '.join(self._loaded.model.block_names)
        self.get_logger().info(f'comparing with {chain}, floor {self._monitor.floor:.3g} m')

    def _apply(self, changes: dict[str, Value]) -> None:
        if not changes.keys().isdisjoint(('noise_floor', 'window')):
            self._new_monitor()

    def _on_state(self, message: ActuatorState) -> None:
        newest = self._intake.newest
        if not self._intake.take(message.sample):
            return
        self._stamps.true_time(message.sample, nanoseconds_of(message.header.stamp))
        if message.sample < newest and self._monitor is not None:
            self._monitor.reset()
        if not (isfinite(message.voltage) and isfinite(message.displacement)):
            self._refused += 1
            return
        if self._monitor is None:
            return
        report = self._monitor.add(message.voltage, message.displacement)
        if report is not None:
            self._report = report
            self._publish(message, report)

    def _publish(self, state: ActuatorState, report: GapReport) -> None:
        assert self._monitor is not None
        message = self._message
        message.header = state.header
        message.sample = state.sample
        message.rms = report.rms
        message.noise_floor = self._monitor.floor
        message.floors = report.floors
        message.frequency = report.frequency
        message.orders = report.orders
        message.harmonics = report.sizes
        message.beyond_floor = report.beyond_floor
        message.family = report.family
        self._publisher.publish(message)

    def _judge(self) -> Health:
        report = self._report
        counts = {
            'refused': self._refused,
            'stamp_jumps': self._stamps.jumps,
            **self._intake.counters(),
        }
        findings = self._watch.findings(counts)
        if self._monitor is None:
            return judge(findings, 'no model is loaded: call ~/load_model', counts)
        if report is None:
            return judge(findings, 'waits for the first window', counts)
        summary = report.words
        if report.beyond_floor and report.share >= self._params.number('advise_from'):
            findings.append((Level.WARN, f'{summary}; {report.advice}'))
        return judge(
            findings, summary, {'gap_rms_m': report.rms, 'floors': report.floors, **counts}
        )

    def _on_load_model(
        self, request: LoadModel.Request, response: LoadModel.Response
    ) -> LoadModel.Response:
        try:
            loaded = requested_model(request, self._params.text('model_folder'))
            self._model_parameters.load(loaded)
            response.success, response.message = True, f'comparing with {loaded.model.name} now'
        except PiezoError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._monitor is not None:
            self._monitor.reset()
        response.success, response.message = True, 'the model is at rest'
        return response


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(GapMonitorNode))
