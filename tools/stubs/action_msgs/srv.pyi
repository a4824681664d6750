# Written by tools/write_stubs.py from the interface files.
from collections.abc import Sequence
from typing import ClassVar
import action_msgs.msg

class CancelGoal:
    class Request:
        goal_info: action_msgs.msg.GoalInfo
        def __init__(
            self,
            *,
            goal_info: action_msgs.msg.GoalInfo = ...,
        ) -> None: ...

    class Response:
        ERROR_NONE: ClassVar[int]
        ERROR_REJECTED: ClassVar[int]
        ERROR_UNKNOWN_GOAL_ID: ClassVar[int]
        ERROR_GOAL_TERMINATED: ClassVar[int]
        return_code: int
        goals_canceling: Sequence[action_msgs.msg.GoalInfo]
        def __init__(
            self,
            *,
            return_code: int = ...,
            goals_canceling: Sequence[action_msgs.msg.GoalInfo] = ...,
        ) -> None: ...
