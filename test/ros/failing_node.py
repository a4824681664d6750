"""A node each of whose callbacks fails; `test_guarded.py` starts it."""

from __future__ import annotations

import sys
from typing import Any

from rclpy.action import GoalResponse
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from piezo_hysteresis.common.parameter_table import ParameterSpec, ParameterTable, Value
from piezo_hysteresis.ros.guarded import GuardedLifecycleNode, serve_action
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.running import run_node, wall_timer
from piezo_interfaces.action import RunSweep

TABLE = ParameterTable(
    (
        ParameterSpec('applied', 0.0, 'Fails where it is applied.'),
        ParameterSpec('refused', 0.0, 'Fails where it is judged.'),
    )
)


class Failing(GuardedLifecycleNode):
    """Publishes the number of failures so far, and what made it go to its safe state."""

    def __init__(self) -> None:
        super().__init__('failing')
        self.parameters = NodeParameters(self, TABLE)
        self.parameters.serve(self._apply, self._refuse)
        self.unused = self.create_lifecycle_publisher(Float64, 'unused', 1)
        self._safe = ''
        self.create_subscription(Float64, 'number', self._fail_with, 10)
        self.create_service(Trigger, '~/trigger', self._serve)
        self.create_service(Trigger, '~/safe', self._tell)
        serve_action(self, RunSweep, 'fails_early', self._raise, self._run)
        serve_action(self, RunSweep, 'fails_late', lambda _: GoalResponse.ACCEPT, self._run)
        wall_timer(self, 0.02, self._tick)
        wall_timer(self, 0.02, lambda: self.run_later(self._tick))

    def go_safe(self, reason: str) -> None:
        self._safe = reason

    def _tick(self) -> None:
        raise OSError(28, 'No space left on device')

    def _raise(self, _: object) -> Any:
        raise KeyError('nothing')

    async def _run(self, goal: Any) -> Any:
        raise ValueError('no such plan')

    def _fail_with(self, message: Float64) -> None:
        raise ZeroDivisionError(message.data)

    def _serve(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        raise RuntimeError('out of order')

    def _tell(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = self._safe
        return response

    def _refuse(self, changes: dict[str, Value]) -> str:
        return str(self.parameters['missing'] if changes.get('refused') else '')

    def _apply(self, changes: dict[str, Value]) -> None:
        if changes.get('applied'):
            raise ArithmeticError('cannot apply')


if __name__ == '__main__':
    sys.exit(run_node(Failing))
