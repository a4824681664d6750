"""Simulated actuators of several axes in one body, and their presets.

A preset holds what all axes share (``common``, as a preset of one axis), what each one differs by
(``axes``), and what acts between them (``between``); see `parts.body`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from piezo_hysteresis.common.wording import near
from piezo_sim.layout import STATE_TYPE
from piezo_sim.parts import body
from piezo_sim.plant import Plant, checked
from piezo_sim.plant_parameters import PlantEffect, PlantParameter
from piezo_sim.presets import Preset, content_of, preset_file, preset_of
from piezo_sim.simulation_errors import PlantError, PresetError

FloatArray = npt.NDArray[np.float64]

FOLDER = 'axes'  # of the presets, in config
_KEYS = {'description', 'source', 'rate', 'voltage', 'displacement', 'common', 'axes', 'between'}

_COUPLING_TYPE = np.dtype(
    [
        *((name, 'f8') for name in ('own', 'softening', 'softening_reference', 'softening_time')),
        *((name, 'f8') for name in ('ferro', 'ferro_beta')),
        ('cross', 'f8', (body.AXES, body.AXES)),
        ('drive', 'f8', (body.BODY_MODES, body.AXES)),
        ('motion', 'f8', (body.BODY_MODES, body.AXES)),
        ('omega', 'f8', (body.BODY_MODES,)),
        ('zeta', 'f8', (body.BODY_MODES,)),
    ],
    align=True,
)
_BODY_TYPE = np.dtype(
    [
        ('q', 'f8', (body.BODY_MODES,)),
        ('v', 'f8', (body.BODY_MODES,)),
        ('elongation', 'f8', (body.AXES,)),
        *((name, 'f8', (body.AXES,)) for name in ('eta', 'gap', 'gap_before')),
        ('square', 'f8'),
    ],
    align=True,
)


@dataclass(frozen=True)
class AxesPreset:
    """Preset of several axes: that of each one, and what acts between them."""

    name: str
    description: str
    source: str
    axes: tuple[Preset, ...]
    parameters: Mapping[str, float]
    effects: tuple[str, ...]

    @property
    def rate(self) -> float:
        """Sampling rate [Hz]."""
        return self.axes[0].rate

    @property
    def voltage(self) -> float:
        """Usual drive amplitude [V]."""
        return self.axes[0].voltage

    @property
    def displacement(self) -> float:
        """Displacement amplitude at this drive [m]."""
        return self.axes[0].displacement


def load_axes_preset(name: str) -> AxesPreset:
    """Return the preset of several axes with the given name."""
    file = preset_file(name, FOLDER)
    content = content_of(file)
    stray = sorted(set(content) - _KEYS)
    each, common, between = (content.get(key) or {} for key in ('axes', 'common', 'between'))
    if stray or not isinstance(each, list) or not 2 <= len(each) <= body.AXES:
        raise PresetError(
            f'preset {file.name} must have a list of 2 to {body.AXES} axes and no other keys than '
            f'{", ".join(sorted(_KEYS))}'
        )
    shared = {key: content[key] for key in _KEYS - {'common', 'axes', 'between'} if key in content}
    axes = []
    for own in each:
        own = own or {}
        effects = [*common.get('effects', []), *own.get('effects', [])]
        parameters = {**common.get('parameters', {}), **own.get('parameters', {})}
        axes.append(preset_of(file, {**shared, 'effects': effects, 'parameters': parameters}))
    # the table of one axis gives the units their scale
    values = {
        row.name: row.scaled(axes[0].voltage, axes[0].displacement) for row in body.PARAMETERS
    }
    given, on = between.get('parameters') or {}, between.get('effects') or []
    known = {effect.name for effect in body.EFFECTS}
    strange = [name for name in given if name not in values] + [e for e in on if e not in known]
    if strange:
        guess = near(strange[0], [*values, *known])
        raise PresetError(f'preset {file.name}: there is no {strange[0]!r} between axes{guess}')
    values |= {name: float(value) for name, value in given.items()}
    return AxesPreset(
        file.stem, axes[0].description, axes[0].source, tuple(axes), values, tuple(on)
    )


class AxesPlant:
    """Actuators of several axes in one body, simulated in discrete time under one clock.

    Parameters are those of each axis, ``axis_1.actuator.gain`` and ``axis_1.effects.creep``, and
    those between the axes, ``cross_talk.share_1_to_2`` and ``effects.cross_talk_1_to_2``.

    Parameters
    ----------
    preset : AxesPreset
        What is simulated.
    rate : float, optional
        Sampling rate [Hz]; of the preset by default.
    seed : int
        Seed of all noise.
    overrides : mapping of str to float or bool, optional
        Parameters and switches that differ from the preset.

    Raises
    ------
    PlantError
        If a name or a value is invalid.
    """

    def __init__(
        self,
        preset: AxesPreset,
        rate: float | None = None,
        seed: int = 0,
        overrides: Mapping[str, float | bool] | None = None,
    ) -> None:
        self.preset, self.rate = preset, float(rate or preset.rate)
        self.plants = [Plant(rate=self.rate, preset=each) for each in preset.axes]
        count = len(self.plants)
        self._state = np.zeros(count, STATE_TYPE)
        size = 0 if not self.plants else self.plants[0].history_size
        self._histories = np.zeros((count, size))
        for i, plant in enumerate(self.plants):
            plant.bind(self._state[i : i + 1], self._histories[i])
        self._body, self._one = np.zeros(1, _BODY_TYPE), np.zeros(2)
        self._values = dict(preset.parameters)
        self._switches = {each.name: each.name in preset.effects for each in self.effect_table}
        self.reset(seed)
        self.set_parameters(overrides or {})
        self.reset()

    @classmethod
    def from_preset(
        cls,
        name: str,
        rate: float | None = None,
        seed: int = 0,
        overrides: Mapping[str, float | bool] | None = None,
    ) -> AxesPlant:
        """Return the actuators of the preset `name`."""
        return cls(load_axes_preset(name), rate, seed, overrides)

    @property
    def axes(self) -> int:
        """Number of axes."""
        return len(self.plants)

    @property
    def idle_effects(self) -> str:
        """Active effects of axes without influence, see `Plant.idle_effects`."""
        found = (
            f'axis {i}: {p.idle_effects}' for i, p in enumerate(self.plants, 1) if p.idle_effects
        )
        return '; '.join(found)

    @property
    def fault(self) -> str:
        """Active fault of the first axis that has one."""
        found = (plant.fault for plant in self.plants)
        return next((fault for fault in found if fault != 'none'), 'none')

    def inject(self, fault: str, duration: float = 0.0) -> None:
        """Inject a fault into all axes, ``axis_2.stuck_sensor`` into one; see `Plant.inject`."""
        own = re.fullmatch(r'axis_(\d+)\.(.*)', fault)
        if own is not None and not 1 <= int(own[1]) <= self.axes:
            raise PlantError(f'there is no axis {own[1]}: the plant has {self.axes}')
        plants = self.plants if own is None else [self.plants[int(own[1]) - 1]]
        for plant in plants:
            plant.inject(fault if own is None else own[2], duration)

    @property
    def command_range(self) -> tuple[float, float]:
        """Lowest and highest command [V] that all axes accept."""
        ranges = [plant.command_range for plant in self.plants]
        return max(low for low, _ in ranges), min(high for _, high in ranges)

    @property
    def parameter_table(self) -> tuple[PlantParameter, ...]:
        """Parameters between the axes, with unit, bounds and description."""
        rows = (row for row in body.PARAMETERS if self._has(row.name))
        return tuple(replace(row, default=self.preset.parameters[row.name]) for row in rows)

    @property
    def effect_table(self) -> tuple[PlantEffect, ...]:
        """Effects between the axes; the switch of each is ``effects.<name>``."""
        return tuple(row for row in body.EFFECTS if self._has(row.name))

    @property
    def effects(self) -> dict[str, bool]:
        """State of every switch between the axes."""
        return dict(self._switches)

    def _has(self, name: str) -> bool:
        """Return whether a name is of these axes: its numbers, but that of a mode, are theirs."""
        numbers = [int(each) for each in re.findall('(?<=_)\\d', name.removeprefix('body_'))]
        return all(each <= self.axes for each in numbers)

    @property
    def parameters(self) -> dict[str, float | bool]:
        """Present value of every parameter and of every switch."""
        found: dict[str, float | bool] = {}
        for i, plant in enumerate(self.plants, 1):
            found |= {f'axis_{i}.{name}': value for name, value in plant.parameters.items()}
        found |= {row.name: self._values[row.name] for row in self.parameter_table}
        return found | {f'effects.{name}': on for name, on in self._switches.items()}

    def set_parameters(self, changes: Mapping[str, object]) -> None:
        """Change parameters and switches during operation; an error changes nothing.

        Raises
        ------
        PlantError
            If a name is unknown, or a value out of range.
        """
        of_axes, values, switches = self._merged(changes)
        for plant, own in zip(self.plants, of_axes, strict=True):
            plant.set_parameters(own)
        self._values, self._switches = values, switches
        self._pack()

    def check(self, changes: Mapping[str, object]) -> None:
        """Raise the errors of `set_parameters` without any change."""
        self._merged(changes)

    def _merged(
        self, changes: Mapping[str, object]
    ) -> tuple[list[dict[str, object]], dict[str, float], dict[str, bool]]:
        of_axes: list[dict[str, object]] = [{} for _ in self.plants]
        values, switches = dict(self._values), dict(self._switches)
        rows = {row.name: row for row in self.parameter_table}
        for name, value in changes.items():
            axis, _, rest = name.partition('.')
            number = axis.removeprefix('axis_')
            if axis != number and number.isdecimal() and 1 <= int(number) <= self.axes:
                of_axes[int(number) - 1][rest] = value
            elif name in rows:
                values[name] = checked(rows[name], value)
            elif name.removeprefix('effects.') in switches and name.startswith('effects.'):
                if not isinstance(value, (bool, np.bool_)):
                    raise PlantError(f'{name} is a switch: true or false, got {value!r}')
                switches[name.removeprefix('effects.')] = bool(value)
            else:
                guess = near(name, list(self.parameters))
                raise PlantError(f'the plant has no parameter {name!r}{guess}')
        for plant, own in zip(self.plants, of_axes, strict=True):
            plant.check(own)
        return of_axes, values, switches

    def _pack(self) -> None:
        values = dict(self._values)
        for effect in self.effect_table:
            if not self._switches[effect.name]:
                values |= effect.neutral
        packed = [plant.packed for plant in self.plants]
        self._parameters = np.concatenate([each for each, _ in packed])
        self._derived = np.concatenate([each for _, each in packed])
        self._coupling = c = np.zeros(1, _COUPLING_TYPE)
        c['own'], c['softening'] = values['own.share'], values['softening.share']
        c['softening_reference'] = values['softening.reference']
        c['softening_time'] = values['softening.time_constant']
        c['ferro'], c['ferro_beta'] = (
            values['ferroelasticity.share'],
            values['ferroelasticity.beta'],
        )
        for k in range(body.BODY_MODES):
            c['omega'][0, k] = 2.0 * np.pi * values[f'body_{k + 1}.frequency']
            c['zeta'][0, k] = values[f'body_{k + 1}.damping_ratio']
            for i in range(self.axes):
                c['drive'][0, k, i] = values[f'body_{k + 1}.drive_{i + 1}']
                c['motion'][0, k, i] = values[f'body_{k + 1}.motion_{i + 1}']
        for i in range(self.axes):
            for j in range(self.axes):
                if i != j:
                    c['cross'][0, i, j] = values[f'cross_talk.share_{i + 1}_to_{j + 1}']

    def reset(self, seed: int | None = None) -> None:
        """Reset to rest at 0 V and tick 0, with the same noise unless `seed` is given."""
        self._body[:] = 0
        for i, plant in enumerate(self.plants):
            own = None
            if seed is not None:  # the noise of an axis is its own
                own = int(np.random.SeedSequence([seed, i]).generate_state(1, np.uint64)[0])
            plant.reset(own)

    def exchange(self, voltages: Sequence[float]) -> list[float]:
        """Return the reading [m] of each axis, then hold `voltages` [V] until the next tick."""
        return [float(each) for each in self.run([voltages])[0]]

    def run(self, voltages: npt.ArrayLike) -> FloatArray:
        """Return the readings [m] for commands [V], shape (n, axes) both.

        A reading is taken before the command of its tick acts.
        """
        commands = np.ascontiguousarray(voltages, dtype=np.float64)
        if commands.ndim != 2 or commands.shape[1] != self.axes:
            raise PlantError(
                f'commands must have the shape (n, {self.axes}), got {commands.shape}'
            )
        readings = np.empty_like(commands)
        body.run(
            commands, readings, self._parameters, self._derived, self._state, self._histories,
            self._coupling, self._body, self._one,
        )  # fmt: skip
        return readings
