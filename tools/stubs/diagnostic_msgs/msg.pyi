# Written by tools/write_stubs.py from the interface files.
from collections.abc import Sequence
from typing import ClassVar
import std_msgs.msg

class DiagnosticArray:
    header: std_msgs.msg.Header
    status: Sequence[DiagnosticStatus]
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        status: Sequence[DiagnosticStatus] = ...,
    ) -> None: ...

class DiagnosticStatus:
    OK: ClassVar[bytes]
    WARN: ClassVar[bytes]
    ERROR: ClassVar[bytes]
    STALE: ClassVar[bytes]
    level: bytes
    name: str
    message: str
    hardware_id: str
    values: Sequence[KeyValue]
    def __init__(
        self,
        *,
        level: bytes = ...,
        name: str = ...,
        message: str = ...,
        hardware_id: str = ...,
        values: Sequence[KeyValue] = ...,
    ) -> None: ...

class KeyValue:
    key: str
    value: str
    def __init__(
        self,
        *,
        key: str = ...,
        value: str = ...,
    ) -> None: ...
