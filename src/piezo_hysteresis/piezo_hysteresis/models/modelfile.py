"""Model files: readable YAML, and parameter files for ROS nodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.results import Plottable
from piezo_hysteresis.errors import ModelError, RecordError
from piezo_hysteresis.models.chain import Model
from piezo_hysteresis.models.correlation import Correlation
from piezo_hysteresis.models.discrepancy import Discrepancy
from piezo_hysteresis.models.model_actions import ModelActions
from piezo_hysteresis.models.named import named
from piezo_hysteresis.models.plain import (
    mapping,
    number,
    read_yaml,
    refuse_unknown,
    write_yaml,
    yaml_text,
)
from piezo_hysteresis.models.schedule import BY_FREQUENCY, OperatingRange, Schedule
from piezo_hysteresis.records.fingerprint import Fingerprint

SCHEMA = 'piezo_hysteresis/model/2'
_OF_SEVERAL = 'piezo_hysteresis/modes/'
#: Schema of the models of several axes, see `axes.modal_file`.
MODAL_SCHEMA = f'{_OF_SEVERAL}1'
#: Earlier schemas, without correlation and discrepancy. Note on the delay of the displacement
#: samples of the fitted data [s].
OFFSET_NOTE = 'sampling_offset_s'
#: Note on its standard deviation [s]; 0 if it was given and not fitted.
OFFSET_STD_NOTE = 'sampling_offset_std_s'

RosParameters = dict[str, float | str | list[str]]


@dataclass(frozen=True)
class Provenance:
    """Provenance of the values.

    Attributes
    ----------
    data : tuple of str
        Files or records that were fitted.
    date : str
        ISO 8601.
    fit : str
        Method and settings, to repeat the fit.
    rate : float or None
        Sampling rate of the data [Hz]; recursions such as `autoregressive` hold at this rate only.
    noise_floor : float or None
        Rms of the noise [m].
    free_run_rms : float or None
        rms of the free-run error on the fitted data [m].
    notes : mapping of str to str, float, int or bool
        Further notes.
    records : tuple of Fingerprint
        Fingerprints of the records from which the model was identified, or on which its
        discrepancy was evaluated.
    voltage : OperatingRange or None
        Range, slew rate and rest of the voltage of the fitted records.
    """

    data: tuple[str, ...] = ()
    date: str = ''
    fit: str = ''
    rate: float | None = None
    noise_floor: float | None = None
    free_run_rms: float | None = None
    notes: Mapping[str, str | float | int | bool] = field(default_factory=dict)
    records: tuple[Fingerprint, ...] = ()
    voltage: OperatingRange | None = None


@dataclass(frozen=True, repr=False)
class ModelFile(ModelActions, Plottable):
    """A model with the values of its parameters; `piezo_hysteresis.Model` is this class.

    Attributes
    ----------
    model : Model
        The chain.
    values : mapping of str to float
        Every parameter of the chain, in SI units.
    deviations : mapping of str to float
        Standard deviations of the fitted parameters, in the unit of the parameter.
    provenance : Provenance
        Provenance of the values.
    correlation : Correlation or None
        Correlation of the jointly fitted values.
    discrepancy : Discrepancy or None
        Known discrepancy of the model.
    schedule : Schedule or None
        Models of single drives, which replace the values at their frequency.

    Raises
    ------
    ModelError
        If a parameter is missing, unknown or out of range.
    """

    model: Model
    values: Mapping[str, float]
    deviations: Mapping[str, float] = field(default_factory=dict)
    provenance: Provenance = field(default_factory=Provenance)
    correlation: Correlation | None = None
    discrepancy: Discrepancy | None = None
    schedule: Schedule | None = None

    def __post_init__(self) -> None:
        missing = sorted(set(self.model.parameter_names) - set(self.values))
        if missing:
            raise ModelError(
                f'model {self.model.name} lacks a value for {", ".join(missing)}; add it under '
                'parameters'
            )
        stray = sorted(set(self.deviations) - set(self.model.parameter_names))
        if stray:
            raise ModelError(
                f'model {self.model.name} has no parameter {", ".join(stray)} to have a standard '
                'deviation; remove it'
            )
        lost = set(self.correlation.names if self.correlation else ()) - set(self.deviations)
        if lost:
            raise ModelError(
                f'the correlation names {", ".join(sorted(lost))} without a standard deviation; '
                'remove it or identify again'
            )
        self.model.pack(self.values)

    @classmethod
    def from_name(cls, name: str, **values: float) -> ModelFile:
        """Return a named model with the default values of its parameters.

        Parameters
        ----------
        name : str
            ``NAME[+BLOCK...]``, such as ``'classical'`` or ``'bouc_wen_mode+creep'``.
        **values : float
            Parameters that differ from their defaults, in SI units.

        Raises
        ------
        ModelError
            If there is no such model, block or parameter, or a value is impossible.
        """
        chain = named(name)
        numbers = {key: number(value, key) for key, value in values.items()}
        return cls(chain, chain.unpack(chain.pack(numbers)))

    def __repr__(self) -> str:
        lines = [f'Model {self.model.name}']
        lines += parameter_lines(self.model, self.values, self.deviations)
        if self.schedule is not None:
            lines.append(f'  and of its own at {", ".join(p.name for p in self.schedule.points)}')
        return '\n'.join(lines)

    def at(self, frequency: float, amplitude: float | None = None) -> ModelFile:
        """Return the model for a drive: of the nearest entry of the schedule, if it has one.

        Parameters
        ----------
        frequency : float
            Of the drive [Hz]; 0 for none returns the model itself.
        amplitude : float, optional
            Of its voltage [V]; the largest of the schedule by default.
        """
        if self.schedule is None or not frequency > 0.0:
            return self
        return self.schedule.at(frequency, amplitude).model

    def columns(self) -> dict[str, list[Any]]:
        """Return the parameters by column: parameter, value, std, unit, held."""
        return parameter_columns(self.model, self.values, self.deviations)

    def simulate(self, voltage: ArrayLike, dt: float, *, frequency: float = 0.0) -> FloatArray:
        """Return the displacement that a voltage causes, from rest at 0 V.

        Parameters
        ----------
        voltage : array_like, shape (n,)
            Commanded input [V], held from sample to sample.
        dt : float
            Sampling interval [s].
        frequency : float
            Fundamental frequency of the voltage [Hz], for blocks that depend on it, and for the
            entry of a schedule.

        Returns
        -------
        ndarray, shape (n,)
            Displacement [m]; sample k is measured before voltage k acts, as in a `Record`.

        Raises
        ------
        ModelError
            If the voltage is not a series of finite numbers, or the interval is not positive.
        """
        u = _series(voltage)
        if not (isinstance(dt, (int, float)) and np.isfinite(dt) and dt > 0):
            raise ModelError(f'the sampling interval must be a positive number [s], got {dt!r}')
        if self.schedule is not None and frequency > 0.0:
            own = self.at(frequency, 0.5 * float(np.ptp(u)))
            return own.simulate(u, dt, frequency=frequency)
        chain, state = self.model, None
        if chain.answers_at_once:  # at the end of a tick, which is the next sample
            u = np.concatenate([[0.0], u[:-1]])
            state = chain.initial_state(dt, -dt)
        return chain.respond(u, self.packed, dt, state=state, frequency=frequency)

    def covariance(self) -> tuple[tuple[str, ...], FloatArray]:
        """Return names and covariance of the fitted values, in SI units.

        Returns
        -------
        names : tuple of str
            Parameters with a standard deviation, in the order of the model.
        matrix : ndarray, shape (p, p)
            Diagonal if the file has no correlation.
        """
        names = tuple(name for name in self.model.parameter_names if name in self.deviations)
        matrix = np.diag([float(self.deviations[name]) ** 2 for name in names])
        if self.correlation is not None:
            at = [names.index(name) for name in self.correlation.names]
            matrix[np.ix_(at, at)] = self.correlation.covariance(self.deviations)
        return names, matrix

    @property
    def packed(self) -> FloatArray:
        """The values in the order in which `Model.respond` reads them."""
        return self.model.pack(self.values)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of the file as plain types."""
        parameters = {}
        for parameter in self.model.parameters:
            row: dict[str, Any] = {
                'value': float(self.values[parameter.name]),
                'unit': parameter.unit,
            }
            if parameter.name in self.deviations:
                row['std'] = float(self.deviations[parameter.name])
            if parameter.name in self.model.held:
                row['held'] = True
            parameters[parameter.name] = row
        provenance = asdict(self.provenance)
        provenance['data'] = list(self.provenance.data)
        provenance['notes'] = dict(self.provenance.notes)
        provenance['records'] = [each.to_dict() for each in self.provenance.records]
        more: dict[str, Any] = {}
        if self.correlation is not None:
            more['correlation'] = self.correlation.to_dict()
        if self.discrepancy is not None:
            more['discrepancy'] = self.discrepancy.to_dict()
        if self.schedule is not None:
            more['schedule'] = BY_FREQUENCY
            more['entries'] = self.schedule.to_dict()
        return {
            'schema': SCHEMA,
            'name': self.model.name,
            'chain': [block.name for block in self.model.blocks],
            'parameters': parameters,
            **more,
            'provenance': {k: v for k, v in provenance.items() if v not in (None, '', [], {})},
        }

    def text(self) -> str:
        """Return the model as YAML."""
        return yaml_text(self.to_dict())

    def save(self, path: str | Path) -> None:
        """Write the model as YAML, atomically.

        Raises
        ------
        ModelError
            If the file cannot be written.
        """
        write_yaml(self.to_dict(), path)

    @classmethod
    def load(cls, path: str | Path) -> ModelFile:
        """Read a model file, also an edited one.

        Raises
        ------
        ModelError
            If the file cannot be read, or an entry is unknown, missing or out of range.
        """
        content = read_yaml(path)
        try:
            return _from_dict(content)
        except ModelError as error:
            raise ModelError(f'{path}: {error}') from error

    @classmethod
    def parse(cls, text: str) -> ModelFile:
        """Read the text of a model file.

        Raises
        ------
        ModelError
            If an entry is unknown, missing or out of range.
        """
        try:
            return _from_dict(plain_yaml.load(text))
        except yaml.YAMLError as error:
            reason = str(error).replace('\n', ' ')
            raise ModelError(f'the text of the model is no YAML: {reason}') from error

    @property
    def sampling_offset(self) -> float:
        """Delay of the displacement samples of its data relative to the convention [s]."""
        return float(self.provenance.notes.get(OFFSET_NOTE, 0.0))

    @property
    def sampling_offset_std(self) -> float:
        """Standard deviation of the sampling offset [s]; infinite if the file has none."""
        return float(self.provenance.notes.get(OFFSET_STD_NOTE, inf))

    def to_ros_parameters(self, prefix: str = 'model') -> RosParameters:
        """Return flat node parameters: ``model.name``, ``model.chain``, ``model.<parameter>``."""
        floor = self.provenance.noise_floor
        return {
            f'{prefix}.noise_floor': 0.0 if floor is None else float(floor),
            f'{prefix}.sampling_offset': self.sampling_offset,
            f'{prefix}.name': self.model.name,
            f'{prefix}.chain': [block.name for block in self.model.blocks],
            f'{prefix}.held': sorted(self.model.held) or [''],
            **{
                f'{prefix}.{name}': float(self.values[name]) for name in self.model.parameter_names
            },
        }

    def save_ros_parameters(self, path: str | Path, prefix: str = 'model') -> None:
        """Write a parameter file for ``ros2 param load NODE FILE``, for a node of any name.

        Raises
        ------
        ModelError
            If the file cannot be written.
        """
        write_yaml({'/**': {'ros__parameters': self.to_ros_parameters(prefix)}}, path)

    @classmethod
    def from_ros_parameters(
        cls, parameters: Mapping[str, object], prefix: str = 'model'
    ) -> ModelFile:
        """Return the model from the output of `to_ros_parameters`.

        Raises
        ------
        ModelError
            If an entry is unknown, missing or out of range.
        """
        own = {
            key.removeprefix(f'{prefix}.'): value
            for key, value in parameters.items()
            if key.startswith(f'{prefix}.')
        }
        name, chain, held = own.pop('name', ''), own.pop('chain', None), own.pop('held', [])
        floor, late = own.pop('noise_floor', 0.0), own.pop('sampling_offset', 0.0)
        rows = {key: {'value': value} for key, value in own.items()}
        for key in held if isinstance(held, list) else []:
            if key:
                rows.setdefault(key, {})['held'] = True
        content = {'schema': SCHEMA, 'name': name, 'chain': chain, 'parameters': rows}
        provenance: dict[str, object] = {'noise_floor': floor} if floor else {}
        if late:
            provenance['notes'] = {OFFSET_NOTE: late}
        return _from_dict({**content, **({'provenance': provenance} if provenance else {})})


# The class has the name of the Python interface; `models.Model` is the chain alone.
ModelFile.__module__, ModelFile.__name__ = 'piezo_hysteresis', 'Model'
ModelFile.__qualname__, ModelFile.__init__.__qualname__ = 'Model', 'Model.__init__'


def parameter_lines(
    model: Model, values: Mapping[str, float], deviations: Mapping[str, float]
) -> list[str]:
    """Return a line for each parameter: name, value, standard deviation, unit."""
    lines = []
    for q in model.parameters:
        std = deviations.get(q.name)
        spread = '' if std is None else f' ± {std:.1g}'
        unit = '' if q.unit == '1' else f' {q.unit}'
        lines.append(f'  {q.name} = {values[q.name]:.4g}{spread}{unit}')
    return lines


def parameter_columns(
    model: Model, values: Mapping[str, float], deviations: Mapping[str, float]
) -> dict[str, list[Any]]:
    """Return parameters by column; std is None for a parameter that was not fitted."""
    rows = model.parameters
    return {
        'parameter': [q.name for q in rows],
        'value': [float(values[q.name]) for q in rows],
        'std': [deviations.get(q.name) for q in rows],
        'unit': [q.unit for q in rows],
        'held': [q.name in model.held for q in rows],
    }


def _series(voltage: ArrayLike) -> FloatArray:
    try:
        found = np.ascontiguousarray(voltage, dtype=np.float64)
    except (TypeError, ValueError):
        raise ModelError(
            f'the voltage must be a series of numbers [V], not of type {type(voltage).__name__}'
        ) from None
    if np.ndim(voltage) != 1 or not found.size or not np.all(np.isfinite(found)):
        raise ModelError(
            'the voltage must be a series of finite numbers [V], got an array of shape '
            f'{np.shape(voltage)}'
        )
    return found


_KEYS = {
    'schema', 'name', 'chain', 'parameters', 'correlation', 'discrepancy', 'provenance',
    'schedule', 'entries',
}  # fmt: skip


def is_there(path: str | Path) -> bool:
    """Return whether there is such a file; a name that is too long is none."""
    try:
        return Path(path).is_file()
    except OSError:
        return False


def is_modal(path: str | Path) -> bool:
    """Return whether there is such a file, of a model of several axes."""
    if not is_there(path):
        return False
    found = read_yaml(path)
    return isinstance(found, dict) and found.get('schema') == MODAL_SCHEMA


def _from_dict(content: object) -> ModelFile:
    whole = mapping(content, 'a model file')
    if str(whole.get('schema')).startswith(_OF_SEVERAL):
        raise ModelError(
            'it is a model of several axes, which `validate`, `discover`, `compensate`, `export`, '
            'the node `coupled` and Python take, but nothing that needs a model of one axis'
        )
    refuse_unknown(whole, _KEYS, 'the model file')
    if whole.get('schema') != SCHEMA:
        raise ModelError(f'schema is {whole.get("schema")!r}, expected {SCHEMA}; save it again')
    chain = whole.get('chain')
    if not isinstance(chain, list) or not chain:
        raise ModelError('chain must be a list of block names, from the voltage to the sensor')
    rows = mapping(whole.get('parameters'), 'parameters')
    model = Model(str(whole.get('name', '')), tuple(named_block(str(each)) for each in chain))
    refuse_unknown(rows, set(model.parameter_names), f'parameters of model {model.name}')
    values, deviations, held = {}, {}, {}
    for parameter in model.parameters:
        if parameter.name not in rows:
            continue  # ModelFile reports the missing ones
        row = mapping(rows[parameter.name], f'parameter {parameter.name}')
        refuse_unknown(row, {'value', 'unit', 'std', 'held'}, f'parameter {parameter.name}')
        if row.get('unit', parameter.unit) != parameter.unit:
            raise ModelError(
                f'{parameter.name} is in {row["unit"]}, expected {parameter.unit}; convert it'
            )
        values[parameter.name] = number(row.get('value'), parameter.name)
        if row.get('std') is not None:
            deviations[parameter.name] = number(row['std'], f'std of {parameter.name}')
        if row.get('held'):
            held[parameter.name] = values[parameter.name]
    return ModelFile(
        model.hold(**held),
        values,
        deviations,
        _provenance(whole.get('provenance', {})),
        Correlation.parse(whole['correlation']) if 'correlation' in whole else None,
        Discrepancy.parse(whole['discrepancy']) if 'discrepancy' in whole else None,
        _schedule(whole),
    )


def _schedule(whole: Mapping[str, Any]) -> Schedule | None:
    if 'schedule' not in whole and 'entries' not in whole:
        return None
    if whole.get('schedule') != BY_FREQUENCY:
        raise ModelError(
            f'schedule is {whole.get("schedule")!r}, expected {BY_FREQUENCY}; identify again'
        )

    def read(row: Mapping[str, Any]) -> ModelFile:
        if 'schedule' in row or 'entries' in row:
            raise ModelError('an entry of a schedule has no schedule of its own; remove it')
        return _from_dict({'schema': SCHEMA, **row})

    return Schedule.parse(whole.get('entries'), read)


def _provenance(content: object) -> Provenance:
    rows = mapping(content, 'provenance')
    refuse_unknown(rows, set(Provenance.__dataclass_fields__), 'provenance')
    numbers = {
        key: number(rows[key], f'provenance {key}')
        for key in ('rate', 'noise_floor', 'free_run_rms')
        if key in rows
    }
    data = rows.get('data', [])
    if not isinstance(data, list):
        raise ModelError('provenance data must be a list of names')
    return Provenance(
        data=tuple(str(each) for each in data),
        date=str(rows.get('date', '')),
        fit=str(rows.get('fit', '')),
        notes=dict(mapping(rows.get('notes', {}), 'provenance notes')),
        rate=numbers.get('rate'),
        noise_floor=numbers.get('noise_floor'),
        free_run_rms=numbers.get('free_run_rms'),
        records=tuple(_fingerprint(row) for row in rows.get('records', ())),
        voltage=OperatingRange.parse(rows['voltage']) if 'voltage' in rows else None,
    )


def _fingerprint(row: object) -> Fingerprint:
    try:
        return Fingerprint.parse(mapping(row, 'a row of provenance records'))
    except RecordError as error:
        raise ModelError(str(error)) from error
