# Written by tools/write_stubs.py from the interface files.
from collections.abc import Sequence
import diagnostic_msgs.msg

class AddDiagnostics:
    class Request:
        load_namespace: str
        def __init__(
            self,
            *,
            load_namespace: str = ...,
        ) -> None: ...

    class Response:
        success: bool
        message: str
        def __init__(
            self,
            *,
            success: bool = ...,
            message: str = ...,
        ) -> None: ...

class SelfTest:
    class Request: ...

    class Response:
        id: str
        passed: bytes
        status: Sequence[diagnostic_msgs.msg.DiagnosticStatus]
        def __init__(
            self,
            *,
            id: str = ...,
            passed: bytes = ...,
            status: Sequence[diagnostic_msgs.msg.DiagnosticStatus] = ...,
        ) -> None: ...
