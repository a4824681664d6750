"""What was wrong with data that were read: refused, or kept and counted when salvaging."""

from __future__ import annotations

from dataclasses import dataclass, field

from piezo_hysteresis.errors import DataNote, RecordError

SALVAGE_HINT = 'pass --salvage to keep what is readable'


class DamageWarning(UserWarning):
    """Something was left out or mended while data were read."""


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
        What is wrong, and what was done about it.
    count : int
        How many samples, messages or places are concerned.
    lost : int
        How many samples or messages are not in what was returned.
    """

    where: str
    what: str
    count: int = 1
    lost: int = 0

    def __str__(self) -> str:
        return f'{self.where}: {self.what}'


@dataclass
class DamageLog:
    """Collects findings, or turns the first one into an error.

    Attributes
    ----------
    salvage : bool
        Keep what is readable and list the findings; otherwise the first one raises.
    interpolate : bool
        An uneven rate is no damage: the reader asks for another rate anyway.
    findings : list of Damage
        What was wrong, in the order it was met.
    notes : list of Damage
        What should be said but costs nothing (a recording that was cut off between two flushes).
    left_out : list of Damage
        Those of the notes that tell of a record that does not count.
    guesses : list of Damage
        Those of the notes that tell what was taken for what.
    """

    salvage: bool = False
    interpolate: bool = False
    findings: list[Damage] = field(default_factory=list)
    notes: list[Damage] = field(default_factory=list)
    left_out: list[Damage] = field(default_factory=list)
    guesses: list[Damage] = field(default_factory=list)

    def add(
        self,
        where: object,
        what: str,
        *,
        count: int = 1,
        lost: int = 0,
        remedy: str = '',
        done: str = '',
    ) -> None:
        """List a finding, and what was `done` about it to salvage the rest.

        Raises
        ------
        RecordError
            Unless salvaging; the message ends with `remedy` and with the hint to salvage.
        """
        what = ' '.join(what.split())  # libraries report in several lines
        if not self.salvage:
            advice = f'{remedy}, or {SALVAGE_HINT}' if remedy else SALVAGE_HINT
            raise RecordError(f'{where}: {what}; {advice}')
        text = f'{what}: {done}' if done else what
        self.findings.append(Damage(str(where), text, count, lost))

    def note(self, where: object, what: str, *, count: int = 1) -> None:
        """List something that should be said but does not keep the data from being used."""
        self.notes.append(Damage(str(where), what, count))

    def leave_out(self, where: object, what: str, *, count: int = 1) -> None:
        """Note a record that is left out because its author says that it does not count."""
        self.note(where, what, count=count)
        self.left_out.append(self.notes[-1])

    def guess(self, where: object, what: str) -> None:
        """Note what was taken for what, once."""
        if not any((each.where, each.what) == (str(where), what) for each in self.guesses):
            self.note(where, what)
            self.guesses.append(self.notes[-1])

    @property
    def lost(self) -> int:
        """Samples or messages that are not in what was returned."""
        return sum(finding.lost for finding in self.findings)
