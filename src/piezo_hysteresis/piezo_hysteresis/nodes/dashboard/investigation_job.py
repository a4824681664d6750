"""The investigation that the page starts: goal, feedback and result."""

from __future__ import annotations

from pathlib import Path

from rclpy.node import Node

from piezo_hysteresis.dashboard.backend import InvestigationOrder
from piezo_hysteresis.dashboard.live_state import InvestigationState, Live
from piezo_hysteresis.nodes.dashboard.jobs import ActionJob, what_was_found
from piezo_interfaces.action import Investigate

INVESTIGATIONS = 'investigations'


class InvestigationJob(ActionJob):
    """An investigation of one actuator at a time."""

    def __init__(self, node: Node, live: Live, folder: Path) -> None:
        super().__init__(
            node, live, Investigate, 'investigate', 'discovery',
            lambda: live.investigation, lambda job: setattr(live, 'investigation', job),
        )  # fmt: skip
        self._page, self._folder = live, folder
        self.on_result = lambda result: what_was_found(result, folder)

    def run(self, order: InvestigationOrder) -> None:
        """Start an investigation: experiments on the actuator that find missing effects."""
        self._page.states = []
        goal = Investigate.Goal(
            low=order.low,
            high=order.high,
            slew=order.slew,
            budget=order.budget,
            out=str(self._folder.resolve() / INVESTIGATIONS / order.name),
            apply=True,
        )
        self.send(goal, self._progress)

    def _progress(self, feedback: Investigate.Feedback) -> str:
        if feedback.names:
            self._page.states = [*self._page.states, belief_of(feedback)]
        doing = {'judge': 'judges', 'run': 'runs', 'apply': 'uses what was found, runs'}
        word = doing.get(feedback.stage, 'looks what can be asked')
        return f'{word} {feedback.experiment}'.strip()


def belief_of(feedback: Investigate.Feedback) -> InvestigationState:
    """Return the content of a feedback message, for the page."""
    return InvestigationState(
        feedback.stage,
        feedback.number,
        feedback.experiment,
        feedback.why,
        feedback.answer,
        tuple(zip(feedback.names, feedback.chances, strict=True)),
        feedback.seconds,
    )
