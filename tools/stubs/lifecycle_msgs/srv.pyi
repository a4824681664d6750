# Written by tools/write_stubs.py from the interface files.
from collections.abc import Sequence
import lifecycle_msgs.msg

class ChangeState:
    class Request:
        transition: lifecycle_msgs.msg.Transition
        def __init__(
            self,
            *,
            transition: lifecycle_msgs.msg.Transition = ...,
        ) -> None: ...

    class Response:
        success: bool
        def __init__(
            self,
            *,
            success: bool = ...,
        ) -> None: ...

class GetAvailableStates:
    class Request: ...

    class Response:
        available_states: Sequence[lifecycle_msgs.msg.State]
        def __init__(
            self,
            *,
            available_states: Sequence[lifecycle_msgs.msg.State] = ...,
        ) -> None: ...

class GetAvailableTransitions:
    class Request: ...

    class Response:
        available_transitions: Sequence[lifecycle_msgs.msg.TransitionDescription]
        def __init__(
            self,
            *,
            available_transitions: Sequence[lifecycle_msgs.msg.TransitionDescription] = ...,
        ) -> None: ...

class GetState:
    class Request: ...

    class Response:
        current_state: lifecycle_msgs.msg.State
        def __init__(
            self,
            *,
            current_state: lifecycle_msgs.msg.State = ...,
        ) -> None: ...
