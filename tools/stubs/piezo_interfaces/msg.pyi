# Written by tools/write_stubs.py from the interface files.
from array import array
from collections.abc import Sequence
import std_msgs.msg

class ActuatorState:
    header: std_msgs.msg.Header
    sample: int
    voltage: float
    displacement: float
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        sample: int = ...,
        voltage: float = ...,
        displacement: float = ...,
    ) -> None: ...

class Gap:
    header: std_msgs.msg.Header
    sample: int
    rms: float
    noise_floor: float
    floors: float
    frequency: float
    @property
    def orders(self) -> array[int]: ...
    @orders.setter
    def orders(self, value: Sequence[int]) -> None: ...
    @property
    def harmonics(self) -> array[float]: ...
    @harmonics.setter
    def harmonics(self, value: Sequence[float]) -> None: ...
    beyond_floor: bool
    family: str
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        sample: int = ...,
        rms: float = ...,
        noise_floor: float = ...,
        floors: float = ...,
        frequency: float = ...,
        orders: Sequence[int] = ...,
        harmonics: Sequence[float] = ...,
        beyond_floor: bool = ...,
        family: str = ...,
    ) -> None: ...

class HarmonicState:
    header: std_msgs.msg.Header
    sample: int
    frequency: float
    error: float
    @property
    def orders(self) -> array[int]: ...
    @orders.setter
    def orders(self, value: Sequence[int]) -> None: ...
    @property
    def error_amplitudes(self) -> array[float]: ...
    @error_amplitudes.setter
    def error_amplitudes(self, value: Sequence[float]) -> None: ...
    @property
    def error_phases(self) -> array[float]: ...
    @error_phases.setter
    def error_phases(self, value: Sequence[float]) -> None: ...
    @property
    def correction_amplitudes(self) -> array[float]: ...
    @correction_amplitudes.setter
    def correction_amplitudes(self, value: Sequence[float]) -> None: ...
    @property
    def correction_phases(self) -> array[float]: ...
    @correction_phases.setter
    def correction_phases(self, value: Sequence[float]) -> None: ...
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        sample: int = ...,
        frequency: float = ...,
        error: float = ...,
        orders: Sequence[int] = ...,
        error_amplitudes: Sequence[float] = ...,
        error_phases: Sequence[float] = ...,
        correction_amplitudes: Sequence[float] = ...,
        correction_phases: Sequence[float] = ...,
    ) -> None: ...

class LoopStatus:
    header: std_msgs.msg.Header
    sample: int
    late: int
    missed: int
    refused: int
    limited: int
    doubled: int
    rate: float
    @property
    def names(self) -> Sequence[str]: ...
    @names.setter
    def names(self, value: list[str] | tuple[str, ...]) -> None: ...
    @property
    def counts(self) -> array[int]: ...
    @counts.setter
    def counts(self, value: Sequence[int]) -> None: ...
    low: float
    high: float
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        sample: int = ...,
        late: int = ...,
        missed: int = ...,
        refused: int = ...,
        limited: int = ...,
        doubled: int = ...,
        rate: float = ...,
        names: list[str] | tuple[str, ...] = ...,
        counts: Sequence[int] = ...,
        low: float = ...,
        high: float = ...,
    ) -> None: ...

class ModelEstimate:
    header: std_msgs.msg.Header
    sample: int
    model: str
    method: str
    @property
    def names(self) -> Sequence[str]: ...
    @names.setter
    def names(self, value: list[str] | tuple[str, ...]) -> None: ...
    @property
    def units(self) -> Sequence[str]: ...
    @units.setter
    def units(self, value: list[str] | tuple[str, ...]) -> None: ...
    @property
    def values(self) -> array[float]: ...
    @values.setter
    def values(self, value: Sequence[float]) -> None: ...
    @property
    def standard_deviations(self) -> array[float]: ...
    @standard_deviations.setter
    def standard_deviations(self, value: Sequence[float]) -> None: ...
    one_step_rms: float
    free_run_rms: float
    condition_number: float
    converged: bool
    frequency: float
    amplitude: float
    travel: float
    order: int
    message: str
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        sample: int = ...,
        model: str = ...,
        method: str = ...,
        names: list[str] | tuple[str, ...] = ...,
        units: list[str] | tuple[str, ...] = ...,
        values: Sequence[float] = ...,
        standard_deviations: Sequence[float] = ...,
        one_step_rms: float = ...,
        free_run_rms: float = ...,
        condition_number: float = ...,
        converged: bool = ...,
        frequency: float = ...,
        amplitude: float = ...,
        travel: float = ...,
        order: int = ...,
        message: str = ...,
    ) -> None: ...

class RecordMarker:
    header: std_msgs.msg.Header
    record: str
    actuator: str
    excitation: str
    frequency: float
    amplitude: float
    warm_up: float
    rate: float
    input_unit: str
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        record: str = ...,
        actuator: str = ...,
        excitation: str = ...,
        frequency: float = ...,
        amplitude: float = ...,
        warm_up: float = ...,
        rate: float = ...,
        input_unit: str = ...,
    ) -> None: ...

class Reference:
    header: std_msgs.msg.Header
    sample: int
    displacement: float
    velocity: float
    acceleration: float
    frequency: float
    phase: float
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        sample: int = ...,
        displacement: float = ...,
        velocity: float = ...,
        acceleration: float = ...,
        frequency: float = ...,
        phase: float = ...,
    ) -> None: ...

class VoltageCommand:
    header: std_msgs.msg.Header
    sample: int
    voltage: float
    def __init__(
        self,
        *,
        header: std_msgs.msg.Header = ...,
        sample: int = ...,
        voltage: float = ...,
    ) -> None: ...
