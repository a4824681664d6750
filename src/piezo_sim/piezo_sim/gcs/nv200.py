"""Commands of an NV200 of piezosystem jena, with the same simulated actuator.

Each answer ends with the byte XON. With an open loop, set point and wave are voltages, else
positions; the wave generator drives the output if it is selected as the source of the set point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from piezo_sim.gcs.controller import (
    LIMITS,
    OUTPUT,
    POSITION,
    TARGET,
    GcsError,
    SimulatedController,
)

#: Number of points of the wave and of values of a recorder.
POINTS, VALUES = 1024, 6144
_UNKNOWN, _MISSING, _RANGE = 2, 3, 4  # error numbers
#: What a recorder holds: position, set point, voltage, position in open loop.
_SOURCES = {0: POSITION, 1: TARGET, 2: OUTPUT, 5: POSITION}
#: What is only read: an actuator with a strain gauge (acmeasure 1).
_FIXED = {'desc': 'SIMULATED', 'acserno': '1', 'acmeasure': '1', 'unitcl': 'um', 'unitol': 'V',
          'temp': '30.0', 'giarb': '0', 'recidx': '0'}  # fmt: skip
#: What a client may set and read again, without an effect on the simulation.
_SETTINGS = {'sr': '2000', 'setlpon': '0', 'poslpon': '1', 'notchon': '0', 'setlpf': '10000',
             'poslpf': '1000', 'notchf': '1000', 'notchb': '100', 'kp': '0.1', 'ki': '100',
             'kd': '0', 'pcf': '0,0,0', 'ctrlmode': '0', 'monsrc': '0', 'spisrc': '0',
             'trgfkt': '0', 'trgedg': '0', 'trgsrc': '0', 'trgss': '0.001', 'trgse': '0.001',
             'trgsi': '0.001', 'trglen': '1'}  # fmt: skip
Words = Sequence[str]


class Nv200Error(Exception):
    """A rejected command with its error number."""


class Nv200Language:
    """Parser of client lines that returns the answers."""

    controls: tuple[int, ...] = ()

    def __init__(self, controller: SimulatedController) -> None:
        self._controller = controller
        self._wave = np.full(POINTS, self._percent(0.0))
        self._numbers = {'modsrc': 0, 'gsarb': 0, 'gearb': POINTS - 1, 'goarb': 0, 'gcarb': 1,
                         'gtarb': 1, 'recast': 0, 'recstr': 1, 'reclen': VALUES}  # fmt: skip
        self._fixed, self._settings = dict(_FIXED), dict(_SETTINGS)
        self._set_point = 0.0
        self._sources = {0: 0, 1: 2}
        self._single: dict[int, float] | None = None
        self._known: dict[str, Callable[[Words], str | None]] = {
            'cl': self._loop, 'set': self._set, 'meas': self._measured,
            'avmin': lambda _: f'{controller.low:.3f}',
            'avmax': lambda _: f'{controller.high:.3f}',
            'posmin': lambda _: f'{1e6 * controller.travel[0]:.3f}',
            'posmax': lambda _: f'{1e6 * controller.travel[1]:.3f}',
            'stat': self._status, 'gbarb': self._point, 'gparb': self._position_point,
            'grun': self._run,
            'recsrc': self._source, 'recrun': self._record, 'recout': self._value,
            'recoutf': self._all,
        }  # fmt: skip

    def control(self, byte: int) -> str | None:
        """Return None, because the protocol has no single-byte commands."""

    def framed(self, answer: str) -> bytes:
        """Return the bytes of an answer."""
        line = f'{answer}\r\n' if answer else ''
        return b'\x13' + line.encode('latin-1') + b'\x11'

    def answer(self, line: str) -> str:
        """Return the answer to a line; it is empty for a command."""
        word, *parts = line.strip('\r').split(',')
        if not word:
            return 'NV200/D_NET>'
        self._controller.advance()
        try:
            found = self.value_of(word, parts)
        except Nv200Error as error:
            return f'error,{error.args[0]}'
        except GcsError as error:
            return f'error,{_RANGE if error.number == LIMITS else 1}'
        except (ValueError, KeyError):
            return f'error,{_RANGE}'
        except IndexError:
            return f'error,{_MISSING}'
        return '' if found is None else f'{word},{found}'

    def value_of(self, word: str, parts: Words) -> str | None:
        """Return the value of a parameter as text, None for an unknown one."""
        if word in self._known:
            return self._known[word](parts)
        if word in self._fixed:
            return self._fixed[word]
        if word in self._settings:
            if not parts:
                return self._settings[word]
            self._settings[word] = ','.join(parts)
            return None
        if word not in self._numbers:
            raise Nv200Error(_UNKNOWN)
        if not parts:
            return str(self._numbers[word])
        self._numbers[word] = int(parts[0])
        if word == 'modsrc':
            self._apply()
        return None

    def _status(self, _: Words) -> str:
        """Return the register: actuator, sensor, loop, filters, processing."""
        ons = [self._settings[name] != '0' for name in ('poslpon', 'notchon')]
        bits = {0: True, 3: self._controller.servo, 4: ons[0], 5: ons[1], 7: True}
        return str(sum(bit << k for k, bit in bits.items()) + (int(self._fixed['acmeasure']) << 1))

    @property
    def _range(self) -> tuple[float, float]:
        """Range of set point and wave: voltage [V], or position in closed loop [um]."""
        made = self._controller
        if made.servo:
            return 1e6 * made.travel[0], 1e6 * made.travel[1]
        return made.low, made.high

    def _percent(self, voltage: float) -> float:
        low, high = self._range
        return 100.0 * (voltage - low) / (high - low)

    def _apply(self) -> None:
        """Set output or target to the set point, if that is the selected source."""
        if self._numbers['modsrc'] != 0:
            return
        if self._controller.servo:
            self._controller.move(1e-6 * self._set_point)
        else:
            self._controller.set_voltage(self._set_point)

    def _loop(self, parts: Words) -> str | None:
        made = self._controller
        if not parts:
            return str(int(made.servo))
        if self._fixed['acmeasure'] == '0' and int(parts[0]):
            raise Nv200Error(_RANGE)
        made.switch_servo(bool(int(parts[0])))
        self._set_point = 1e6 * made.target if made.servo else made.voltage
        return None

    def _set(self, parts: Words) -> str | None:
        if not parts:
            return f'{self._set_point:.3f}'
        value, (low, high) = float(parts[0]), self._range
        if not low <= value <= high:
            raise Nv200Error(_RANGE)
        self._set_point = value
        self._apply()
        return None

    def _measured(self, _: Words) -> str:
        """Return the position, or the voltage where there is no sensor."""
        made = self._controller
        has_sensor = self._fixed['acmeasure'] != '0'
        return f'{1e6 * made.position if has_sensor else made.voltage:.6f}'

    def _point(self, parts: Words) -> str | None:
        index = int(parts[0])
        if not 0 <= index < POINTS:
            raise Nv200Error(_RANGE)
        if len(parts) < 2:
            return f'{index},{self._wave[index]:.6f}'
        value = float(parts[1])
        if not 0.0 <= value <= 100.0:
            raise Nv200Error(_RANGE)
        self._wave[index] = value
        return None

    def _position_point(self, parts: Words) -> str | None:
        """Set or return a point of the wave as a position [um]."""
        low, high = (1e6 * end for end in self._controller.travel)
        if len(parts) < 2:
            return f'{parts[0]},{low + 0.01 * self._wave[int(parts[0])] * (high - low):.6f}'
        percent = 100.0 * (float(parts[1]) - low) / (high - low)
        return self._point([parts[0], f'{percent:.9g}'])

    def _run(self, parts: Words) -> str | None:
        made = self._controller
        if not parts:
            return str(int(made.is_running))
        if not int(parts[0]):
            made.stop()
            return None
        if self._numbers['modsrc'] != 3:
            raise Nv200Error(_RANGE)
        first, last = self._numbers['gsarb'], self._numbers['gearb']
        share = 0.01 * self._wave[first : last + 1]
        low, high = self._range
        made.tables[1] = low + share * (high - low)
        made.generator.table, made.generator.divider = 1, self._numbers['gtarb']
        made.generator.cycles, made.generator.offset = self._numbers['gcarb'], 0.0
        made.recorder.options = {k: _SOURCES[self._sources[k]] for k in (0, 1)}
        made.recorder.divider, self._single = self._numbers['recstr'], None
        made.start()
        return None

    def _source(self, parts: Words) -> str | None:
        channel = int(parts[0])
        if len(parts) < 2:
            return f'{channel},{self._sources[channel]}'
        if int(parts[1]) not in _SOURCES:
            raise Nv200Error(_RANGE)
        self._sources[channel] = int(parts[1])
        return None

    def _record(self, parts: Words) -> str | None:
        """Record one value at once, or return whether the wave is still recorded."""
        made = self._controller
        if parts:
            if int(parts[0]):
                target = 1e6 * made.target if made.servo else made.voltage
                now = {POSITION: 1e6 * made.position, TARGET: target, OUTPUT: made.voltage}
                self._single = {k: now[_SOURCES[self._sources[k]]] for k in (0, 1)}
            return None
        if self._single is not None:
            return '0'
        return str(int(self._count() < min(self._numbers['reclen'], VALUES)))

    def _count(self) -> int:
        return min(self._controller.recorder.count(k) for k in (0, 1))

    def _value(self, parts: Words) -> str:
        channel, index = int(parts[0]), int(parts[1])
        values = self._values(channel)
        return f'{channel},{index},{values[index]:.6f}'

    def _all(self, parts: Words) -> str:
        channel = int(parts[0])
        return ','.join([str(channel), *(f'{value:.6f}' for value in self._values(channel))])

    def _values(self, channel: int) -> Sequence[float]:
        if self._single is not None:
            return [self._single[channel]]
        pieces = self._controller.recorder.samples.get(channel, [])
        found = np.concatenate(pieces) if pieces else np.empty(0)
        return [float(value) for value in found[: min(self._numbers['reclen'], VALUES)]]
