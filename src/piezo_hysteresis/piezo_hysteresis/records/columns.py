"""Assigns columns of a table by their names to time, voltage and displacement with a unit.

Every reader of named columns uses `assigned`. A standard name (``displacement_um``) is certain. A
quantity with its unit (``Weg [µm]``, ``Voltage (V)``) is accepted and reported, as is a unit alone
(``CH1 (V)``) if only one column has it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from piezo_hysteresis.errors import RecordError

LENGTHS = {'m': 1.0, 'mm': 1e3, 'um': 1e6, 'µm': 1e6, 'μm': 1e6, 'nm': 1e9}
# Divisors, not factors: x / 1e6 is the double nearest to x um, x * 1e-6 often is not.
UNITS = {
    'time': {'s': 1.0, 'ms': 1e3, 'us': 1e6, 'µs': 1e6, 'μs': 1e6, 'ns': 1e9},
    'voltage': {'V': 1.0, 'mV': 1e3, 'kV': 1e-3},
    'force': {'N': 1.0, 'mN': 1e3, 'kN': 1e-3},
    'displacement': LENGTHS,
    'reference': LENGTHS,
}
SPELLED = {
    'sec': 's', 'secs': 's', 'second': 's', 'seconds': 's', 'sekunden': 's', 'msec': 'ms',
    'volt': 'V', 'volts': 'V', 'newton': 'N', 'meter': 'm', 'micron': 'um', 'microns': 'um',
    'micrometer': 'um', 'nanometer': 'nm',
}  # fmt: skip
MEANT = {
    'time': ('t', 'zeit', 'timestamp', 'stamp', 'seconds', 'temps', 'tempo'),
    'voltage': ('v', 'u', 'volt', 'volts', 'volatge', 'input', 'command', 'drive', 'spannung',
                'tension'),
    'force': ('f', 'load', 'kraft'),
    'displacement': ('x', 'y', 'pos', 'position', 'disp', 'displ', 'output', 'extension', 'stroke',
                     'deflection', 'weg', 'auslenkung', 'verschiebung', 'hub', 'laser'),
    'reference': ('r', 'ref', 'desired', 'setpoint', 'target', 'yd', 'soll', 'sollwert'),
}  # fmt: skip
FIXED = {'x_value': ('time', 's')}  # LabVIEW
EXAMPLE = 'time_s,voltage_V,displacement_um'

CERTAIN, NAMED, BY_UNIT, NOT_ENOUGH = range(4)


@dataclass(frozen=True)
class Meaning:
    """Meaning assigned to a column.

    Attributes
    ----------
    what : str
        Quantity: a key of `UNITS`; empty if unknown.
    unit : str
        A key of ``UNITS[what]``; empty if unknown.
    rank : int
        Certainty: `CERTAIN`, `NAMED`, `BY_UNIT` or `NOT_ENOUGH`.
    """

    what: str = ''
    unit: str = ''
    rank: int = NOT_ENOUGH


def meaning(name: str) -> Meaning:
    """Return quantity and unit of a column by its name."""
    name = name.strip()
    stem, _, tail = name.rpartition('_')
    if stem.lower() in UNITS:
        unit = _unit(tail, stem.lower())
        return Meaning(stem.lower(), unit, CERTAIN if unit else NOT_ENOUGH)
    if name.lower() in FIXED:
        return Meaning(*FIXED[name.lower()], NAMED)
    bare, unit = _parts(name)
    stems = [stem for stem in re.split(r'[\W\d_]+', bare.lower()) if stem]
    for what, spellings in MEANT.items():
        if stems and (stems[0] == what or stems[0] in spellings):
            known = _unit(unit, what)
            return Meaning(what, known, NAMED if known else NOT_ENOUGH)
    for what in ('time', 'voltage', 'force', 'displacement'):
        if known := _unit(unit, what, exactly=True):
            return Meaning(what, known, BY_UNIT)
    return Meaning()


def _parts(name: str) -> tuple[str, str]:
    """Return a name without its unit, and the unit: in brackets, or behind it as in ``U/V``."""
    for pattern in (r'(.*?)[\(\[{<]\s*([^\)\]}>]*?)\s*[\)\]}>]\s*', r'(.*)[/,_]\s*(\S+)'):
        if found := re.fullmatch(pattern, name):
            return found[1], found[2]
    return name, ''


def _unit(text: str, what: str, *, exactly: bool = False) -> str:
    """Return the unit of a quantity in the spelling of `UNITS`; empty if it is none.

    Upper and lower case differ only without the name of the quantity: S is siemens, but ``Time
    (S)`` is seconds.
    """
    text = SPELLED.get(text.lower(), text)
    for known in UNITS[what]:
        if text == known or (not exactly and text.lower() == known.lower()):
            return known
    return ''


def assigned(
    names: Sequence[str], where: object, *, of_file: bool = True
) -> tuple[dict[int, tuple[str, str]], str]:
    """Return quantity and unit of the columns by position, and the guesses.

    Parameters
    ----------
    names : sequence of str
        Of the columns.
    where : object
        File, for messages.
    of_file : bool
        Whether the columns are those of a file, which the verb `import` can name.

    Raises
    ------
    RecordError
        If time, voltage (or force) and displacement cannot be identified, or two columns are the
        same.
    """
    meanings = [meaning(name) for name in names]
    chosen: dict[int, tuple[str, str]] = {}
    uncertain = []
    for what in UNITS:
        rank = min((m.rank for m in meanings if m.what == what), default=NOT_ENOUGH)
        places = [k for k, m in enumerate(meanings) if (m.what, m.rank) == (what, rank)]
        if rank == NOT_ENOUGH:
            continue
        if what == 'time' and rank == NAMED:
            del places[1:]  # one for each channel, as some programs write them
        if len(places) > 1 and rank == CERTAIN:
            raise RecordError(f'{where}: the column {what} stands twice; keep one of them')
        if len(places) > 1:
            uncertain.append(f'{what} may be {" or ".join(repr(names[k]) for k in places)}')
        else:
            chosen[places[0]] = (what, meanings[places[0]].unit)
    chosen = _one_input(chosen, meanings, where)
    _require(chosen, names, meanings, uncertain, where, of_file)
    guesses = [
        f'{what} from column {names[k]!r} in {unit.replace("u", "µ")}'
        for k, (what, unit) in chosen.items()
        if meanings[k].rank != CERTAIN
    ]
    return chosen, ', '.join(guesses)


def _one_input(
    chosen: dict[int, tuple[str, str]], meanings: Sequence[Meaning], where: object
) -> dict[int, tuple[str, str]]:
    """Return the columns with a voltage or a force, the more certain of them."""
    inputs = sorted((meanings[k].rank, k) for k, (what, _) in chosen.items()
                    if what in ('voltage', 'force'))  # fmt: skip
    if len(inputs) == 2 and inputs[0][0] == inputs[1][0]:
        raise RecordError(
            f'{where}: it has both a voltage and a force; keep the one that drives it'
        )
    return {k: v for k, v in chosen.items() if k not in [place for _, place in inputs[1:]]}


def _require(
    chosen: Mapping[int, tuple[str, str]],
    names: Sequence[str],
    meanings: Sequence[Meaning],
    uncertain: Sequence[str],
    where: object,
    of_file: bool,
) -> None:
    """Raise an error with the missing columns and how to name them."""
    found = {what for what, _ in chosen.values()}
    missing = [what for what in ('time', 'voltage', 'displacement') if what not in found]
    if 'force' in found and 'voltage' in missing:
        missing.remove('voltage')
    if not missing:
        return
    unclear = [f'rename {name!r} to {m.what}_{_usual(m.what)} (or its unit)'
               for name, m in zip(names, meanings, strict=True)
               if m.what in missing and m.rank == NOT_ENOUGH]  # fmt: skip
    advice = '; '.join([*uncertain, *unclear]) or f'columns are named like {EXAMPLE}'
    options = ' '.join(f'--{what} COLUMN:UNIT' for what in missing)
    last = f' and {missing[-1]}' if len(missing) > 1 else missing[-1]
    other = f', or use `import` with {options}' if of_file else ''
    listed = ', '.join(repr(name) for name in names)[:120]
    raise RecordError(
        f'{where}: it has no column of {", ".join(missing[:-1])}{last} that is understood (its '
        f'columns are {listed}); {advice}{other}'
    )


def _usual(what: str) -> str:
    return 'um' if what in ('displacement', 'reference') else next(iter(UNITS[what]))


def renamed(names: Sequence[str], chosen: Mapping[str, str], where: object) -> list[str]:
    """Return the standard names of the chosen columns.

    Parameters
    ----------
    names : sequence of str
        Of the columns.
    chosen : mapping of str to str
        ``NAME:UNIT`` or the number of a column, from 1, by quantity. Without a unit, that of its
        name or the SI unit applies.
    where : object
        File, for messages.

    Raises
    ------
    RecordError
        If there is no such column or unit.
    """
    columns = list(names)
    for what, text in chosen.items():
        name, unit = text, ''
        if name not in names:
            stem, colon, tail = text.rpartition(':')
            name, unit = (stem, tail) if colon else (text, '')
        place = names.index(name) if name in names else -1
        if place < 0 and name.isdigit():
            place = int(name) - 1
        if not 0 <= place < len(names):
            raise RecordError(f'{where}: it has no column {name!r}, but {", ".join(names)[:160]}')
        if unit and unit not in UNITS[what]:
            raise RecordError(f'{unit!r} is no unit of a {what}; use {", ".join(UNITS[what])}')
        own = _unit(_parts(names[place])[1], what) or _unit(meaning(names[place]).unit, what)
        # a column assigned to it by name is then something else
        columns = ['' if meaning(each).what == what else each for each in columns]
        columns[place] = f'{what}_{unit or own or next(iter(UNITS[what]))}'
    return columns
