# Written by tools/write_stubs.py from the interface files.
from array import array
from collections.abc import Sequence
from typing import ClassVar
import rcl_interfaces.msg

class DescribeParameters:
    class Request:
        @property
        def names(self) -> Sequence[str]: ...
        @names.setter
        def names(self, value: list[str] | tuple[str, ...]) -> None: ...
        def __init__(
            self,
            *,
            names: list[str] | tuple[str, ...] = ...,
        ) -> None: ...

    class Response:
        descriptors: Sequence[rcl_interfaces.msg.ParameterDescriptor]
        def __init__(
            self,
            *,
            descriptors: Sequence[rcl_interfaces.msg.ParameterDescriptor] = ...,
        ) -> None: ...

class GetLoggerLevels:
    class Request:
        @property
        def names(self) -> Sequence[str]: ...
        @names.setter
        def names(self, value: list[str] | tuple[str, ...]) -> None: ...
        def __init__(
            self,
            *,
            names: list[str] | tuple[str, ...] = ...,
        ) -> None: ...

    class Response:
        levels: Sequence[rcl_interfaces.msg.LoggerLevel]
        def __init__(
            self,
            *,
            levels: Sequence[rcl_interfaces.msg.LoggerLevel] = ...,
        ) -> None: ...

class GetParameterTypes:
    class Request:
        @property
        def names(self) -> Sequence[str]: ...
        @names.setter
        def names(self, value: list[str] | tuple[str, ...]) -> None: ...
        def __init__(
            self,
            *,
            names: list[str] | tuple[str, ...] = ...,
        ) -> None: ...

    class Response:
        @property
        def types(self) -> array[int]: ...
        @types.setter
        def types(self, value: Sequence[int]) -> None: ...
        def __init__(
            self,
            *,
            types: Sequence[int] = ...,
        ) -> None: ...

class GetParameters:
    class Request:
        @property
        def names(self) -> Sequence[str]: ...
        @names.setter
        def names(self, value: list[str] | tuple[str, ...]) -> None: ...
        def __init__(
            self,
            *,
            names: list[str] | tuple[str, ...] = ...,
        ) -> None: ...

    class Response:
        values: Sequence[rcl_interfaces.msg.ParameterValue]
        def __init__(
            self,
            *,
            values: Sequence[rcl_interfaces.msg.ParameterValue] = ...,
        ) -> None: ...

class ListParameters:
    class Request:
        DEPTH_RECURSIVE: ClassVar[int]
        @property
        def prefixes(self) -> Sequence[str]: ...
        @prefixes.setter
        def prefixes(self, value: list[str] | tuple[str, ...]) -> None: ...
        depth: int
        def __init__(
            self,
            *,
            prefixes: list[str] | tuple[str, ...] = ...,
            depth: int = ...,
        ) -> None: ...

    class Response:
        result: rcl_interfaces.msg.ListParametersResult
        def __init__(
            self,
            *,
            result: rcl_interfaces.msg.ListParametersResult = ...,
        ) -> None: ...

class SetLoggerLevels:
    class Request:
        levels: Sequence[rcl_interfaces.msg.LoggerLevel]
        def __init__(
            self,
            *,
            levels: Sequence[rcl_interfaces.msg.LoggerLevel] = ...,
        ) -> None: ...

    class Response:
        results: Sequence[rcl_interfaces.msg.SetLoggerLevelsResult]
        def __init__(
            self,
            *,
            results: Sequence[rcl_interfaces.msg.SetLoggerLevelsResult] = ...,
        ) -> None: ...

class SetParameters:
    class Request:
        parameters: Sequence[rcl_interfaces.msg.Parameter]
        def __init__(
            self,
            *,
            parameters: Sequence[rcl_interfaces.msg.Parameter] = ...,
        ) -> None: ...

    class Response:
        results: Sequence[rcl_interfaces.msg.SetParametersResult]
        def __init__(
            self,
            *,
            results: Sequence[rcl_interfaces.msg.SetParametersResult] = ...,
        ) -> None: ...

class SetParametersAtomically:
    class Request:
        parameters: Sequence[rcl_interfaces.msg.Parameter]
        def __init__(
            self,
            *,
            parameters: Sequence[rcl_interfaces.msg.Parameter] = ...,
        ) -> None: ...

    class Response:
        result: rcl_interfaces.msg.SetParametersResult
        def __init__(
            self,
            *,
            result: rcl_interfaces.msg.SetParametersResult = ...,
        ) -> None: ...
