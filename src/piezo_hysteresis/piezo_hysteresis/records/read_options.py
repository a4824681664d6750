"""What a user states about files that do not state it themselves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from piezo_hysteresis.common.stated import CLOCKS
from piezo_hysteresis.errors import RecordError


@dataclass(frozen=True)
class ReadOptions:
    """Statements about the files to be read.

    Attributes
    ----------
    columns : mapping of str to str
        ``NAME:UNIT`` or the number of a column, from 1, by quantity (or ``/topic.field:unit``).
    header_row : int or None
        Line of the column names of a text file, from 1.
    interval : float or None
        Sampling interval of files without a time [s]; a time that they have is not used.
    sign : float
        1, or -1 for a sensor that measures the distance.
    unit : str
        Unit of a displacement that states none.
    decimal : str
        Decimal mark of a text file, ``.`` or ``,``; empty: found from all cells.
    time_from : str
        ``recording`` or ``header`` for bags; empty: header stamps where they agree.
    axes : bool
        The files are of several axes: a column of ``voltage`` and ``displacement`` is then a
        pattern, ``u*`` or ``u*:mV``.

    Raises
    ------
    RecordError
        If a value is out of range.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    header_row: int | None = None
    interval: float | None = None
    sign: float = 1.0
    unit: str = ''
    decimal: str = ''
    time_from: str = ''
    axes: bool = False

    def __post_init__(self) -> None:
        step = self.interval
        if step is not None and not (
            isinstance(step, int | float) and np.isfinite(step) and step > 0
        ):
            raise RecordError(f'the interval (dt) must be a positive number [s], got {step!r}')
        if self.sign not in (1, -1):
            raise RecordError(f'the sign is 1 or -1, got {self.sign!r}')
        if self.decimal not in ('', '.', ','):
            raise RecordError(f'the decimal mark is . or , and not {self.decimal!r}')
        if self.time_from not in ('', *CLOCKS):
            raise RecordError(f'the time is from {" or ".join(CLOCKS)}, not {self.time_from!r}')
