"""Damage in data: refused, or repaired and counted when salvaging."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeVar

from piezo_hysteresis.errors import DataNote, PiezoError, RecordError

R = TypeVar('R')

SALVAGE_HINT = 'keep what is readable with --salvage (in Python salvage=True)'


class DamageWarning(UserWarning):
    """Data were omitted or repaired while reading."""


class DamageError(RecordError):
    """Damage that is refused, with the advice to salvage the rest; `unadvised` is without it."""

    def __init__(self, sentence: str, remedy: str) -> None:
        self.unadvised = f'{sentence}; {remedy}' if remedy else sentence
        super().__init__(f'{self.unadvised}{", or" if remedy else ";"} {SALVAGE_HINT}')


class LeftOutWarning(DataNote):
    """A record that was cancelled, refused or run again was left out."""


@dataclass(frozen=True)
class Damage:
    """One finding.

    Attributes
    ----------
    where : str
        File or record.
    what : str
        The damage and its treatment.
    count : int
        Number of affected samples, messages or positions.
    lost : int
        Number of samples or messages missing from the result.
    """

    where: str
    what: str
    count: int = 1
    lost: int = 0

    def __str__(self) -> str:
        return f'{self.where}: {self.what}'


@dataclass
class DamageLog:
    """Collects findings on what it is `at`, or raises the first one as an error."""

    salvage: bool = False  # keep what is readable and list the findings
    interpolate: bool = False  # an uneven rate is no damage, because the data are resampled
    findings: list[Damage] = field(default_factory=list)  # damage in the order of detection
    notes: list[Damage] = field(default_factory=list)  # notes without loss of data
    left_out: list[Damage] = field(default_factory=list)  # notes on rejected records
    guesses: list[Damage] = field(default_factory=list)  # notes on guessed columns
    # notes on values that are improbable
    unlikely_values: list[Damage] = field(default_factory=list)
    where: str = ''  # what the findings are on

    def at(self, where: object) -> DamageLog:
        """Return this log for findings on a file or record; the lists are the same."""
        return replace(self, where=str(where))

    def add(
        self, what: str, *, count: int = 1, lost: int = 0, remedy: str = '', done: str = ''
    ) -> None:
        """List a finding, and its treatment `done` to salvage the rest."""
        what = ' '.join(what.split())  # libraries report in several lines
        if not self.salvage:
            raise DamageError(f'{self.where}: {what}', remedy)
        text = f'{what}: {done}' if done else what
        self.findings.append(Damage(self.where, text, count, lost))

    def refuse(self, what: str) -> None:
        """Raise a finding that no salvage mends, or list it where all are listed."""
        if not self.salvage:
            raise RecordError(f'{self.where}: {what}')
        self.findings.append(Damage(self.where, what))

    def note(self, what: str, *, count: int = 1) -> None:
        """List a note that does not prevent the use of the data."""
        self.notes.append(Damage(self.where, what, count))

    def leave_out(self, what: str, *, count: int = 1) -> None:
        """List a record that is omitted because a marker rejects it."""
        self.note(what, count=count)
        self.left_out.append(self.notes[-1])

    def unlikely(self, what: str) -> None:
        """List a note that the checks before a fit repeat as a warning."""
        self.note(what)
        self.unlikely_values.append(self.notes[-1])

    def guess(self, what: str) -> None:
        """List a guess, once."""
        if not any((each.where, each.what) == (self.where, what) for each in self.guesses):
            self.note(what)
            self.guesses.append(self.notes[-1])


def read_advised(
    read: Callable[[DamageLog], R], log: DamageLog, usable: Callable[[R], object] = bool
) -> R:
    """Return what is read; advise to salvage only where that leaves something usable."""
    try:
        return read(log)
    except DamageError as error:
        try:
            helps = bool(usable(read(DamageLog(True, log.interpolate))))
        except PiezoError:
            helps = False
        if helps:
            raise
        raise RecordError(error.unadvised) from None
