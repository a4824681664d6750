# Written by tools/write_stubs.py from the interface files.

class Empty:
    class Request: ...

    class Response: ...

class SetBool:
    class Request:
        data: bool
        def __init__(
            self,
            *,
            data: bool = ...,
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

class Trigger:
    class Request: ...

    class Response:
        success: bool
        message: str
        def __init__(
            self,
            *,
            success: bool = ...,
            message: str = ...,
        ) -> None: ...
