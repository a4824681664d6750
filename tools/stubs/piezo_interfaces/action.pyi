# Written by tools/write_stubs.py from the interface files.
from array import array
from collections.abc import Sequence

class Discover:
    class Goal:
        @property
        def data(self) -> Sequence[str]: ...
        @data.setter
        def data(self, value: list[str] | tuple[str, ...]) -> None: ...
        baseline: str
        out: str
        seed: int
        workers: int
        def __init__(
            self,
            *,
            data: list[str] | tuple[str, ...] = ...,
            baseline: str = ...,
            out: str = ...,
            seed: int = ...,
            workers: int = ...,
        ) -> None: ...

    class Result:
        success: bool
        verdict: str
        @property
        def effects(self) -> Sequence[str]: ...
        @effects.setter
        def effects(self, value: list[str] | tuple[str, ...]) -> None: ...
        @property
        def probabilities(self) -> array[float]: ...
        @probabilities.setter
        def probabilities(self, value: Sequence[float]) -> None: ...
        before_in_floors: float
        after_in_floors: float
        report: str
        message: str
        def __init__(
            self,
            *,
            success: bool = ...,
            verdict: str = ...,
            effects: list[str] | tuple[str, ...] = ...,
            probabilities: Sequence[float] = ...,
            before_in_floors: float = ...,
            after_in_floors: float = ...,
            report: str = ...,
            message: str = ...,
        ) -> None: ...

    class Feedback:
        stage: str
        detail: str
        fraction: float
        def __init__(
            self,
            *,
            stage: str = ...,
            detail: str = ...,
            fraction: float = ...,
        ) -> None: ...

class Investigate:
    class Goal:
        model_yaml: str
        model: str
        out: str
        low: float
        high: float
        slew: float
        frequency: float
        stroke: float
        heat: float
        budget: float
        sure: float
        seed: int
        workers: int
        apply: bool
        def __init__(
            self,
            *,
            model_yaml: str = ...,
            model: str = ...,
            out: str = ...,
            low: float = ...,
            high: float = ...,
            slew: float = ...,
            frequency: float = ...,
            stroke: float = ...,
            heat: float = ...,
            budget: float = ...,
            sure: float = ...,
            seed: int = ...,
            workers: int = ...,
            apply: bool = ...,
        ) -> None: ...

    class Result:
        success: bool
        verdict: str
        @property
        def effects(self) -> Sequence[str]: ...
        @effects.setter
        def effects(self, value: list[str] | tuple[str, ...]) -> None: ...
        @property
        def probabilities(self) -> array[float]: ...
        @probabilities.setter
        def probabilities(self, value: Sequence[float]) -> None: ...
        stop: str
        experiments: int
        seconds: float
        before_in_floors: float
        after_in_floors: float
        report: str
        message: str
        def __init__(
            self,
            *,
            success: bool = ...,
            verdict: str = ...,
            effects: list[str] | tuple[str, ...] = ...,
            probabilities: Sequence[float] = ...,
            stop: str = ...,
            experiments: int = ...,
            seconds: float = ...,
            before_in_floors: float = ...,
            after_in_floors: float = ...,
            report: str = ...,
            message: str = ...,
        ) -> None: ...

    class Feedback:
        stage: str
        experiment: str
        why: str
        answer: str
        number: int
        @property
        def names(self) -> Sequence[str]: ...
        @names.setter
        def names(self, value: list[str] | tuple[str, ...]) -> None: ...
        @property
        def chances(self) -> array[float]: ...
        @chances.setter
        def chances(self, value: Sequence[float]) -> None: ...
        seconds: float
        fraction: float
        def __init__(
            self,
            *,
            stage: str = ...,
            experiment: str = ...,
            why: str = ...,
            answer: str = ...,
            number: int = ...,
            names: list[str] | tuple[str, ...] = ...,
            chances: Sequence[float] = ...,
            seconds: float = ...,
            fraction: float = ...,
        ) -> None: ...

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
