"""What a verb does with one set of data: load, work, write; returns its row of the table.

The verbs `identify` and `discover` themselves run these, so that a batch does the same by
construction. A task is a frozen description that any process or cluster worker can be sent.
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

# What a task needs is imported when it works: a process that only sends tasks starts faster.

Progress = Callable[[float, str], None]
Row = dict[str, Any]


def silent(fraction: float, words: str) -> None:
    """Tell nobody."""


class Task(Protocol):
    """Work on one set of data; anything that can be pickled and has these."""

    @property
    def verb(self) -> str:
        """Its name in titles."""

    @property
    def files(self) -> tuple[str, ...]:
        """Files besides the data on which the result depends."""

    def settings(self) -> dict[str, Any]:
        """Everything else on which the result depends, fit for JSON."""

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
        Of the searches.
    hold, start : mapping of str to float
        Parameters to fix, and start values, in SI units.
    before : sequence of float
        Extremes of the voltage before each record [V].
    warm_up : float, optional
        Seconds that errors leave out; those of the records where not given.
    frequency : float, optional
        Of the drive [Hz], for records that do not say theirs.
    held_out : sequence of str
        Data that are not fitted: the discrepancy of the model is judged on them.
    options : mapping
        Further arguments of the method.
    actuator : str, optional
        Which one, where a bag holds several.
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
        """The model file, where the model is one, and what is held out."""
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
        from piezo_hysteresis.identification.methods import base_of
        from piezo_hysteresis.identification.settings import driven_at, warmed
        from piezo_hysteresis.models.choice import chosen
        from piezo_hysteresis.records import load
        from piezo_hysteresis.reporting.folder import check_folder
        from piezo_hysteresis.reporting.identification_folder import write_identification

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
        write_identification(out, found, records, data)
        return found


@dataclass(frozen=True)
class Discover:
    """Find what a model misses.

    Attributes
    ----------
    baseline : str
        ``NAME[+BLOCK...]`` of a model, or the path of a ``model.yaml``.
    seed : int
        Of every random choice.
    workers : int
        Threads; the verdict does not depend on it.
    warm_up : float, optional
        Seconds that errors leave out; those of the records where not given.
    actuator : str, optional
        Which one, where a bag holds several.
    salvage : bool
        Use what is readable of damaged data.
    reference : tuple of str
        Data of the actuator as it was: what the baseline misses there is no news.
    begins, zero : str
        How records begin and where their zeros lie, see `identification.circumstances.Choices`.
    policy : mapping of str to float
        Numbers that decide, where they are not those of `discovery.selection.policy`.
    time_limit : float
        After which nothing more is started; 0 for none [s].
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
        """The baseline, where it is a file, and the reference."""
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
        from piezo_hysteresis.identification.settings import require_settings, warmed
        from piezo_hysteresis.models.choice import chosen
        from piezo_hysteresis.records import load
        from piezo_hysteresis.reporting.discovery_folder import write_discovery
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
    """Return what a table says of an identification; parameters last, in SI units."""
    worst = max(found.records, key=lambda row: largest_if_unknown(row.nrmse_percent))
    row: Row = {
        'model': found.model.name,
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
    """Return what a table says of a discovery."""
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
    """Refuse data that are given twice, for two ends that exclude each other."""
    both = {Path(each).resolve() for each in data} & {Path(each).resolve() for each in held_out}
    if both:
        raise IdentificationError(f'{min(both).name} {both_text}; give it once')


def _is_file(text: str) -> bool:
    return text.endswith(('.yaml', '.yml'))


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
