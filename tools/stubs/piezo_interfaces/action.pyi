# Written by tools/write_stubs.py from the interface files.
from array import array
from collections.abc import Sequence

class RunSweep:
    class Goal:
        @property
        def frequencies(self) -> array[float]: ...
        @frequencies.setter
        def frequencies(self, value: Sequence[float]) -> None: ...
        @property
        def amplitudes(self) -> array[float]: ...
        @amplitudes.setter
        def amplitudes(self, value: Sequence[float]) -> None: ...
        seconds: float
        warm_up: float
        pause: float
        waveform: str
        options: str
        bag: str
        def __init__(
            self,
            *,
            frequencies: Sequence[float] = ...,
            amplitudes: Sequence[float] = ...,
            seconds: float = ...,
            warm_up: float = ...,
            pause: float = ...,
            waveform: str = ...,
            options: str = ...,
            bag: str = ...,
        ) -> None: ...

    class Result:
        success: bool
        records: int
        samples: int
        message: str
        @property
        def names(self) -> Sequence[str]: ...
        @names.setter
        def names(self, value: list[str] | tuple[str, ...]) -> None: ...
        bag: str
        def __init__(
            self,
            *,
            success: bool = ...,
            records: int = ...,
            samples: int = ...,
            message: str = ...,
            names: list[str] | tuple[str, ...] = ...,
            bag: str = ...,
        ) -> None: ...

    class Feedback:
        record: str
        frequency: float
        amplitude: float
        seconds_left: float
        fraction: float
        def __init__(
            self,
            *,
            record: str = ...,
            frequency: float = ...,
            amplitude: float = ...,
            seconds_left: float = ...,
            fraction: float = ...,
        ) -> None: ...
