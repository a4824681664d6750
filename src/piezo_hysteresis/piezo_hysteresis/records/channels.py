"""Which columns of a table are the voltages and displacements of several axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import (
    NOT_ENOUGH,
    UNITS,
    Meaning,
    alike,
    assigned,
    in_order,
    meanings_of,
)
from piezo_hysteresis.records.read_options import ReadOptions

QUANTITIES = ('voltage', 'displacement')


def used_columns(
    names: Sequence[str],
    where: object,
    options: ReadOptions,
    hints: Mapping[int, Meaning],
    timed: object,
) -> list[int]:
    """Return the columns that are read: time, voltages, displacements, reference."""
    chosen, several = dict(options.columns), set()
    if options.axes:
        channels = channels_of(names, where, options, hints)
        several = {place for places in channels.values() for place in places}
        chosen |= {what: channel(names, places[0], '') for what, places in channels.items()}
    found, _ = assigned(
        names, where, chosen=chosen, hints=hints, length=options.unit,
        needed=() if timed else ('time', *QUANTITIES),
    )  # fmt: skip
    return list({**found, **dict.fromkeys(several)})


def channels_of(
    names: Sequence[str], where: object, options: ReadOptions, hints: Mapping[int, Meaning]
) -> dict[str, list[int]]:
    """Return the columns of voltage and displacement, each in the order of their numbers.

    They match the pattern of their quantity in ``options.columns`` or, without one, are all of its
    columns that state a unit: one, or names that differ in one number (or letter x, y, z).
    """
    meanings = meanings_of(names, hints, options.unit)
    found = {}
    for what in QUANTITIES:
        if pattern := options.columns.get(what):
            places = _matching(names, pattern_of(pattern, what)[0])
            if not places:
                raise RecordError(
                    f'{where}: no column matches {pattern!r}; its columns are '
                    f'{", ".join(names)[:160]}'
                )
        else:
            places = _meant(names, meanings, what, where)
        found[what] = in_order(names, places)
    if both := set(found['voltage']) & set(found['displacement']):
        raise RecordError(
            f'{where}: column {names[min(both)]!r} is a voltage and a displacement; give '
            "narrower patterns, as in --voltage 'u*' --displacement 'y*'"
        )
    return found


def pattern_of(text: str, what: str) -> tuple[str, str]:
    """Return the pattern and the unit of ``PATTERN[:UNIT]``."""
    stem, colon, unit = text.rpartition(':')
    return (stem, unit) if colon and unit in UNITS[what] else (text, '')


def channel(names: Sequence[str], place: int, unit: str) -> str:
    """Return how one column is named to the reader of one axis."""
    return f'{names[place]}:{unit}' if unit else names[place]


def _matching(names: Sequence[str], pattern: str) -> list[int]:
    return [k for k, name in enumerate(names) if name == pattern or fnmatchcase(name, pattern)]


def _meant(
    names: Sequence[str], meanings: Sequence[Meaning], what: str, where: object
) -> list[int]:
    """Return the columns of a quantity by their names."""
    ranked = [(m.rank, k) for k, m in enumerate(meanings) if m.what == what]
    rank = min(ranked, default=(NOT_ENOUGH, 0))[0]
    places = [k for each, k in ranked if each == rank]
    listed = ', '.join(repr(names[k]) for k in places or range(len(names)))[:120]
    option = f"give them as --{what} 'PATTERN:UNIT' (in Python {what}='PATTERN:UNIT')"
    if not places:
        raise RecordError(
            f'{where}: it has no column of a {what} (its columns are {listed}); {option}'
        )
    if rank == NOT_ENOUGH:
        raise RecordError(f'{where}: its columns {listed} state no unit; {option}')
    if len(places) > 1 and not alike([names[k] for k in places]):
        raise RecordError(f'{where}: a {what} may be each of {listed}; {option}')
    return places
