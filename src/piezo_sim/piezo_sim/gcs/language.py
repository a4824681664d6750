"""GCS 2 commands of the simulated controller, and their answers."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from piezo_sim.gcs.controller import (
    AXIS,
    MOST_POINTS,
    OUTPUT,
    PARAMETER,
    POSITION,
    RANGE,
    STOPPED,
    SYNTAX,
    TARGET,
    UNKNOWN,
    DataRecorder,
    GcsError,
    SimulatedController,
)

IDENTITY = '(c) piezo_sim, E-000.1CD, 0000000001, 1.0.0'
UPDATE_TIME, AXIS_UNIT = 0x0E000200, 0x07000601  # period of the servo [s], unit of the position
_NAMES = {TARGET: 'Target Position of axis', POSITION: 'Current Position of axis',
          OUTPUT: 'Control Voltage of output'}  # fmt: skip
_PARAMETERS = ('The following parameters are valid:',
               f'0x{UPDATE_TIME:08X}=\t0\t1\tFLOAT\tservo\tServo Update Time',
               f'0x{AXIS_UNIT:08X}=\t0\t1\tCHAR\taxis\tAxis Unit', 'end of help')  # fmt: skip
Words = Sequence[str]


class Language:
    """Parser of client lines that returns the answers."""

    controls: tuple[int, ...] = (5, 7, 9, 24)
    unit = 'UM'

    def __init__(
        self,
        controller: SimulatedController,
        *others: SimulatedController,
        has_one_rate: bool = False,
    ) -> None:
        self._controller, self._has_one_rate = controller, has_one_rate
        self._axes = {str(k + 1): each for k, each in enumerate((controller, *others))}
        self._sources = {1: '1', 2: '1'}  # axis of each record table
        for other in others:
            other.tables, other.recorder.options = controller.tables, {}
        voltage, each = lambda made: f'{made.voltage:.9f}', self._each
        self._known: dict[str, Callable[[Words], str | None]] = {
            '*IDN?': lambda _: IDENTITY,
            'CSV?': lambda _: '2.0',
            'HLP?': lambda _: '\n'.join(['The following commands are valid:', *self._commands(),
                                         'end of help']),
            'HDR?': lambda _: '\n'.join(['#RecordOptions', *(f'{k}={_NAMES[k]}' for k in _NAMES),
                                         '#TriggerOptions', '0=WGO', 'end of help']),
            'ERR?': self._last_error,
            'SAI?': lambda _: '\n'.join(self._axes),
            'TWG?': lambda _: str(len(self._axes)), 'TNR?': lambda _: str(len(self._sources)),
            'SPA?': self._parameters,
            'HPA?': lambda _: '\n'.join(_PARAMETERS),
            'PUN?': each(lambda _: self.unit),
            'SVO': self._servo, 'SVO?': each(lambda made: int(made.servo)),
            'SVA': self._set_voltage, 'SVA?': each(voltage), 'VOL?': each(voltage),
            'MOV': self._move, 'MOV?': each(lambda made: f'{1e6 * made.target:.9f}'),
            'ONT?': each(lambda made: int(made.is_on_target)),
            'POS?': each(lambda made: f'{1e6 * made.position:.9f}'),
            'TMN?': each(lambda made: f'{1e6 * made.travel[0]:.9f}'),
            'TMX?': each(lambda made: f'{1e6 * made.travel[1]:.9f}'),
            'VMI?': each(lambda made: f'{made.low:.9f}'),
            'VMA?': each(lambda made: f'{made.high:.9f}'),
            'WAV': self._wave, 'WAV?': self._wave_length, 'WCL': self._clear,
            'WSL': self._select, 'WSL?': each(lambda made: made.generator.table),
            'WGC': self._cycles, 'WGC?': each(lambda made: made.generator.cycles),
            'WTR': self._wave_rate, 'WTR?': self._wave_rates,
            'WOS': self._offset, 'WOS?': each(lambda made: made.generator.offset),
            'WGO': self._go, 'WGO?': each(lambda made: int(made.is_running)),
            'DRC': self._configure, 'DRC?': self._configured, 'DRT': lambda _: None,
            'RTR': self._record_rate, 'RTR?': lambda _: f'{controller.recorder.divider}',
            'DRL?': self._recorded, 'DRR?': self._records,
            'STP': lambda _: self._stop(),
        }  # fmt: skip

    def _commands(self) -> list[str]:
        """Return the lines of ``HLP?``."""
        controls = ['#5', '#7', '#9', '#24']
        return [f'{name} - see the manual' for name in (*controls, *sorted(self._known))]

    def answer(self, line: str) -> str | None:
        """Return the answer to a line, without the last line feed; None without an answer."""
        parts = line.split()
        if not parts:
            return None
        for made in self._axes.values():
            made.advance()
        try:
            known = self._known.get(parts[0].upper())
            if known is None:
                raise GcsError(UNKNOWN)
            return known(parts[1:])
        except GcsError as error:
            self._controller.error = error.number
        except (ValueError, IndexError):
            self._controller.error = SYNTAX
        return None

    def control(self, byte: int) -> str | None:
        """Return the answer to a single-character command."""
        if byte == 7:
            return '\xb1'
        if byte in (5, 9):
            made = self._axes.values()
            bits = [each.is_running if byte == 9 else not each.is_on_target for each in made]
            return f'{sum(bit << k for k, bit in enumerate(bits)):x}'
        if byte == 24:
            self._stop()
        return None

    def framed(self, answer: str) -> bytes:
        """Return the bytes of answer lines: all but the last end with a space."""
        return (answer.replace('\n', ' \n') + '\n').encode('latin-1')

    def _last_error(self, _: Words) -> str:
        number, self._controller.error = self._controller.error, 0
        return str(number)

    def _stop(self) -> None:
        for made in self._axes.values():
            made.stop()
        self._controller.error = STOPPED

    def _axis(self, name: str) -> SimulatedController:
        if name not in self._axes:
            raise GcsError(AXIS)
        return self._axes[name]

    def _each(self, value: Callable[[SimulatedController], object]) -> Callable[[Words], str]:
        """Return the answer to a query about some axes, or all."""
        return lambda parts: '\n'.join(
            f'{name}={value(self._axis(name))}' for name in parts or self._axes
        )

    def _parameters(self, parts: Words) -> str:
        """``SPA? axis parameter...``: numbers are equal however they are written."""
        lines = []
        for axis, name in zip(parts[::2], parts[1::2], strict=True):
            rate = self._axis(axis).plant.rate
            known = {UPDATE_TIME: f'{1.0 / rate:.9g}', AXIS_UNIT: self.unit}
            if (number := int(name, 0)) not in known:
                raise GcsError(PARAMETER)
            lines.append(f'{axis} {name}={known[number]}')
        return '\n'.join(lines)

    def _servo(self, parts: Words) -> None:
        self._axis(parts[0]).switch_servo(bool(int(parts[1])))

    def _set_voltage(self, parts: Words) -> None:
        self._axis(parts[0]).set_voltage(float(parts[1]))

    def _move(self, parts: Words) -> None:
        self._axis(parts[0]).move(1e-6 * float(parts[1]))

    def _wave(self, parts: Words) -> None:
        """``WAV table X|& PNT start count values...``: create a table, or append points to it."""
        table, mode, kind, count = int(parts[0]), parts[1], parts[2].upper(), int(parts[4])
        values = np.array([float(word) for word in parts[5:]])
        if kind != 'PNT' or mode not in ('X', '&') or values.size != count:
            raise GcsError(SYNTAX)
        before = self._controller.tables.get(table, np.empty(0)) if mode == '&' else np.empty(0)
        if before.size + count > MOST_POINTS:
            raise GcsError(RANGE)
        self._controller.tables[table] = np.concatenate([before, values])

    def _wave_length(self, parts: Words) -> str:
        size = self._controller.tables.get(int(parts[0]), np.empty(0)).size
        return f'{parts[0]} {parts[1]}={size}'

    def _clear(self, parts: Words) -> None:
        self._controller.tables.pop(int(parts[0]), None)

    def _select(self, parts: Words) -> None:
        self._axis(parts[0]).generator.table = int(parts[1])

    def _cycles(self, parts: Words) -> None:
        self._axis(parts[0]).generator.cycles = max(int(parts[1]), 0)

    def _wave_rate(self, parts: Words) -> None:
        """``WTR generator ticks interpolation``; 0 means every generator."""
        divider, kind = int(parts[1]), int(parts[2]) if len(parts) > 2 else 0
        if divider < 1 or kind not in (0, 1) or (self._has_one_rate and parts[0] != '0'):
            raise GcsError(RANGE)
        for made in self._axes.values() if parts[0] == '0' else [self._axis(parts[0])]:
            made.advance()
            made.generator.divider, made.generator.is_straight = divider, bool(kind)

    def _wave_rates(self, parts: Words) -> str:
        names = ['0'] if self._has_one_rate else list(parts or self._axes)
        made = [self._controller if name == '0' else self._axis(name) for name in names]
        return '\n'.join(
            f'{name}={each.generator.divider} {int(each.generator.is_straight)}'
            for name, each in zip(names, made, strict=True)
        )

    def _offset(self, parts: Words) -> None:
        self._axis(parts[0]).generator.offset = float(parts[1])

    def _go(self, parts: Words) -> None:
        made = self._axis(parts[0])
        if not int(parts[1], 0):
            made.stop()
            return
        made.start()
        for each in self._axes.values():  # the recorder starts with any generator
            each.restart_recorder()

    def _configure(self, parts: Words) -> None:
        table, axis, option = int(parts[0]), parts[1], int(parts[2])
        if option not in _NAMES or table not in self._sources:
            raise GcsError(RANGE)
        source = self._axis(axis)
        for made in self._axes.values():
            made.recorder.options.pop(table, None)
        source.recorder.options[table] = option
        self._sources[table] = axis

    def _configured(self, parts: Words) -> str:
        tables = [int(word) for word in parts] or list(self._sources)
        return '\n'.join(
            f'{each}={self._sources[each]} {self._source(each).options[each]}' for each in tables
        )

    def _source(self, table: int) -> DataRecorder:
        """Return the recorder of the axis that fills a table."""
        if table not in self._sources:
            raise GcsError(RANGE)
        return self._axes[self._sources[table]].recorder

    def _record_rate(self, parts: Words) -> None:
        if int(parts[0]) < 1:
            raise GcsError(RANGE)
        for made in self._axes.values():
            made.recorder.divider = int(parts[0])

    def _recorded(self, parts: Words) -> str:
        tables = [int(word) for word in parts] or list(self._sources)
        return '\n'.join(f'{each}={self._source(each).count(each)}' for each in tables)

    def _records(self, parts: Words) -> str:
        """``DRR? start count tables...``: the header, then a line for each sample."""
        first, count, tables = int(parts[0]) - 1, int(parts[1]), [int(each) for each in parts[2:]]
        columns = []
        for table in tables:
            pieces = self._source(table).samples.get(table, [])
            column = (np.concatenate(pieces) if pieces else np.empty(0))[first : first + count]
            if column.size != count:
                raise GcsError(RANGE)
            columns.append(column)
        # Numbers as a controller writes them: its client takes 5e-05 for a text.
        dt = self._controller.recorder.divider / self._controller.plant.rate
        head = ['# REM piezo_sim', '# VERSION = 1', '# TYPE = 1', '# SEPARATOR = 32',
                f'# DIM = {len(tables)}', f'# SAMPLE_TIME = {dt:.12f}',
                f'# NDATA = {count}']  # fmt: skip
        for k, table in enumerate(tables):
            name = _NAMES[self._source(table).options[table]]
            head.append(f'# NAME{k} = {name} {self._sources[table]}')
        rows = [' '.join(f'{value:.9g}' for value in row) for row in zip(*columns, strict=True)]
        return '\n'.join([*head, '# END_HEADER', *rows])
