# Written by tools/write_stubs.py from the interface files.
from array import array
from collections.abc import Sequence
from typing import ClassVar
import builtin_interfaces.msg

class FloatingPointRange:
    from_value: float
    to_value: float
    step: float
    def __init__(
        self,
        *,
        from_value: float = ...,
        to_value: float = ...,
        step: float = ...,
    ) -> None: ...

class IntegerRange:
    from_value: int
    to_value: int
    step: int
    def __init__(
        self,
        *,
        from_value: int = ...,
        to_value: int = ...,
        step: int = ...,
    ) -> None: ...

class ListParametersResult:
    @property
    def names(self) -> Sequence[str]: ...
    @names.setter
    def names(self, value: list[str] | tuple[str, ...]) -> None: ...
    @property
    def prefixes(self) -> Sequence[str]: ...
    @prefixes.setter
    def prefixes(self, value: list[str] | tuple[str, ...]) -> None: ...
    def __init__(
        self,
        *,
        names: list[str] | tuple[str, ...] = ...,
        prefixes: list[str] | tuple[str, ...] = ...,
    ) -> None: ...

class Log:
    DEBUG: ClassVar[int]
    INFO: ClassVar[int]
    WARN: ClassVar[int]
    ERROR: ClassVar[int]
    FATAL: ClassVar[int]
    stamp: builtin_interfaces.msg.Time
    level: int
    name: str
    msg: str
    file: str
    function: str
    line: int
    def __init__(
        self,
        *,
        stamp: builtin_interfaces.msg.Time = ...,
        level: int = ...,
        name: str = ...,
        msg: str = ...,
        file: str = ...,
        function: str = ...,
        line: int = ...,
    ) -> None: ...

class LoggerLevel:
    LOG_LEVEL_UNKNOWN: ClassVar[int]
    LOG_LEVEL_DEBUG: ClassVar[int]
    LOG_LEVEL_INFO: ClassVar[int]
    LOG_LEVEL_WARN: ClassVar[int]
    LOG_LEVEL_ERROR: ClassVar[int]
    LOG_LEVEL_FATAL: ClassVar[int]
    name: str
    level: int
    def __init__(
        self,
        *,
        name: str = ...,
        level: int = ...,
    ) -> None: ...

class Parameter:
    name: str
    value: ParameterValue
    def __init__(
        self,
        *,
        name: str = ...,
        value: ParameterValue = ...,
    ) -> None: ...

class ParameterDescriptor:
    name: str
    type: int
    description: str
    additional_constraints: str
    read_only: bool
    dynamic_typing: bool
    floating_point_range: Sequence[FloatingPointRange]
    integer_range: Sequence[IntegerRange]
    def __init__(
        self,
        *,
        name: str = ...,
        type: int = ...,
        description: str = ...,
        additional_constraints: str = ...,
        read_only: bool = ...,
        dynamic_typing: bool = ...,
        floating_point_range: Sequence[FloatingPointRange] = ...,
        integer_range: Sequence[IntegerRange] = ...,
    ) -> None: ...

class ParameterEvent:
    stamp: builtin_interfaces.msg.Time
    node: str
    new_parameters: Sequence[Parameter]
    changed_parameters: Sequence[Parameter]
    deleted_parameters: Sequence[Parameter]
    def __init__(
        self,
        *,
        stamp: builtin_interfaces.msg.Time = ...,
        node: str = ...,
        new_parameters: Sequence[Parameter] = ...,
        changed_parameters: Sequence[Parameter] = ...,
        deleted_parameters: Sequence[Parameter] = ...,
    ) -> None: ...

class ParameterEventDescriptors:
    new_parameters: Sequence[ParameterDescriptor]
    changed_parameters: Sequence[ParameterDescriptor]
    deleted_parameters: Sequence[ParameterDescriptor]
    def __init__(
        self,
        *,
        new_parameters: Sequence[ParameterDescriptor] = ...,
        changed_parameters: Sequence[ParameterDescriptor] = ...,
        deleted_parameters: Sequence[ParameterDescriptor] = ...,
    ) -> None: ...

class ParameterType:
    PARAMETER_NOT_SET: ClassVar[int]
    PARAMETER_BOOL: ClassVar[int]
    PARAMETER_INTEGER: ClassVar[int]
    PARAMETER_DOUBLE: ClassVar[int]
    PARAMETER_STRING: ClassVar[int]
    PARAMETER_BYTE_ARRAY: ClassVar[int]
    PARAMETER_BOOL_ARRAY: ClassVar[int]
    PARAMETER_INTEGER_ARRAY: ClassVar[int]
    PARAMETER_DOUBLE_ARRAY: ClassVar[int]
    PARAMETER_STRING_ARRAY: ClassVar[int]

class ParameterValue:
    type: int
    bool_value: bool
    integer_value: int
    double_value: float
    string_value: str
    byte_array_value: Sequence[bytes]
    bool_array_value: Sequence[bool]
    @property
    def integer_array_value(self) -> array[int]: ...
    @integer_array_value.setter
    def integer_array_value(self, value: Sequence[int]) -> None: ...
    @property
    def double_array_value(self) -> array[float]: ...
    @double_array_value.setter
    def double_array_value(self, value: Sequence[float]) -> None: ...
    @property
    def string_array_value(self) -> Sequence[str]: ...
    @string_array_value.setter
    def string_array_value(self, value: list[str] | tuple[str, ...]) -> None: ...
    def __init__(
        self,
        *,
        type: int = ...,
        bool_value: bool = ...,
        integer_value: int = ...,
        double_value: float = ...,
        string_value: str = ...,
        byte_array_value: Sequence[bytes] = ...,
        bool_array_value: Sequence[bool] = ...,
        integer_array_value: Sequence[int] = ...,
        double_array_value: Sequence[float] = ...,
        string_array_value: list[str] | tuple[str, ...] = ...,
    ) -> None: ...

class SetLoggerLevelsResult:
    successful: bool
    reason: str
    def __init__(
        self,
        *,
        successful: bool = ...,
        reason: str = ...,
    ) -> None: ...

class SetParametersResult:
    successful: bool
    reason: str
    def __init__(
        self,
        *,
        successful: bool = ...,
        reason: str = ...,
    ) -> None: ...
