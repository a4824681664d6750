"""`identify` and `discover` on any data: those of the Python interface, the verbs and batches."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, overload

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.axes_discovery import AxesDiscovery, discover_axes
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.modal_search import ModalIdentification, identify_axes
from piezo_hysteresis.discovery import Discovery
from piezo_hysteresis.discovery import discover as discover_in
from piezo_hysteresis.discovery.choose import choose_model
from piezo_hysteresis.discovery.selection.policy import POLICY
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification import Identification
from piezo_hysteresis.identification import identify as identify_in
from piezo_hysteresis.identification.checks import require_each_usable
from piezo_hysteresis.identification.identify import evaluated_on
from piezo_hysteresis.identification.initial_conditions.record_start import preceded
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.identification.method_settings import driven_at, require_settings, warmed
from piezo_hysteresis.identification.methods import base_of
from piezo_hysteresis.identification.per_frequency import identify_per_frequency
from piezo_hysteresis.interface.axes_runs import MODES, is_several, several_records
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.choice import ModelLike, chosen
from piezo_hysteresis.records import Record, listed
from piezo_hysteresis.records.columns import ReadOptions
from piezo_hysteresis.records.load import Source, interval, loaded

Progress: TypeAlias = Callable[[float, str], None]
Data: TypeAlias = Source | Iterable[Source]


@overload
def identify(data: Any, model: Literal['modes'], **options: Any) -> ModalIdentification: ...


@overload
def identify(data: Data, model: ModelLike | None = None, **options: Any) -> Identification: ...


def identify(
    data: Data,
    model: ModelLike | None = None,
    *,
    method: str = 'output_error',
    dt: float | None = None,
    fs: float | None = None,
    hold: Mapping[str, float] | None = None,
    start: Mapping[str, float] | None = None,
    before: Sequence[float] | FloatArray = (),
    warm_up: float | None = None,
    frequency: float | None = None,
    held_out: Data = (),
    actuator: str | None = None,
    salvage: bool = False,
    reading: ReadOptions | None = None,
    per_frequency: bool = False,
    seed: int = 0,
    workers: int = 1,
    progress: Progress = lambda fraction, words: None,
    **options: Any,
) -> Identification | ModalIdentification:
    """Identify a model from data.

    Parameters
    ----------
    data : Record, path, folder, pattern, arrays, data frame, or sequence of them
        Fitted jointly; `load` describes what is accepted.
    model : str, Path, Model or Identification, optional
        ``NAME[+BLOCK...]``, or a model with values (or its path), from which the fit starts. By
        default the model is selected: effects are added while they lower the error on the last
        30 % of the records, which are then fitted as a whole. ``'modes'`` is the model of several
        coupled axes; `data` are then as for `load_axes`, and of the other parameters only `dt`,
        `fs`, `workers` and `progress` are used.
    method : str
        One of `METHODS`.
    dt, fs : float, optional
        Sampling interval [s] or rate [Hz] of arrays without a time.
    hold, start : mapping of str to float, optional
        Parameters that are not fitted, and start values, in SI units.
    before : sequence of float or ndarray, shape (k,)
        Extremes of the voltage before each record [V].
    warm_up : float, optional
        Initial time that is excluded from errors [s]; default that of the records.
    frequency : float, optional
        Frequency of the drive [Hz], for records without one.
    held_out : as `data`
        Data that are not fitted, on which the discrepancy of the model is evaluated.
    actuator : str, optional
        Name of the actuator, if a bag has several.
    salvage : bool
        Use the readable part of damaged data.
    reading : ReadOptions, optional
        What files do not state: interval, sign, unit, decimal mark, clock.
    per_frequency : bool
        Identify one more model for each drive (frequency and amplitude) of the records; it
        replaces the model of all records at its frequency.
    seed : int
        Seed of the searches.
    workers : int
        Threads; the result does not depend on it.
    progress : callable
        Called with ``(fraction, words)``.
    **options
        Arguments of the method, such as ``begins='rest'``; see `identification.output_error`.

    Returns
    -------
    Identification, or ModalIdentification of several axes
        Also without convergence: check `converged` and `warnings`.

    Raises
    ------
    PiezoError
        If the data are unusable, there is no such model, or a setting is invalid; the message
        states the remedy.
    """
    given = dict(locals())
    if is_several(data, model):
        return _identify_modes(data, model, given)
    _require_apart(data, held_out, 'is fitted and held out')
    base_of(method)
    chosen_model = None if model is None else chosen(_model_not_data(model))
    files = _stated(reading, dt, fs)
    records = _read(data, files, actuator, salvage)
    records = driven_at(warmed(records, warm_up), frequency)
    if len(before):
        levels = tuple(map(float, before))
        records = [preceded(record, levels) for record in records]
    unseen = []
    if _given(held_out):
        unseen = driven_at(warmed(_read(held_out, files, actuator, salvage), warm_up), frequency)
        require_each_usable(unseen)  # before a fit of minutes
    if start:
        options['start'] = dict(start)
    if chosen_model is None:
        chosen_model, options = _selected(records, method, options, progress, workers)
    identifying = identify_per_frequency if per_frequency else identify_in
    found = identifying(
        records, chosen_model, method=method, hold=hold, seed=seed, workers=workers,
        progress=progress,
        **options,
    )  # fmt: skip
    return evaluated_on(found, unseen) if unseen else found


@overload
def discover(data: Sequence[AxesRecord], baseline: str, **options: Any) -> AxesDiscovery: ...


@overload
def discover(data: Any, baseline: Literal['modes'], **options: Any) -> AxesDiscovery: ...


@overload
def discover(data: Data, baseline: ModelLike, **options: Any) -> Discovery: ...


def discover(
    data: Any,
    baseline: ModelLike,
    *,
    reference: Data = (),
    repeats: Data = (),
    dt: float | None = None,
    fs: float | None = None,
    warm_up: float | None = None,
    actuator: str | None = None,
    salvage: bool = False,
    reading: ReadOptions | None = None,
    begins: str = 'auto',
    zero: str = 'auto',
    policy: Mapping[str, float] | None = None,
    time_limit: float = math.inf,
    seed: int = 0,
    workers: int = 1,
    progress: Progress = lambda fraction, words: None,
    **options: Any,
) -> Discovery | AxesDiscovery:
    """Search the effects that a model lacks in data.

    Parameters
    ----------
    data : Record, path, folder, pattern, arrays, data frame, or sequence of them
        Of one actuator at one rate; `load` describes what is accepted.
    baseline : str, Path, Model or Identification
        A name is fitted to the data. The values of a model, a file or a result stay fixed; records
        from which it was identified cannot show a new effect and are excluded. Of several axes
        (records of `load_axes`) it is ``'gain'`` or ``'modes'``, as in `identify`.
    reference : as `data`
        Data of the same actuator in its earlier state; a residual of the baseline on them is not
        reported.
    repeats : as `data`
        Data of the same actuator with nothing changed, at least two records of one drive. They
        calibrate what counts as new.
    dt, fs : float, optional
        Sampling interval [s] or rate [Hz] of arrays without a time.
    warm_up : float, optional
        Initial time that is excluded from errors [s]; default that of the records.
    actuator : str, optional
        Name of the actuator, if a bag has several.
    salvage : bool
        Whether the readable part of damaged data is used.
    reading : ReadOptions, optional
        What files do not state: interval, sign, unit, decimal mark, clock.
    begins, zero : str
        Initial condition (``auto``, ``rest``, ``step``, ``settled``, ``estimate``) and zero
        (``record``, ``common``, ``auto``) of the records.
    policy : mapping of str to float, optional
        Thresholds that differ from those of `docs/reference/policy.md`.
    time_limit : float
        Time after which no further step is started [s]; 0 for none.
    seed : int
        Seed of every random choice.
    workers : int
        Threads; the verdict does not depend on it.
    progress : callable
        Called with ``(fraction, words)``.
    **options
        Further arguments of `discovery.discover`.

    Raises
    ------
    PiezoError
        If the records cannot be evaluated, or the model is unknown; the message states what to
        record.
    """
    given = dict(locals())
    if is_several(data, baseline):
        return _discover_axes(data, str(baseline), given)
    require_settings(seed=seed, workers=workers)
    POLICY.but(**(policy or {}))
    _require_apart(data, reference, 'is judged and the reference')
    _require_apart(data, repeats, 'is judged and a repeat')
    name = str(baseline) if isinstance(baseline, str | Path) else ''
    model = chosen(_model_not_data(baseline))
    files = _stated(reading, dt, fs)
    records = warmed(_read(data, files, actuator, salvage), warm_up)
    earlier, unchanged = (
        warmed(_read(each, files, actuator, salvage), warm_up) for each in (reference, repeats)
    )
    return discover_in(
        records, model, name=name, reference=earlier, repeats=unchanged, begins=begins, zero=zero,
        policy=policy, time_limit=time_limit or math.inf, seed=seed, workers=workers,
        progress=progress, **options,
    )  # fmt: skip


def _identify_modes(data: Any, model: Any, given: dict[str, Any]) -> ModalIdentification:
    """Return the modal model of data of several axes."""
    if model != MODES:
        raise IdentificationError("records of several axes have the model 'modes'; name it")
    options, progress = _of_call(given, 'data', 'model'), given['progress']
    records = several_records(data, options, _defaults(identify))
    return identify_axes(
        records, modes=options.get('modes'), effects=options.get('effects'),
        workers=given['workers'], progress=lambda share: progress(share, 'adds effects'),
    )  # fmt: skip


def _discover_axes(data: Any, baseline: str, given: dict[str, Any]) -> AxesDiscovery:
    options, progress = _of_call(given, 'data', 'baseline'), given['progress']
    records = several_records(data, options, _defaults(discover))
    return discover_axes(
        records, baseline, workers=given['workers'],
        progress=lambda share: progress(share, 'adds effects'),
    )  # fmt: skip


def _of_call(given: dict[str, Any], *positional: str) -> dict[str, Any]:
    """Return the named arguments of a call."""
    named = {name: value for name, value in given.items() if name not in (*positional, 'options')}
    return {**named, **given['options']}


def _defaults(function: Callable[..., Any]) -> dict[str, Any]:
    return {name: each.default for name, each in inspect.signature(function).parameters.items()}


def _selected(
    records: Sequence[Record],
    method: str,
    options: Mapping[str, Any],
    progress: Progress,
    workers: int,
) -> tuple[Model, dict[str, Any]]:
    """Return the model that predicts best, and the options of its fit."""
    if method != 'output_error':
        raise IdentificationError(f'{method} needs a model; name one, such as classical')
    if len({record.rate for record in records}) > 1:
        raise IdentificationError('the records have different rates; give those of one rate')
    choices = RecordAssumptions(options.get('begins', 'auto'), options.get('zero', 'auto'))
    choice = choose_model(
        records, lambda share, words: progress(0.7 * share, words), choices, workers
    )
    start = {**choice.start, **options.get('start', {})}
    return choice.model, {'count': 1, **options, 'start': start}


def _stated(reading: ReadOptions | None, dt: float | None, fs: float | None) -> ReadOptions:
    """Return what is stated about the files; `dt` or `fs` give the interval, too."""
    files, step = reading or ReadOptions(), interval(dt, fs)
    return files if step is None else replace(files, interval=step)


def _read(
    data: Data, files: ReadOptions, actuator: str | None = None, salvage: bool = False
) -> list[Record]:
    if files == ReadOptions() and actuator is None and not salvage:
        return listed(data)
    return loaded(data, files, salvage, actuator) if _given(data) else []


def _given(data: Data) -> bool:
    return not (isinstance(data, (list, tuple)) and not data)


def _model_not_data(model: ModelLike) -> ModelLike:
    """Refuse arrays given as a model."""
    if hasattr(model, '__len__') and not isinstance(model, str):
        raise IdentificationError(
            'the second argument is a model; give arrays together, identify((voltage, '
            'displacement), dt=1e-3)'
        )
    return model


def _paths(data: Data) -> set[Path]:
    several = data if isinstance(data, (list, tuple)) else [data]
    return {Path(each).resolve() for each in several if isinstance(each, str | Path)}


def _require_apart(data: Data, other: Data, both_text: str) -> None:
    """Raise an error for data that are given for two exclusive purposes."""
    both = _paths(data) & _paths(other)
    if both:
        raise IdentificationError(f'{min(both).name} {both_text}; give it once')
