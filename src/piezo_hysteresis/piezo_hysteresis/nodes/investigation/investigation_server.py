"""The action ``investigate``: one goal at a time, in a thread, with feedback and cancel."""

from __future__ import annotations

import threading
from collections.abc import Callable
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.action import GoalResponse
from rclpy.task import Future

from piezo_hysteresis.common import topics
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.nodes.investigation.node_requests import Cancelled, Neighbourhood, Unanswered
from piezo_hysteresis.nodes.investigation.sweeper import Circumstances, Sweeper
from piezo_hysteresis.nodes.messages import inside
from piezo_hysteresis.process_setup import number_of_workers
from piezo_hysteresis.ros.guarded import Guarded, serve_action
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.qos import LATCHED
from piezo_interfaces.action import Investigate
from piezo_interfaces.msg import LoopStatus

if TYPE_CHECKING:
    from piezo_hysteresis.experiments.planned_experiment import PlannedExperiment
    from piezo_hysteresis.investigation.runner import InvestigationProgress, Result, Setup


class InvestigationServer:
    """Runs investigations for the discovery node."""

    def __init__(
        self,
        node: Guarded,
        parameters: NodeParameters,
        begin: Callable[[], str],
        log: Callable[[str], None],
        end: Callable[[str, bool], None],
    ) -> None:
        self._node, self._parameters = node, parameters
        self._begin, self._log, self._end = begin, log, end
        self._status = LoopStatus()
        self._closing = False
        self._sweeper = Sweeper(node, lambda: self._status.sample)
        self._neighbours = Neighbourhood(node)
        node.create_subscription(LoopStatus, topics.LOOP_STATUS, self._on_status, LATCHED)
        self._server = serve_action(node, Investigate, 'investigate', self._judge, self._execute)

    def _on_status(self, message: LoopStatus) -> None:
        self._status = message

    def _judge(self, goal: Investigate.Goal) -> GoalResponse:
        try:
            self._folder(goal)
            self._model(goal)
            if reason := self._begin():
                raise PiezoError(reason)
        except PiezoError as error:
            self._node.get_logger().error(f'investigation refused: {error}')
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _folder(self, goal: Investigate.Goal) -> Path:
        return inside(self._parameters.text('folder'), goal.out)

    def _model(self, goal: Investigate.Goal) -> ModelFile:
        if goal.model_yaml:
            return ModelFile.parse(goal.model_yaml)
        if goal.model:
            return ModelFile.load(inside(self._parameters.text('folder'), goal.model))
        own = self._parameters.text('model_file')
        if not own:
            raise PiezoError('give the model in use: model, or -p model_file:=FILE of the node')
        return ModelFile.load(own)

    async def _execute(self, goal: Any) -> Investigate.Result:
        done, result = Future(), Investigate.Result()
        thread = threading.Thread(
            target=self._work, args=(goal, result, done), name='investigation', daemon=True
        )
        thread.start()
        await done
        if result.success:
            goal.succeed()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        self._end(result.message, not result.success and not goal.is_cancel_requested)
        return result

    def _work(self, goal: Any, result: Investigate.Result, done: Future) -> None:
        try:
            self._investigate(goal, result)
        except Cancelled as cancelled:
            result.message = str(cancelled)
        except PiezoError as error:
            result.message = str(error)
            self._node.get_logger().error(str(error))
        except Exception as error:
            result.message = f'{type(error).__name__}: {error}; report it with the log of the node'
            if not self._closing:  # the node is ending and its resources are destroyed
                raise
        finally:
            if not self._closing:
                self._node.run_later(done.set_result, True)

    def _investigate(self, goal: Any, result: Investigate.Result) -> None:
        # Heavy imports stay out of the start of the node.
        from piezo_hysteresis.investigation.runner import conduct

        def stopped() -> bool:
            return self._closing or bool(goal.is_cancel_requested)

        def report(progress: InvestigationProgress) -> None:
            if stopped():
                raise Cancelled('cancelled; the actuator is at rest and the journal is kept')
            self._log(f'{progress.stage} {progress.experiment}'.strip())
            goal.publish_feedback(_feedback(progress))

        request: Investigate.Goal = goal.request
        setup = self._setup(request, stopped)
        before = str(self._neighbours.excitation('mode', stopped))
        usual = float(self._neighbours.excitation('slew', stopped))
        slew = min(setup.limits.slew, usual or inf)
        held = slew if isfinite(slew) else 0.0
        under = Circumstances(
            setup.rate,
            setup.limits.slew,
            lambda: self._neighbours.set_excitation(stopped, mode='idle', slew=held),
            stopped,
        )
        under.ready()
        try:
            found = conduct(
                self._folder(request),
                setup,
                _Actuator(self._sweeper, self._neighbours, under),
                report,
                workers=number_of_workers(request.workers),
                apply=request.apply,
            )
        finally:
            if not self._closing:
                self._return_to(before, usual)
        _fill(result, found, self._folder(request))

    def _return_to(self, mode: str, slew: float) -> None:
        try:
            self._neighbours.set_excitation(slew=slew, mode=mode)
        except Unanswered as error:  # the result, or the failure, is still reported
            self._node.get_logger().warning(f'the excitation stays idle: {error}')

    def _setup(self, request: Investigate.Goal, stopped: Callable[[], bool]) -> Setup:
        from piezo_hysteresis.experiments.planned_experiment import ExperimentLimits, granted_range
        from piezo_hysteresis.investigation.runner import Setup
        from piezo_hysteresis.investigation.session import Rules

        model = self._model(request)
        limits = ExperimentLimits(
            *granted_range(
                (request.low, request.high), (self._status.low, self._status.high), model
            ),
            request.slew or inf,
            request.frequency or ExperimentLimits.frequency,
            request.stroke or inf,
            request.heat or inf,
        )
        rules = Rules(
            budget=request.budget or Rules.budget,
            sure=request.sure or Rules.sure,
            seed=request.seed,
        )
        rate = float(self._neighbours.excitation('rate', stopped))
        return Setup(model, limits, rules, rate)

    def close(self) -> None:
        """Abort the investigation: the actuator comes to rest, and the journal is kept."""
        self._closing = True
        self._sweeper.close()


class _Actuator:
    """The live actuator, with the interface that an investigation uses."""

    def __init__(self, sweeper: Sweeper, neighbours: Neighbourhood, under: Circumstances) -> None:
        self._sweeper, self._neighbours, self._under = sweeper, neighbours, under

    def run(self, experiment: PlannedExperiment, bag: Path) -> bool:
        """Run an experiment and record it in a new bag; return whether it was at rest before."""
        return self._sweeper.run(experiment, bag, self._under)

    def apply(self, model: ModelFile) -> str:
        """Load a model into the running nodes."""
        return self._neighbours.use(model, self._under.stopped)


def _feedback(progress: InvestigationProgress) -> Investigate.Feedback:
    return Investigate.Feedback(
        stage=progress.stage,
        experiment=progress.experiment,
        why=progress.why,
        answer=progress.answer,
        number=progress.number,
        names=list(progress.chances),
        chances=list(progress.chances.values()),
        seconds=progress.spent,
        fraction=progress.fraction,
    )


def _fill(result: Investigate.Result, found: Result, folder: Path) -> None:
    from piezo_hysteresis.investigation.runner import FOUND

    result.success = True
    result.verdict = found.verdict
    result.effects = list(found.effects)
    result.probabilities = list(found.effects.values())
    result.stop = found.stop.reason
    result.experiments = found.experiments
    result.seconds = found.seconds
    result.before_in_floors = found.before_in_floors
    result.after_in_floors = found.after_in_floors
    result.report = str(folder / FOUND / 'report.html')
    result.message = found.words
