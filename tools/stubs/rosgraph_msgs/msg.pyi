# Written by tools/write_stubs.py from the interface files.
import builtin_interfaces.msg

class Clock:
    clock: builtin_interfaces.msg.Time
    def __init__(
        self,
        *,
        clock: builtin_interfaces.msg.Time = ...,
    ) -> None: ...
