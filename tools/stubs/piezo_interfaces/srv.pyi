# Written by tools/write_stubs.py from the interface files.

class InjectFault:
    class Request:
        fault: str
        duration: float
        def __init__(
            self,
            *,
            fault: str = ...,
            duration: float = ...,
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

class LoadModel:
    class Request:
        path: str
        yaml: str
        def __init__(
            self,
            *,
            path: str = ...,
            yaml: str = ...,
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

class LoadPreset:
    class Request:
        preset: str
        def __init__(
            self,
            *,
            preset: str = ...,
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

class SaveModel:
    class Request:
        path: str
        def __init__(
            self,
            *,
            path: str = ...,
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
