"""The actions ``discover`` and ``investigate``, which find missing effects of a model."""

from __future__ import annotations

import sys
import threading
from typing import Any

from rclpy.action import GoalResponse
from rclpy.task import Future

from piezo_hysteresis.common.node_sheet import CounterWatch, Finding, Health, Level, judge
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import NAMES, ModelFile, named
from piezo_hysteresis.nodes.investigation.investigation_server import InvestigationServer
from piezo_hysteresis.nodes.investigation.node_requests import Cancelled
from piezo_hysteresis.nodes.messages import inside
from piezo_hysteresis.parameters.node_tables import DISCOVERY
from piezo_hysteresis.process_setup import number_of_workers
from piezo_hysteresis.reporting.folder import check_folder
from piezo_hysteresis.ros.guarded import GuardedNode, serve_action
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.readiness import Diagnostics
from piezo_hysteresis.ros.running import run_node
from piezo_interfaces.action import Discover

SENTENCES: dict[str, Finding] = {'refused': (Level.WARN, 'a discovery was refused: see its log')}


class DiscoveryNode(GuardedNode):
    """Runs one discovery or investigation at a time in a separate thread."""

    def __init__(self) -> None:
        super().__init__('discovery')
        self._params = NodeParameters(self, DISCOVERY)
        self._busy = self._closing = False
        self._at = ''
        self._problem = ''
        self._verdict = ''
        self._counts = {'runs': 0, 'failed': 0, 'refused': 0}
        self._watch = CounterWatch(SENTENCES)
        Diagnostics(self, self._health)
        self._server = serve_action(self, Discover, 'discover', self._judge, self._execute)
        self._investigations = InvestigationServer(
            self, self._params, self._begin, self._log, self._end
        )

    def close(self) -> None:
        """Bring an investigated actuator to rest; a discovery ends at its next progress report."""
        self._closing = True
        self._investigations.close()

    # --- for an investigation ------------------------------------------------------------------

    def _begin(self) -> str:
        if self._busy:
            self._counts['refused'] += 1
            return 'a discovery is running; wait for it'
        self._busy, self._at, self._problem = True, 'begins an investigation', ''
        self._counts['runs'] += 1
        return ''

    def _log(self, words: str) -> None:
        self._at = words

    def _end(self, words: str, failed: bool) -> None:
        self._busy = False
        self._counts['failed'] += failed
        self._verdict = '' if failed else words
        self._problem = f'the last investigation failed: {words}' if failed else ''

    # --- discoveries ---------------------------------------------------------------------------

    def _judge(self, goal: Discover.Goal) -> GoalResponse:
        try:
            check_folder(self._paths(goal)[2], 'discover')
            if self._busy:
                raise PiezoError('another discovery is running; wait for it')
        except PiezoError as error:
            self.get_logger().error(f'discovery refused: {error}')
            self._counts['refused'] += 1
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _paths(self, goal: Discover.Goal) -> tuple[list[str], str, str]:
        folder = self._params.text('folder')
        data = [str(inside(folder, path)) for path in goal.data]
        if not data:
            raise PiezoError('give at least one bag or CSV file as data')
        if _is_named(goal.baseline):
            return data, goal.baseline, str(inside(folder, goal.out))
        return data, str(inside(folder, goal.baseline)), str(inside(folder, goal.out))

    def _health(self) -> Health:
        findings = self._watch.findings(self._counts)
        if self._problem:
            findings.append((Level.ERROR, self._problem))
        fine = f'busy: {self._at}' if self._busy else 'idle'
        values = {'busy': self._busy, 'last_verdict': self._verdict, **self._counts}
        return judge(findings, fine, values)

    async def _execute(self, goal: Any) -> Discover.Result:
        self._busy = True
        request: Discover.Goal = goal.request
        self._at, self._problem = f'reads {", ".join(request.data)}', ''
        self._counts['runs'] += 1
        done = Future()
        result = Discover.Result()
        thread = threading.Thread(
            target=self._work, args=(goal, result, done), name='discovery', daemon=True
        )
        thread.start()
        await done
        self._busy = False
        if result.success:
            goal.succeed()
            self._verdict = result.message
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
            self._counts['failed'] += 1
            self._problem = f'the last discovery failed: {result.message}'
        return result

    def _work(self, goal: Any, result: Discover.Result, done: Future) -> None:
        try:
            self._discover(goal, result)
        except Cancelled as cancelled:
            result.message = str(cancelled)
        except PiezoError as error:
            result.message = str(error)
            self.get_logger().error(str(error))
        except Exception as error:
            result.message = f'{type(error).__name__}: {error}; report it with the log of the node'
            if not self._closing:  # the node is ending and its resources are destroyed
                raise
        finally:
            if not self._closing:
                self.run_later(done.set_result, True)

    def _discover(self, goal: Any, result: Discover.Result) -> None:
        # Heavy imports stay out of the start of the node.
        from piezo_hysteresis.discovery import discover
        from piezo_hysteresis.records import load
        from piezo_hysteresis.reporting.discovery_report import write_discovery

        request: Discover.Goal = goal.request
        data, name, out = self._paths(request)
        baseline = named(name) if _is_named(name) else ModelFile.load(name)

        def progress(fraction: float, words: str) -> None:
            if self._closing or goal.is_cancel_requested:
                raise Cancelled('cancelled; nothing was written')
            self._at = f'{words}, {fraction:.0%}'
            goal.publish_feedback(
                Discover.Feedback(stage='discover', detail=words, fraction=fraction)
            )

        found = discover(
            load(data),
            baseline,
            name=request.baseline,
            seed=request.seed,
            workers=number_of_workers(request.workers),
            progress=progress,
        )
        write_discovery(out, found, list(request.data))
        verdict = found.verdict
        result.success = True
        result.verdict = verdict.verdict
        result.effects = [effect.name for effect in verdict.effects]
        result.probabilities = [effect.probability for effect in verdict.effects]
        result.before_in_floors = verdict.held_out.before_in_floors
        result.after_in_floors = verdict.held_out.after_in_floors
        result.report = f'{out}/report.html'
        result.message = verdict.summary


def _is_named(baseline: str) -> bool:
    return baseline.split('+')[0] in NAMES


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(DiscoveryNode))
