"""Presets: one commented YAML file per actuator, in the source tree or the installation.

A preset lists the active effects and the known parameters; every other parameter is the default of
its table, scaled to the voltage and displacement of the actuator.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.wording import near, reason_of
from piezo_sim.flexure import Flexure, FlexureError
from piezo_sim.layout import EFFECTS, PARAMETERS
from piezo_sim.plant_parameters import NOMINAL_DISPLACEMENT, NOMINAL_VOLTAGE, PlantParameter
from piezo_sim.simulation_errors import PresetError


@dataclass(frozen=True)
class Preset:
    """Preset of one actuator.

    Attributes
    ----------
    name, description, source : str
        Name, description, and source of the parameters.
    voltage : float
        Usual drive amplitude [V].
    displacement : float
        Displacement amplitude at this drive [m]; scale of the integration errors.
    bias : float
        Usual mean voltage [V].
    rate : float
        Sampling rate of the original experiment [Hz].
    phase : float
        Initial phase of drives and references [rad]; -pi/2 starts at the minimum.
    parameters : mapping of str to float
        Parameters that differ from the scaled defaults.
    effects : tuple of str
        Active effects.
    flexure : Flexure or None
        Guide that the actuator bends, if the preset contains its dimensions. The stiffness of the
        load, and the free gain of the actuator from the gain measured with the guide, are computed
        from it.
    """

    name: str = 'straight_line'
    description: str = 'An actuator without any imperfection.'
    source: str = ''
    voltage: float = NOMINAL_VOLTAGE
    displacement: float = NOMINAL_DISPLACEMENT
    bias: float = 0.0
    rate: float = 1000.0
    phase: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    effects: tuple[str, ...] = ()
    flexure: Flexure | None = None

    def table(self) -> tuple[PlantParameter, ...]:
        """Return every parameter with its default for this actuator."""
        rows = []
        for row in PARAMETERS:
            scaled = row.scaled(self.voltage, self.displacement)
            rows.append(replace(row, default=float(self.parameters.get(row.name, scaled))))
        return tuple(rows)

    def values(self) -> dict[str, float]:
        """Return the value of every parameter of this actuator."""
        return {row.name: row.default for row in self.table()}

    def switches(self) -> dict[str, bool]:
        """Return the state of every effect switch."""
        return {effect.name: effect.name in self.effects for effect in EFFECTS}


# What the presets of each folder of config are of.
KINDS = {'presets': 'one axis', 'axes': 'several axes'}


def preset_folders(kind: str = 'presets') -> tuple[Path, ...]:
    """Return the search path of presets, in order of priority."""
    folders = [parent / 'config' / kind for parent in Path(__file__).resolve().parents]
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    folders += [
        Path(prefix) / 'share' / 'piezo_sim' / 'config' / kind
        for prefix in (*filter(None, prefixes), sys.prefix)
    ]
    return tuple(folder for folder in folders if folder.is_dir())


def preset_names(kind: str = 'presets') -> tuple[str, ...]:
    """Return the names of all presets, in alphabetical order."""
    files = [file for folder in preset_folders(kind) for file in folder.glob('*.yaml')]
    return tuple(sorted({file.stem for file in files}))


def load_preset(name: str) -> Preset:
    """Return the preset with the given name.

    Raises
    ------
    PresetError
        If the preset is unknown or its file is invalid.
    """
    return read_preset(preset_file(name))


def preset_file(name: str, kind: str = 'presets') -> Path:
    """Return the file of a preset."""
    for folder in preset_folders(kind):
        file = folder / f'{name}.yaml'
        if file.is_file() and file.parent == folder:
            return file
    other = next(each for each in KINDS if each != kind)
    if name in preset_names(other):
        raise PresetError(f'{name} is a preset of {KINDS[other]}, not of {KINDS[kind]}')
    known = ', '.join(preset_names(kind)) or f'none: the folder config/{kind} was not found'
    if preset_names(other):
        known += f'; {KINDS[other]}: {", ".join(preset_names(other))}'
    guess = near(name, preset_names(kind))
    raise PresetError(f'there is no preset {name!r}{guess}; there are {known}')


def read_preset(file: Path) -> Preset:
    """Return the preset described by a YAML file."""
    return preset_of(file, content_of(file))


def content_of(file: Path) -> dict[str, Any]:
    """Return the content of a YAML file, a mapping."""
    try:
        content = plain_yaml.load_file(file)
    except (OSError, yaml.YAMLError) as error:
        raise PresetError(f'preset {file.name} cannot be read: {reason_of(error)}') from error
    if not isinstance(content, dict):
        raise PresetError(f'preset {file.name} must be a mapping of names to values')
    return content


def preset_of(file: Path, content: dict[str, Any]) -> Preset:
    """Return the preset of the content of a file."""
    known = set(Preset.__dataclass_fields__) - {'name'}
    stray = sorted(set(content) - known)
    if stray:
        raise PresetError(
            f'preset {file.name} has the unknown key {stray[0]!r}; known are '
            f'{", ".join(sorted(known))}'
        )
    effects = content.get('effects') or []
    parameters = content.get('parameters') or {}
    if not isinstance(effects, list) or not isinstance(parameters, dict):
        raise PresetError(f'preset {file.name}: effects is a list, parameters is a mapping')
    _check_names(file, 'effect', effects, {effect.name for effect in EFFECTS})
    _check_names(file, 'parameter', list(parameters), {row.name for row in PARAMETERS})
    parameters = {key: _number(file, key, value) for key, value in parameters.items()}
    flexure = None
    if 'flexure' in content:
        flexure, bent = _flexure(file, content['flexure'], parameters)
        parameters = {**parameters, **bent}
    return Preset(
        name=file.stem,
        description=str(content.get('description', '')).strip(),
        source=str(content.get('source', '')).strip(),
        parameters=parameters,
        effects=tuple(effects),
        flexure=flexure,
        **{key: _number(file, key, content[key]) for key in _NUMBERS if key in content},
    )


def _flexure(
    file: Path, content: Any, parameters: Mapping[str, float]
) -> tuple[Flexure, dict[str, float]]:
    """Return the guide and the parameters computed from it."""
    if not isinstance(content, dict):
        raise PresetError(f'preset {file.name}: flexure is a mapping of dimensions')
    given = {str(key): _number(file, f'flexure {key}', value) for key, value in content.items()}
    loaded = given.pop('loaded_gain', None)
    known = set(Flexure.__dataclass_fields__)
    wrong = sorted((known - {'hinges'} - set(given)) | (set(given) - known))
    if wrong:
        raise PresetError(
            f'preset {file.name}: flexure lacks or does not know {", ".join(wrong)}; it has '
            f'{", ".join(sorted(known))} and loaded_gain'
        )
    try:
        guide = Flexure(**{**given, 'hinges': int(given.get('hinges', 8))})  # type: ignore[arg-type]
    except FlexureError as error:
        raise PresetError(f'preset {file.name}: {error}') from error
    bent = {'structure.load_stiffness': guide.stiffness}
    if loaded is not None:
        if 'structure.stiffness' not in parameters:
            raise PresetError(f'preset {file.name}: loaded_gain takes structure.stiffness')
        bent['actuator.gain'] = loaded / guide.left(parameters['structure.stiffness'])
    doubled = sorted(set(bent) & set(parameters))
    if doubled:
        raise PresetError(
            f'preset {file.name}: {", ".join(doubled)} follows from the flexure; give one of them'
        )
    return guide, bent


_NUMBERS = ('voltage', 'displacement', 'bias', 'rate', 'phase')


def _number(file: Path, key: str, value: object) -> float:
    if isinstance(value, (int, float, str)) and not isinstance(value, bool):
        try:  # YAML 1.1 parses 1e-6 as a string
            return float(value)
        except ValueError:
            pass
    raise PresetError(f'preset {file.name}: {key} is not a number: {value!r}')


def _check_names(file: Path, kind: str, names: list[Any], known: set[str]) -> None:
    for name in names:
        if name not in known:
            guess = near(str(name), known)
            raise PresetError(f'preset {file.name}: there is no {kind} {name!r}{guess}')
