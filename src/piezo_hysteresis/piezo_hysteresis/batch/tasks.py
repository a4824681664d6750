"""Work of a verb on one set of data: load, compute, write; returns its row of the table.

The verbs `identify` and `discover` run these tasks, so that a batch gives the same results. A task
is an immutable description that can be sent to any process or cluster worker.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from piezo_hysteresis.arrays import largest_if_unknown
from piezo_hysteresis.errors import IdentificationError

if TYPE_CHECKING:
    from piezo_hysteresis.discovery import Discovery
    from piezo_hysteresis.identification import Identification
    from piezo_hysteresis.records import Record

# A task imports its modules when it works: a process that only sends tasks starts faster.

Progress = Callable[[float, str], None]
Row = dict[str, Any]


def silent(fraction: float, words: str) -> None:
    """Ignore the progress."""


class Task(Protocol):
    """Interface of work on one set of data; it must be picklable."""

    @property
    def verb(self) -> str:
        """Name in titles."""

    @property
    def files(self) -> tuple[str, ...]:
        """Further files on which the result depends."""

    def settings(self) -> dict[str, Any]:
        """Return all other settings on which the result depends, for JSON."""

    def __call__(self, data: Sequence[str], out: str) -> Row:
        """Work, write into the folder `out`, return columns of the table.

        Raises
        ------
        PiezoError
            If the data cannot be used.
        """


@dataclass(frozen=True)
class Identify:
    """Identify a model from records.

    Attributes
    ----------
    model : str
        ``NAME[+BLOCK...]``, or the path of a ``model.yaml`` to start from.
    method : str
        One of `piezo_hysteresis.identification.METHODS`.
    seed : int
        Seed of the searches.
    hold, start : mapping of str to float
        Parameters to fix, and start values, in SI units.
    before : sequence of float
        Extremes of the voltage before each record [V].
    warm_up : float, optional
        Warm-up [s]; default that of the records.
    frequency : float, optional
        Frequency of the drive [Hz], for records without one.
    held_out : sequence of str
        Data that are not fitted, on which the discrepancy of the model is evaluated.
    options : mapping
        Further arguments of the method.
    actuator : str, optional
        Name of the actuator, if a bag has several.
    """

    model: str
    method: str = 'output_error'
    seed: int = 0
    hold: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    before: Sequence[float] = ()
    warm_up: float | None = None
    frequency: float | None = None
    held_out: Sequence[str] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    actuator: str | None = None

    verb: ClassVar[str] = 'identify'

    @property
    def files(self) -> tuple[str, ...]:
        """The model file, if one is given, and the held-out data."""
        return (*((self.model,) if _is_file(self.model) else ()), *self.held_out)

    def settings(self) -> dict[str, Any]:
        """Return all fields."""
        return {'verb': self.verb, **asdict(self)}

    def __call__(self, data: Sequence[str], out: str) -> Row:
        """Identify, write the folder, return columns of the table."""
        return identification_row(self.work(data, out))

    def work(self, data: Sequence[str], out: str, progress: Progress = silent) -> Identification:
        """Identify and write the folder.

        Raises
        ------
        PiezoError
            If data, settings or folder cannot be used.
        """
        from piezo_hysteresis.identification import identify
        from piezo_hysteresis.identification.identify import evaluated_on
        from piezo_hysteresis.identification.initial_conditions.record_start import preceded
        from piezo_hysteresis.identification.method_settings import driven_at, warmed
        from piezo_hysteresis.identification.methods import base_of
        from piezo_hysteresis.models.choice import chosen
        from piezo_hysteresis.records import load
        from piezo_hysteresis.reporting.folder import check_folder
        from piezo_hysteresis.reporting.identification_report import write_identification

        check_folder(out, self.verb)
        _require_apart(data, self.held_out)
        base_of(self.method)
        model = chosen(self.model)
        records = load(data, actuator=self.actuator)
        records = driven_at(warmed(records, self.warm_up), self.frequency)
        if self.before:
            records = [preceded(record, self.before) for record in records]
        options = {**self.options, **({'start': dict(self.start)} if self.start else {})}
        found = identify(
            records,
            model,
            method=self.method,
            hold=self.hold,
            seed=self.seed,
            progress=progress,
            **options,
        )
        if self.held_out:
            unseen = warmed(load(self.held_out, actuator=self.actuator), self.warm_up)
            found = evaluated_on(found, driven_at(unseen, self.frequency))
        write_identification(out, found, found.data, data)
        return found


@dataclass(frozen=True)
class Discover:
    """Find effects that a model lacks.

    Attributes
    ----------
    baseline : str
        ``NAME[+BLOCK...]`` of a model, or the path of a ``model.yaml``.
    seed : int
        Seed of every random choice.
    workers : int
        Threads; the verdict does not depend on it.
    warm_up : float, optional
        Warm-up [s]; default that of the records.
    actuator : str, optional
        Name of the actuator, if a bag has several.
    salvage : bool
        Whether the readable part of damaged data is used.
    reference : tuple of str
        Data of the unchanged actuator, on which the discrepancy of the baseline is known.
    begins, zero : str
        Initial conditions and zeros of the records, see
        `identification.initial_conditions.revision.Choices`.
    policy : mapping of str to float
        Thresholds that differ from those of `discovery.selection.policy`.
    time_limit : float
        Time after which no further step is started; 0 for none [s].
    """

    baseline: str
    seed: int = 0
    workers: int = 1
    warm_up: float | None = None
    actuator: str | None = None
    salvage: bool = False
    reference: tuple[str, ...] = ()
    begins: str = 'auto'
    zero: str = 'auto'
    policy: Mapping[str, float] = field(default_factory=dict)
    time_limit: float = 0.0

    verb: ClassVar[str] = 'discover'

    @property
    def files(self) -> tuple[str, ...]:
        """The baseline, if it is a file, and the reference."""
        return (*((self.baseline,) if _is_file(self.baseline) else ()), *self.reference)

    def settings(self) -> dict[str, Any]:
        """Return all fields that the verdict depends on."""
        kept = {name: value for name, value in asdict(self).items() if name != 'workers'}
        return {'verb': self.verb, **kept}

    def __call__(self, data: Sequence[str], out: str) -> Row:
        """Discover, write the folder, return columns of the table."""
        return discovery_row(self.work(data, out))

    def work(self, data: Sequence[str], out: str, progress: Progress = silent) -> Discovery:
        """Discover and write the folder.

        Raises
        ------
        PiezoError
            If data, settings or folder cannot be used.
        """
        from piezo_hysteresis.discovery import discover
        from piezo_hysteresis.discovery.selection.policy import POLICY
        from piezo_hysteresis.identification.method_settings import require_settings, warmed
        from piezo_hysteresis.models.choice import chosen
        from piezo_hysteresis.records import load
        from piezo_hysteresis.reporting.discovery_report import write_discovery
        from piezo_hysteresis.reporting.folder import check_folder

        check_folder(out, self.verb)
        require_settings(seed=self.seed, workers=self.workers)
        POLICY.but(**self.policy)
        name = self.baseline
        baseline = chosen(name)
        records = load(data, actuator=self.actuator, salvage=self.salvage)
        before: list[Record] = []
        if self.reference:
            _require_apart(data, self.reference, 'is judged and the reference')
            before = load(self.reference, actuator=self.actuator, salvage=self.salvage)
            before = warmed(before, self.warm_up)
        found = discover(
            warmed(records, self.warm_up),
            baseline,
            name=name,
            seed=self.seed,
            workers=self.workers,
            reference=before,
            begins=self.begins,
            zero=self.zero,
            policy=self.policy,
            time_limit=self.time_limit or math.inf,
            progress=progress,
        )
        write_discovery(out, found, data)
        return found


def identification_row(found: Identification) -> Row:
    """Return the row of an identification; parameters last, in SI units."""
    worst = max(found.records, key=lambda row: largest_if_unknown(row.nrmse_percent))
    row: Row = {
        'model': found.chain.name,
        'method': found.method,
        'records': len(found.records),
        'converged': found.converged,
        'worst_record': worst.record,
        'nrmse_percent': _finite(worst.nrmse_percent),
        'free_run_rms_m': _finite(worst.free_run_rms),
        'noise_floor_rms_m': _finite(found.noise_floor),
        'condition': _finite(found.condition),
        'warnings': len(found.warnings),
    }
    for name, value in found.values.items():
        row[name] = _finite(value)
        if name in found.std:
            row[f'{name}_std'] = _finite(found.std[name])
    return row


def discovery_row(found: Discovery) -> Row:
    """Return the row of a discovery."""
    verdict = found.verdict
    return {
        'baseline': verdict.baseline,
        'records': len(found.data.records),
        'verdict': verdict.verdict,
        'effects': '; '.join(effect.name for effect in verdict.effects),
        'probability': min((e.probability for e in verdict.effects), default=None),
        'before_in_floors': _finite(verdict.held_out.before_in_floors),
        'after_in_floors': _finite(verdict.held_out.after_in_floors),
        'noise_floor_rms_m': _finite(verdict.noise_floor_rms_m),
        'unexplained': verdict.unexplained.description,
    }


def _require_apart(
    data: Sequence[str], held_out: Sequence[str], both_text: str = 'is fitted and held out'
) -> None:
    """Raise an error for data that are given for two exclusive purposes."""
    both = {Path(each).resolve() for each in data} & {Path(each).resolve() for each in held_out}
    if both:
        raise IdentificationError(f'{min(both).name} {both_text}; give it once')


def _is_file(text: str) -> bool:
    return text.endswith(('.yaml', '.yml'))


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
