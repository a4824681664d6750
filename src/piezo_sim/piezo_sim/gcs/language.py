"""GCS 2 commands of the simulated controller, and their answers."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from piezo_sim.gcs.controller import (
    AXIS,
    MOST_POINTS,
    POSITION,
    RANGE,
    STOPPED,
    SYNTAX,
    UNKNOWN,
    GcsError,
    SimulatedController,
)

IDENTITY = '(c) piezo_sim, E-000.1CD, 0000000001, 1.0.0'
UPDATE_TIME = '0X0E000200'  # parameter with the period of the servo [s]
_NAMES = {1: 'Target Position of axis 1', 2: 'Current Position of axis 1',
          7: 'Control Voltage of output 1'}  # fmt: skip
Words = Sequence[str]


class Language:
    """Parser of client lines that returns the answers.

    Parameters
    ----------
    controller : SimulatedController
        Controlled device.
    """

    controls: tuple[int, ...] = (5, 7, 9, 24)

    def __init__(self, controller: SimulatedController) -> None:
        self._controller = controller
        self._known: dict[str, Callable[[Words], str | None]] = {
            '*IDN?': lambda _: IDENTITY,
            'ERR?': self._last_error,
            'SAI?': lambda _: '1',
            'SPA?': self._parameter,
            'SVO': self._servo, 'SVO?': lambda parts: self._of_axis(parts, int(controller.servo)),
            'SVA': self._set_voltage,
            'SVA?': lambda parts: self._of_axis(parts, f'{controller.voltage:.9f}'),
            'VOL?': lambda parts: self._of_axis(parts, f'{controller.voltage:.9f}'),
            'POS?': lambda parts: self._of_axis(parts, f'{1e6 * controller.position:.9f}'),
            'VMI?': lambda parts: self._of_axis(parts, f'{controller.low:.9f}'),
            'VMA?': lambda parts: self._of_axis(parts, f'{controller.high:.9f}'),
            'WAV': self._wave, 'WAV?': self._wave_length, 'WCL': self._clear,
            'WSL': self._select, 'WGC': self._cycles, 'WTR': self._wave_rate, 'WOS': self._offset,
            'WGO': self._go,
            'WGO?': lambda parts: self._of_axis(parts, int(controller.is_running)),
            'DRC': self._configure, 'DRT': lambda _: None, 'RTR': self._record_rate,
            'RTR?': lambda _: f'{controller.recorder.divider}',
            'DRL?': self._recorded, 'DRR?': self._records,
            'STP': lambda _: self._stop(),
        }  # fmt: skip

    def answer(self, line: str) -> str | None:
        """Return the answer to a line, without the last line feed; None without an answer."""
        parts = line.split()
        if not parts:
            return None
        self._controller.advance()
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
        if byte == 5:
            return '0'
        if byte == 7:
            return '\xb1'
        if byte == 9:
            return f'{int(self._controller.is_running)}'
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
        self._controller.stop()
        self._controller.error = STOPPED

    def _of_axis(self, parts: Words, value: object = '') -> str:
        if parts and parts[0] != '1':
            raise GcsError(AXIS)
        return f'1={value}'

    def _parameter(self, parts: Words) -> str:
        if parts[1].upper() != UPDATE_TIME:
            raise GcsError(RANGE)
        return f'{parts[0]} {parts[1]}={1.0 / self._controller.plant.rate:.9g}'

    def _servo(self, parts: Words) -> None:
        self._of_axis(parts)
        self._controller.servo = bool(int(parts[1]))

    def _set_voltage(self, parts: Words) -> None:
        self._of_axis(parts)
        self._controller.set_voltage(float(parts[1]))

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
        self._controller.generator.table = int(parts[1])

    def _cycles(self, parts: Words) -> None:
        self._controller.generator.cycles = max(int(parts[1]), 0)

    def _wave_rate(self, parts: Words) -> None:
        if int(parts[1]) < 1:
            raise GcsError(RANGE)
        self._controller.generator.divider = int(parts[1])

    def _offset(self, parts: Words) -> None:
        self._controller.generator.offset = float(parts[1])

    def _go(self, parts: Words) -> None:
        self._of_axis(parts)
        if int(parts[1], 0):
            self._controller.start()
        else:
            self._controller.stop()

    def _configure(self, parts: Words) -> None:
        option = int(parts[2])
        if option not in _NAMES:
            raise GcsError(RANGE)
        self._controller.recorder.options[int(parts[0])] = option

    def _record_rate(self, parts: Words) -> None:
        if int(parts[0]) < 1:
            raise GcsError(RANGE)
        self._controller.recorder.divider = int(parts[0])

    def _recorded(self, parts: Words) -> str:
        tables = [int(word) for word in parts] or sorted(self._controller.recorder.options)
        return '\n'.join(f'{each}={self._controller.recorder.count(each)}' for each in tables)

    def _records(self, parts: Words) -> str:
        """``DRR? start count tables...``: the header, then a line for each sample."""
        recorder = self._controller.recorder
        first, count, tables = int(parts[0]) - 1, int(parts[1]), [int(each) for each in parts[2:]]
        columns = []
        for table in tables:
            pieces = recorder.samples.get(table, [])
            column = (np.concatenate(pieces) if pieces else np.empty(0))[first : first + count]
            if column.size != count:
                raise GcsError(RANGE)
            columns.append(column)
        head = ['# REM piezo_sim', '# VERSION = 1', '# TYPE = 1', '# SEPARATOR = 32',
                f'# DIM = {len(tables)}',
                f'# SAMPLE_TIME = {recorder.divider / self._controller.plant.rate:.9g}',
                f'# NDATA = {count}']  # fmt: skip
        options = [recorder.options.get(table, POSITION) for table in tables]
        head += [f'# NAME{k} = {_NAMES[option]}' for k, option in enumerate(options)]
        rows = [' '.join(f'{value:.9g}' for value in row) for row in zip(*columns, strict=True)]
        return '\n'.join([*head, '# END_HEADER', *rows])
