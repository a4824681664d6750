"""One axis of a controller of PI: a wave in its generator, and what its recorder holds."""

from __future__ import annotations

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.drivers.controller import UNLIMITED, Controller, Identity, Measurement
from piezo_hysteresis.drivers.driver_errors import DriverError
from piezo_hysteresis.drivers.gcs.gcs_connection import IDENTITY, STOP, GcsConnection

_UPDATE_TIME = '0x0E000200'  # period of the servo [s]
_POSITION, _OUTPUT = 2, 7  # what the recorder holds: position [µm], voltage of the output [V]
_TABLE = 1
_POINTS_PER_LINE = 100


class GcsController(Controller):
    """One axis in open loop.

    Parameters
    ----------
    connection : GcsConnection
        Connection to the controller; closed if the axis does not exist.
    limits : Limits
        Limits in addition to those of the controller.
    axis : str
        Name of the axis and of its output.

    Raises
    ------
    DriverError
        If the axis does not exist.
    """

    most_points = 60_000  # that every controller of this kind holds
    filters = 'those of the controller, at the rate of its servo; see its manual'

    _line: GcsConnection

    def __init__(
        self, connection: GcsConnection, limits: Limits = UNLIMITED, axis: str = '1'
    ) -> None:
        super().__init__(connection, limits, axis)

    def _look(self, given: Limits) -> None:
        connection, axis = self._line, self.axis
        axes = connection.ask('SAI?')
        if axis not in axes:
            raise DriverError(
                f'{connection.address}: there is no axis {axis}; it has {", ".join(axes)}'
            )
        self._channel = axes.index(axis) + 1  # of its output and its wave generator
        name, _, firmware = connection.ask(IDENTITY)[0].rpartition(',')
        period = connection.number(f'SPA? {axis} {_UPDATE_TIME}')
        if not 0.0 < period < 1.0:
            raise DriverError(f'{connection.address}: a servo period of {period:g} s is none')
        self.identity = Identity(name.strip(), firmware.strip(), 1.0 / period)
        low, high = (connection.number(f'{word} {self._channel}') for word in ('VMI?', 'VMA?'))
        self.limits = Limits(max(low, given.low), min(high, given.high), given.slew)

    @property
    def voltage(self) -> float:
        """Voltage of the output [V]."""
        return self._line.number(f'VOL? {self._channel}')

    @property
    def displacement(self) -> float:
        """Position as the controller measures it [m]."""
        return 1e-6 * self._line.number(f'POS? {self.axis}')

    @property
    def is_running(self) -> bool:
        """Whether the wave generator plays."""
        return self._line.is_running()

    def open_loop(self) -> None:
        """Switch the servo off, and go to 0 V.

        Raises
        ------
        DriverError
            If the controller keeps the servo on.
        """
        self._line.command(f'SVO {self.axis} 0')
        if self._line.number(f'SVO? {self.axis}') != 0.0:
            raise DriverError(f'{self._line.address}: the servo stays on; switch it off there')
        self.ramp_to(0.0)

    def set_voltage(self, voltage: float) -> None:
        """Set the output voltage immediately [V]."""
        self._line.command(f'SVA {self.axis} {voltage:.9g}')

    def halt(self) -> None:
        """Stop the wave generator; the voltage is held."""
        self._line.send(STOP)
        self._line.ask('ERR?')  # clears the error of the stop

    def load(self, voltages: FloatArray, divider: int) -> None:
        """Load a wave [V], to be played once, and prepare the recorder."""
        last, generator = voltages.size, self._channel
        for first in range(0, last, _POINTS_PER_LINE):
            part = voltages[first : first + _POINTS_PER_LINE]
            mode = '&' if first else 'X'
            values = ' '.join(f'{value:.9g}' for value in part)
            # each is awaited, so that the timeout holds for a line and not for a table
            self._line.command(f'WAV {_TABLE} {mode} PNT 1 {part.size} {values}')
        if self._line.number(f'WAV? {_TABLE} 1') != last:
            raise DriverError(f'{self._line.address}: the wave did not arrive whole; try again')
        for text in (
            f'WSL {generator} {_TABLE}', f'WGC {generator} 1', f'WOS {generator} 0',
            f'WTR {generator} {divider} 1', f'DRC 1 {self.axis} {_POSITION}',
            f'DRC 2 {generator} {_OUTPUT}', 'DRT 0 0 0', f'RTR {divider}',
        ):  # fmt: skip
            self._line.command(text)

    def start(self) -> None:
        """Start wave generator and recorder."""
        self._line.command(f'WGO {self._channel} 1')

    def recorded_count(self) -> int:
        """Return how many samples the recorder holds."""
        return int(min(self._line.number(f'DRL? {table}') for table in (1, 2)))

    def recorded(self, count: int, divider: int) -> Measurement:
        """Return what the recorder holds."""
        lines = self._line.ask(f'DRR? 1 {count} 1 2')
        head = [line for line in lines if line.startswith('#')]
        header = dict(line.lstrip('# ').split(' = ', 1) for line in head if ' = ' in line)
        try:
            dt = float(header['SAMPLE_TIME'])
            rows = np.array([line.split() for line in lines[len(head) :]], np.float64)
            position, voltage = rows.T
        except (KeyError, ValueError):
            raise DriverError(f'{self._line.address}: the record cannot be read') from None
        return Measurement(dt, voltage.copy(), 1e-6 * position)
