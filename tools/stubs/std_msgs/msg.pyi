# Written by tools/write_stubs.py from the interface files.
from array import array
from collections.abc import Sequence
import builtin_interfaces.msg

class Bool:
    data: bool
    def __init__(
        self,
        *,
        data: bool = ...,
    ) -> None: ...

class Byte:
    data: bytes
    def __init__(
        self,
        *,
        data: bytes = ...,
    ) -> None: ...

class ByteMultiArray:
    layout: MultiArrayLayout
    data: Sequence[bytes]
    def __init__(
        self,
        *,
        layout: MultiArrayLayout = ...,
        data: Sequence[bytes] = ...,
    ) -> None: ...

class Char:
    data: int
    def __init__(
        self,
        *,
        data: int = ...,
    ) -> None: ...

class ColorRGBA:
    r: float
    g: float
    b: float
    a: float
    def __init__(
        self,
        *,
        r: float = ...,
        g: float = ...,
        b: float = ...,
        a: float = ...,
    ) -> None: ...

class Empty: ...

class Float32:
    data: float
    def __init__(
        self,
        *,
        data: float = ...,
    ) -> None: ...

class Float32MultiArray:
    layout: MultiArrayLayout
    @property
    def data(self) -> array[float]: ...
    @data.setter
    def data(self, value: Sequence[float]) -> None: ...
    def __init__(
        self,
        *,
        layout: MultiArrayLayout = ...,
        data: Sequence[float] = ...,
    ) -> None: ...

class Float64:
    data: float
    def __init__(
        self,
        *,
        data: float = ...,
    ) -> None: ...

class Float64MultiArray:
    layout: MultiArrayLayout
    @property
    def data(self) -> array[float]: ...
    @data.setter
    def data(self, value: Sequence[float]) -> None: ...
    def __init__(
        self,
        *,
        layout: MultiArrayLayout = ...,
        data: Sequence[float] = ...,
    ) -> None: ...

class Header:
    stamp: builtin_interfaces.msg.Time
    frame_id: str
    def __init__(
        self,
        *,
        stamp: builtin_interfaces.msg.Time = ...,
        frame_id: str = ...,
    ) -> None: ...

class Int16:
    data: int
    def __init__(
        self,
        *,
        data: int = ...,
    ) -> None: ...

class Int16MultiArray:
    layout: MultiArrayLayout
    @property
    def data(self) -> array[int]: ...
    @data.setter
    def data(self, value: Sequence[int]) -> None: ...
    def __init__(
        self,
        *,
        layout: MultiArrayLayout = ...,
        data: Sequence[int] = ...,
    ) -> None: ...

class Int32:
    data: int
    def __init__(
        self,
        *,
        data: int = ...,
    ) -> None: ...

class Int32MultiArray:
    layout: MultiArrayLayout
    @property
    def data(self) -> array[int]: ...
    @data.setter
    def data(self, value: Sequence[int]) -> None: ...
    def __init__(
        self,
        *,
        layout: MultiArrayLayout = ...,
        data: Sequence[int] = ...,
    ) -> None: ...

class Int64:
    data: int
    def __init__(
        self,
        *,
        data: int = ...,
    ) -> None: ...

class Int64MultiArray:
    layout: MultiArrayLayout
    @property
    def data(self) -> array[int]: ...
    @data.setter
    def data(self, value: Sequence[int]) -> None: ...
    def __init__(
        self,
        *,
        layout: MultiArrayLayout = ...,
        data: Sequence[int] = ...,
    ) -> None: ...

class Int8:
    data: int
    def __init__(
        self,
        *,
        data: int = ...,
    ) -> None: ...

class Int8MultiArray:
    layout: MultiArrayLayout
    @property
    def data(self) -> array[int]: ...
    @data.setter
    def data(self, value: Sequence[int]) -> None: ...
    def __init__(
        self,
        *,
        layout: MultiArrayLayout = ...,
        data: Sequence[int] = ...,
    ) -> None: ...

class MultiArrayDimension:
    label: str
    size: int
    stride: int
    def __init__(
        self,
        *,
        label: str = ...,
        size: int = ...,
        stride: int = ...,
    ) -> None: ...

class MultiArrayLayout:
    dim: Sequence[MultiArrayDimension]
    data_offset: int
    def __init__(
        self,
        *,
        dim: Sequence[MultiArrayDimension] = ...,
        data_offset: int = ...,
    ) -> None: ...

class String:
    data: str
    def __init__(
        self,
        *,
        data: str = ...,
    ) -> None: ...

class UInt16:
    data: int
    def __init__(
        self,
        *,
        data: int = ...,
    ) -> None: ...

class UInt16MultiArray:
    layout: MultiArrayLayout
    @property
    def data(self) -> array[int]: ...
    @data.setter
    def data(self, value: Sequence[int]) -> None: ...
    def __init__(
        self,
        *,
        layout: MultiArrayLayout = ...,
        data: Sequence[int] = ...,
    ) -> None: ...

class UInt32:
    data: int
    def __init__(
        self,
        *,
        data: int = ...,
    ) -> None: ...

class UInt32MultiArray:
    layout: MultiArrayLayout
    @property
    def data(self) -> array[int]: ...
    @data.setter
    def data(self, value: Sequence[int]) -> None: ...
    def __init__(
        self,
        *,
        layout: MultiArrayLayout = ...,
        data: Sequence[int] = ...,
    ) -> None: ...

class UInt64:
    data: int
    def __init__(
        self,
        *,
        data: int = ...,
    ) -> None: ...

class UInt64MultiArray:
    layout: MultiArrayLayout
    @property
    def data(self) -> array[int]: ...
    @data.setter
    def data(self, value: Sequence[int]) -> None: ...
    def __init__(
        self,
        *,
        layout: MultiArrayLayout = ...,
        data: Sequence[int] = ...,
    ) -> None: ...

class UInt8:
    data: int
    def __init__(
        self,
        *,
        data: int = ...,
    ) -> None: ...

class UInt8MultiArray:
    layout: MultiArrayLayout
    @property
    def data(self) -> array[int]: ...
    @data.setter
    def data(self, value: Sequence[int]) -> None: ...
    def __init__(
        self,
        *,
        layout: MultiArrayLayout = ...,
        data: Sequence[int] = ...,
    ) -> None: ...
