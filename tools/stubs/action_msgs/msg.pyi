# Written by tools/write_stubs.py from the interface files.
from collections.abc import Sequence
from typing import ClassVar
import builtin_interfaces.msg
import unique_identifier_msgs.msg

class GoalInfo:
    goal_id: unique_identifier_msgs.msg.UUID
    stamp: builtin_interfaces.msg.Time
    def __init__(
        self,
        *,
        goal_id: unique_identifier_msgs.msg.UUID = ...,
        stamp: builtin_interfaces.msg.Time = ...,
    ) -> None: ...

class GoalStatus:
    STATUS_UNKNOWN: ClassVar[int]
    STATUS_ACCEPTED: ClassVar[int]
    STATUS_EXECUTING: ClassVar[int]
    STATUS_CANCELING: ClassVar[int]
    STATUS_SUCCEEDED: ClassVar[int]
    STATUS_CANCELED: ClassVar[int]
    STATUS_ABORTED: ClassVar[int]
    goal_info: GoalInfo
    status: int
    def __init__(
        self,
        *,
        goal_info: GoalInfo = ...,
        status: int = ...,
    ) -> None: ...

class GoalStatusArray:
    status_list: Sequence[GoalStatus]
    def __init__(
        self,
        *,
        status_list: Sequence[GoalStatus] = ...,
    ) -> None: ...
