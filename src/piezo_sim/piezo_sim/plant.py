"""Simulated actuator: one command in, one reading out.

All parameters can change during operation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from piezo_hysteresis.common.wording import near
from piezo_sim import derive
from piezo_sim.layout import EFFECTS, PARAMETERS, STATE_TYPE
from piezo_sim.parts import chain, structure
from piezo_sim.plant_parameters import PlantEffect, PlantParameter
from piezo_sim.presets import Preset, load_preset
from piezo_sim.simulation_errors import PlantError

FloatArray = npt.NDArray[np.float64]

FAULTS = {
    'none': chain.NO_FAULT,
    'sensor_dropout': chain.SENSOR_DROPOUT,
    'stuck_sensor': chain.STUCK_SENSOR,
    'amplifier_trip': chain.AMPLIFIER_TRIP,
}

_ROWS = {row.name: row for row in PARAMETERS}
_SWITCHES = {f'effects.{effect.name}': effect for effect in EFFECTS}
_LONGEST_FAULT = 2**62  # its ticks are an integer of 64 bits
_LONGEST_DELAY = 1.0  # history kept for the transport delay [s]


@dataclass(frozen=True)
class Snapshot:
    """Complete state of a plant; see `Plant.snapshot`."""

    state: npt.NDArray[Any]
    history: FloatArray


class Plant:
    """Piezo actuator with amplifier, structure and sensor, simulated in discrete time.

    Parameters
    ----------
    parameters : mapping of str to float or bool, optional
        Values and ``effects.*`` switches that differ from the defaults.
    rate : float
        Sampling rate of commands and readings [Hz].
    seed : int
        Seed of all noise.
    preset : Preset, optional
        Initial preset; without one, a linear actuator of 100 µm/V.
    refine : int
        Number of times that every integration step is halved, for numerical tests.

    Raises
    ------
    PlantError
        If the rate, a name or a value is invalid.
    """

    def __init__(
        self,
        parameters: Mapping[str, float | bool] | None = None,
        *,
        rate: float = 1000.0,
        seed: int = 0,
        preset: Preset | None = None,
        refine: int = 0,
    ) -> None:
        if not (math.isfinite(rate) and 1.0 <= rate <= 1e6):
            raise PlantError(f'the rate must lie within 1 .. 1e6 Hz, got {rate:g}')
        self.rate = float(rate)
        self.preset = preset or Preset()
        self._seed = seed
        self._refine = refine
        self._values = self.preset.values()
        self._switches = self.preset.switches()
        self._state = np.zeros(1, STATE_TYPE)
        self._history = np.zeros(int(_LONGEST_DELAY * rate) + 3)
        self._one_command, self._one_reading = np.zeros(1), np.zeros(1)
        values, switches = self._merged({**self.preset.parameters, **(parameters or {})})
        self._install(values, switches)
        self.reset()

    @classmethod
    def from_preset(
        cls,
        name: str,
        rate: float | None = None,
        seed: int = 0,
        overrides: Mapping[str, float | bool] | None = None,
        refine: int = 0,
    ) -> Plant:
        """Return the actuator of the preset `name`.

        Raises
        ------
        PresetError
            If the preset is unknown; the message lists the available ones.
        """
        preset = load_preset(name)
        return cls(overrides, rate=rate or preset.rate, seed=seed, preset=preset, refine=refine)

    # -- running -----------------------------------------------------------------------------

    def exchange(self, voltage: float) -> float:
        """Return the reading [m] of this tick, then hold `voltage` [V] until the next.

        A command that is not a number or outside the range of the amplifier is rejected and
        counted (`refused`); the previous voltage is held.
        """
        self._one_command[0] = voltage
        self._run(self._one_command, self._one_reading)
        return float(self._one_reading[0])

    def run(self, voltages: npt.ArrayLike) -> FloatArray:
        """Return the readings [m] for an array of commands [V], shape (n,).

        The result is bit-identical to repeated calls of `exchange`.
        """
        commands = np.ascontiguousarray(voltages, dtype=np.float64)
        if commands.ndim != 1:
            raise PlantError(f'commands must be a list of voltages, got {commands.ndim} axes')
        readings = np.empty_like(commands)
        self._run(commands, readings)
        return readings

    def _run(self, commands: FloatArray, readings: FloatArray) -> None:
        chain.run(commands, readings, self._parameters, self._derived, self._state, self._history)

    def bind(self, state: npt.NDArray[Any], history: FloatArray) -> None:
        """Keep the state in these arrays from now on: one kernel runs the plants of all axes."""
        state[:], history[:] = self._state, self._history
        self._state, self._history = state, history

    @property
    def history_size(self) -> int:
        """Number of past commands that are kept."""
        return self._history.size

    @property
    def packed(self) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Parameters and derived numbers of the kernel, shape (1,) each."""
        return self._parameters, self._derived

    def reset(self, seed: int | None = None) -> None:
        """Reset to rest at 0 V and tick 0, with the same noise unless `seed` is given."""
        if seed is not None:
            self._seed = seed
        self._state[:] = 0
        self._state['seed'] = np.uint64(self._seed & 0xFFFFFFFFFFFFFFFF)
        self._history[:] = 0.0
        self._settle()

    def inject(self, fault: str, duration: float = 0.0) -> None:
        """Inject a fault from the next tick on, for `duration` [s]; 0 means until changed.

        ``sensor_dropout`` reads not-a-number, ``stuck_sensor`` repeats the last reading,
        ``amplifier_trip`` discharges the actuator and ignores commands, ``none`` removes the
        fault.
        """
        if fault not in FAULTS:
            raise PlantError(f'there is no fault {fault!r}; there are {", ".join(FAULTS)}')
        if not 0.0 <= duration * self.rate <= _LONGEST_FAULT:
            raise PlantError(f'the duration of a fault cannot be {duration:g} s: 0 until changed')
        self._state['fault'] = FAULTS[fault]
        self._state['fault_ticks'] = round(duration * self.rate) if duration > 0.0 else -1

    # -- state -------------------------------------------------------------------------------

    @property
    def tick(self) -> int:
        """Number of the next tick."""
        return int(self._state['tick'][0])

    @property
    def refused(self) -> int:
        """Number of rejected commands since the last reset."""
        return int(self._state['refused'][0])

    @property
    def command(self) -> float:
        """Present command after the limits [V]."""
        return float(self._state['command'][0])

    @property
    def command_range(self) -> tuple[float, float]:
        """Lowest and highest accepted command [V]."""
        return self._values['amplifier.range_low'], self._values['amplifier.range_high']

    @property
    def voltage(self) -> float:
        """Present voltage at the actuator [V]."""
        return float(self._state['voltage'][0])

    @property
    def displacement(self) -> float:
        """Present true displacement, without sensor [m]."""
        return float(chain.displacement(self._derived[0], self._state[0]))

    @property
    def fault(self) -> str:
        """Active fault."""
        return next(name for name, code in FAULTS.items() if code == self._state['fault'][0])

    def snapshot(self) -> Snapshot:
        """Return a copy of the complete state."""
        return Snapshot(self._state.copy(), self._history.copy())

    def restore(self, snapshot: Snapshot) -> None:
        """Restore a `snapshot` of this plant."""
        self._state[:] = snapshot.state
        self._history[:] = snapshot.history

    # -- parameters --------------------------------------------------------------------------

    @property
    def parameter_table(self) -> tuple[PlantParameter, ...]:
        """All parameters with unit, bounds and description.

        The defaults are those of the preset.
        """
        return self.preset.table()

    @property
    def effect_table(self) -> tuple[PlantEffect, ...]:
        """All effects; the switch of each is the parameter ``effects.<name>``."""
        return EFFECTS

    @property
    def parameters(self) -> dict[str, float | bool]:
        """Present value of every parameter and of every switch ``effects.<name>``."""
        return {**self._values, **{f'effects.{name}': on for name, on in self._switches.items()}}

    @property
    def effects(self) -> dict[str, bool]:
        """State of every effect switch."""
        return dict(self._switches)

    @property
    def idle_effects(self) -> str:
        """Active effects without influence, with a remedy; empty if there are none."""
        if self._derived['active'][0][0]:
            return ''
        idle = [
            f'effects.{effect.name}'
            for effect in EFFECTS
            if self._switches[effect.name]
            and any(name in structure.FORCES and self._values[name] for name in effect.neutral)
        ]
        if not idle:
            return ''
        return (
            f'{" and ".join(idle)} without effect: the first mode, on which such a force acts, is '
            'off; switch effects.resonance on'
        )

    def switch(self, effect: str, on: bool = True) -> None:
        """Switch one effect on or off."""
        self.set_parameters({f'effects.{effect}': on})

    def set_parameters(self, changes: Mapping[str, object]) -> None:
        """Change parameters and switches during operation.

        Displacement and velocity stay continuous.

        All values are checked first; after an error no parameter is changed.

        Raises
        ------
        PlantError
            If a name is unknown, a value out of range, or the combination impossible.
        """
        values, switches = self._merged(changes)
        if values == self._values and switches == self._switches:
            return
        before = self.displacement
        drive, were_active = float(self._state['drive'][0]), self._derived['active'][0].copy()
        if self._parameters['sensor']['bandwidth'][0] == 0.0:
            self._state['filtered'] = before  # initial state of a low-pass that is switched on
        self._install(values, switches)
        self._keep_steady(before, drive, were_active)

    def check(self, changes: Mapping[str, object]) -> None:
        """Raise the errors of `set_parameters` without any change."""
        self._merged(changes)

    def _merged(self, changes: Mapping[str, object]) -> tuple[dict[str, float], dict[str, bool]]:
        values, switches = dict(self._values), dict(self._switches)
        for name, value in changes.items():
            if name in _SWITCHES:
                if not isinstance(value, (bool, np.bool_)):
                    raise PlantError(f'{name} is a switch: true or false, got {value!r}')
                switches[_SWITCHES[name].name] = bool(value)
            elif name in _ROWS:
                values[name] = checked(_ROWS[name], value)
            else:
                guess = near(name, [*_ROWS, *_SWITCHES])
                raise PlantError(f'the plant has no parameter {name!r}{guess}')
        derive.check(derive.effective(values, switches), switches)
        return values, switches

    def _install(self, values: dict[str, float], switches: dict[str, bool]) -> None:
        effective = derive.effective(values, switches)
        self._parameters = derive.pack(effective)
        self._derived = derive.derive(effective, switches, 1.0 / self.rate, self._refine)
        self._values, self._switches = values, switches

    def _settle(self) -> None:
        self._state['widening'] = 1.0
        chain.settle(self._parameters, self._derived, self._state)

    def _keep_steady(
        self, displacement: float, drive: float, were_active: npt.NDArray[np.int64]
    ) -> None:
        """Keep displacement and drive continuous over a change of the parameters."""
        s, d = self._state[0], self._derived[0]
        for i in range(1, d['active'].size):  # a mode that is switched off decays freely
            d['active'][i] |= d['omega'][i] > 0.0 and (s['x'][i] != 0.0 or s['v'][i] != 0.0)
        d['dynamic'] = bool(np.any(d['active']))
        if not d['active'][0]:
            s['x'][0] = s['v'][0] = 0.0
        s['residue'] = 0.0
        chain.settle(self._parameters, self._derived, self._state)
        s['residue'] = drive - s['drive']
        s['drive'] = drive
        gap = displacement - self.displacement
        fresh = np.flatnonzero((d['active'] != 0) & (were_active == 0))
        if fresh.size:
            s['x'][fresh[0]] += gap
        elif d['static_share'] != 0.0:
            s['residue'] += gap / d['static_share']
            s['drive'] += gap / d['static_share']
        if not d['nonlinear'] or 0 in fresh:
            s['bristle'], s['yielding'] = 0.0, s['x'][0]


def checked(row: PlantParameter, value: object) -> float:
    """Return a value within the bounds of its row."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.number)):
        raise PlantError(f'{row.name} is a number in {row.unit}, got {value!r}')
    number = float(value)
    if not row.low <= number <= row.high:
        raise PlantError(
            f'{row.name} = {number:g} {row.unit} is outside {row.low:g} .. {row.high:g}: '
            f'{row.description}'
        )
    return number
