"""Assigns columns of a table by their names to time, voltage and displacement with a unit.

Every reader of named columns uses `assigned`. A standard name (``displacement_um``) is certain. A
quantity with its unit (``Weg [µm]``, ``Voltage (V)``) is accepted and reported, as is a unit alone
(``CH1 (V)``) if only one column has it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase

import numpy as np

from piezo_hysteresis.common.stated import CLOCKS
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError, SeveralAxesError


@dataclass(frozen=True)
class ReadOptions:
    """Statements about the files to be read.

    Attributes
    ----------
    columns : mapping of str to str
        ``NAME:UNIT`` or the number of a column, from 1, by quantity (or ``/topic.field:unit``).
    header_row : int or None
        Line of the column names of a text file, from 1.
    interval : float or None
        Sampling interval of files without a time [s]; a time that they have is not used.
    sign : float
        1, or -1 for a sensor that measures the distance.
    unit : str
        Unit of a displacement that states none.
    decimal : str
        Decimal mark of a text file, ``.`` or ``,``; empty: found from all cells.
    time_from : str
        ``recording`` or ``header`` for bags; empty: header stamps where they agree.
    axes : bool
        The files are of several axes: a column of ``voltage`` and ``displacement`` is then a
        pattern, ``u*`` or ``u*:mV``.

    Raises
    ------
    RecordError
        If a value is out of range.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    header_row: int | None = None
    interval: float | None = None
    sign: float = 1.0
    unit: str = ''
    decimal: str = ''
    time_from: str = ''
    axes: bool = False

    def __post_init__(self) -> None:
        step = self.interval
        if step is not None and not (
            isinstance(step, int | float) and np.isfinite(step) and step > 0
        ):
            raise RecordError(f'the interval (dt) must be a positive number [s], got {step!r}')
        if self.sign not in (1, -1):
            raise RecordError(f'the sign is 1 or -1, got {self.sign!r}')
        if self.decimal not in ('', '.', ','):
            raise RecordError(f'the decimal mark is . or , and not {self.decimal!r}')
        if self.time_from not in ('', *CLOCKS):
            raise RecordError(f'the time is from {" or ".join(CLOCKS)}, not {self.time_from!r}')


LENGTHS = {
    'm': 1.0, 'mm': 1e3, 'um': 1e6, 'µm': 1e6, 'μm': 1e6, 'nm': 1e9, 'cm': 1e2, 'Å': 1e10,
    'pm': 1e12,
}  # fmt: skip
# Divisors, not factors: x / 1e6 is the double nearest to x um, x * 1e-6 often is not.
UNITS = {
    'time': {
        's': 1.0, 'ms': 1e3, 'us': 1e6, 'µs': 1e6, 'μs': 1e6, 'ns': 1e9, 'min': 1 / 60,
        'h': 1 / 3600
    },
    'voltage': {'V': 1.0, 'mV': 1e3, 'uV': 1e6, 'µV': 1e6, 'μV': 1e6, 'kV': 1e-3},
    'force': {'N': 1.0, 'mN': 1e3, 'kN': 1e-3},
    'displacement': LENGTHS,
    'reference': LENGTHS,
    # proportional to the displacement, in any unit; a current is that of a charge
    'second': LENGTHS | {'V': 1.0, 'mV': 1e3},
    'charge': {'C': 1.0, 'mC': 1e3, 'uC': 1e6, 'µC': 1e6, 'nC': 1e9, 'pC': 1e12},
    'current': {'A': 1.0, 'mA': 1e3, 'uA': 1e6, 'µA': 1e6, 'nA': 1e9},
}  # fmt: skip
SECOND = ('second', 'charge', 'current')
SPELLED = {
    'sec': 's', 'secs': 's', 'second': 's', 'seconds': 's', 'sekunden': 's', 'sekunde': 's',
    'msec': 'ms', 'millisecond': 'ms', 'milliseconds': 'ms', 'usec': 'us', 'microsecond': 'us',
    'microseconds': 'us', 'nsec': 'ns', 'nanosecond': 'ns', 'nanoseconds': 'ns', 'minute': 'min',
    'minutes': 'min', 'hour': 'h', 'hours': 'h', 'volt': 'V', 'volts': 'V', 'millivolt': 'mV',
    'millivolts': 'mV', 'newton': 'N', 'meter': 'm', 'metre': 'm', 'micron': 'um', 'microns': 'um',
    'micrometer': 'um', 'micrometers': 'um', 'micrometre': 'um', 'nanometer': 'nm',
    'nanometers': 'nm', 'nanometre': 'nm', 'millimeter': 'mm', 'millimetre': 'mm',
    'angstrom': 'Å', 'å': 'Å', 'picometer': 'pm', 'mikrometer': 'um', 'millisekunden': 'ms',
    'mikrosekunden': 'us',
}  # fmt: skip
MEANT = {
    'time': ('t', 'zeit', 'uhrzeit', 'timestamp', 'stamp', 'seconds', 'temps', 'tempo'),
    'voltage': ('v', 'u', 'volt', 'volts', 'volatge', 'input', 'command', 'drive', 'spannung',
                'tension'),
    'force': ('f', 'load', 'kraft'),
    'displacement': ('x', 'y', 'pos', 'position', 'disp', 'displ', 'output', 'extension', 'stroke',
                     'deflection', 'weg', 'auslenkung', 'verschiebung', 'hub', 'laser'),
    'reference': ('r', 'ref', 'desired', 'setpoint', 'target', 'yd', 'soll', 'sollwert', 'command',
                  'commanded', 'demand'),
}  # fmt: skip
# LabVIEW, oscilloscopes of Keysight, PlotJuggler, `mcap cat`
FIXED = dict.fromkeys(('x_value', '__time', 'log_time'), ('time', 's'))
EXAMPLE = 'time_s,voltage_V,displacement_um'

CERTAIN, NAMED, BY_UNIT, NOT_ENOUGH = range(4)


@dataclass(frozen=True)
class Meaning:
    """Meaning assigned to a column."""

    what: str = ''  # quantity: a key of `UNITS`; empty if unknown
    unit: str = ''  # a key of ``UNITS[what]``; empty if unknown
    rank: int = NOT_ENOUGH  # certainty: `CERTAIN`, `NAMED`, `BY_UNIT` or `NOT_ENOUGH`


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
    meant = [what for stem in stems for what in MEANT if stem == what or stem in MEANT[what]]
    for what in meant:  # the unit distinguishes an output voltage from an output
        if known := _unit(unit, what):
            return Meaning(what, known, NAMED)
    if stems and meant and (stems[0] == meant[0] or stems[0] in MEANT[meant[0]]):
        return Meaning(meant[0])
    for what in ('time', 'voltage', 'force', 'displacement'):
        if known := _unit(unit, what, exactly=True):
            return Meaning(what, known, BY_UNIT)
    return Meaning()


def _parts(name: str) -> tuple[str, str]:
    """Return a name without its unit, and the unit: in brackets, or behind it as in ``U/V``."""
    for pattern in (_STATED, r'(.*)[/,_]\s*(\S+)'):
        if found := re.fullmatch(pattern, name):
            return found[1], found[2]
    return name, ''


# a unit that is one, known or not: in brackets (``Time (in ms)``), or behind ``in`` or `` / ``
_STATED = r'(.*?)(?:\s+in\s+|\s+/\s+|[\(\[{<]\s*(?:in\s+)?)([^\(\)\[\]{}<>/]*?)\s*[\)\]}>]?\s*'


def unit_known(text: str) -> bool:
    """Return whether a text is a unit of any quantity, perhaps in brackets."""
    bare = text.strip().strip('()[]{}<>').strip()
    return any(_unit(bare, what) for what in UNITS)


def _unit(text: str, what: str, *, exactly: bool = False) -> str:
    """Return the unit of a quantity in the spelling of `UNITS`; empty if it is none.

    Upper and lower case differ only without the name of the quantity: S is siemens, but ``Time
    (S)`` is seconds. MV is no mV.
    """
    text = SPELLED.get(text.lower(), text)
    huge = text[:1] == 'M' and what in ('voltage', 'force')
    for known in UNITS[what]:
        if text == known or (not exactly and not huge and text.lower() == known.lower()):
            return known
    return ''


def assigned(
    names: Sequence[str],
    where: object,
    *,
    chosen: Mapping[str, str],
    hints: Mapping[int, Meaning],
    length: str,
    needed: Sequence[str],
    of_file: bool = True,
) -> tuple[dict[int, tuple[str, str]], str]:
    """Return quantity and unit of the columns by position, and what was assumed."""
    meanings = meanings_of(names, hints, length)
    by_hand, assumed = _chosen(names, meanings, chosen, length, where)
    found: dict[int, tuple[str, str]] = dict(by_hand)
    uncertain = []
    for what in UNITS:
        meant = [k for k, m in enumerate(meanings) if m.what == what and k not in found]
        rank = min((meanings[k].rank for k in meant), default=NOT_ENOUGH)
        if what in chosen or rank == NOT_ENOUGH:
            continue
        places = [k for k in meant if meanings[k].rank == rank]
        if what == 'time' and rank == NAMED:
            del places[1:]  # one for each channel, as some programs write them
        if len(places) > 1 and rank == CERTAIN:
            raise RecordError(f'{where}: the column {what} stands twice; keep one of them')
        if len(places) > 1:
            uncertain.append(f'{what} may be {" or ".join(repr(names[k]) for k in places)}')
        else:
            found[places[0]] = (what, meanings[places[0]].unit)
    found = _one_input(found, meanings, by_hand, where)
    _refuse_axes(names, meanings, chosen, where)
    _require(found, names, meanings, uncertain, where, of_file, needed)
    guesses = [
        f'{what} from column {names[k]!r} in {unit.replace("u", "µ")}'
        for k, (what, unit) in found.items()
        if k in assumed or (k not in by_hand and meanings[k].rank != CERTAIN)
    ]
    return found, ', '.join(guesses)


def meanings_of(names: Sequence[str], hints: Mapping[int, Meaning], length: str) -> list[Meaning]:
    """Return what the columns mean; `length` is the unit of a displacement that states none."""
    if length and length not in LENGTHS:
        raise RecordError(f'{length!r} is no unit of a displacement; use {", ".join(LENGTHS)}')
    found = [hints.get(k) or meaning(name) for k, name in enumerate(names)]
    if not length:
        return found
    return [
        replace(m, unit=length, rank=NAMED)
        if not m.unit and m.what in ('displacement', 'reference') and not _stated(names[k])
        else m
        for k, m in enumerate(found)
    ]


# What distinguishes the channels of one quantity: a number, or a letter that stands alone.
_INDEX = r'(\d+|(?<![A-Za-z])[xyzXYZ](?![A-Za-z]))'


def alike(names: Sequence[str]) -> bool:
    """Return whether names differ in one number or in one letter x, y, z only."""
    parts = [re.split(_INDEX, name) for name in names]
    if len({len(each) for each in parts}) > 1:
        return False
    differ = [k for k, each in enumerate(zip(*parts, strict=True)) if len(set(each)) > 1]
    return len(differ) == 1 and differ[0] % 2 == 1 and len(set(names)) == len(names)


def in_order(names: Sequence[str], places: Sequence[int]) -> list[int]:
    """Return the places of names by their numbers: 2 before 10."""
    return sorted(
        places, key=lambda k: [(int(x), '') if x.isdigit() else (-1, x)
                               for x in re.split(r'(\d+)', names[k])]
    )  # fmt: skip


def _refuse_axes(
    names: Sequence[str], meanings: Sequence[Meaning], chosen: Mapping[str, str], where: object
) -> None:
    """Refuse columns of several axes, of which a reader of one axis would need one pair."""
    groups = []
    for what in ('voltage', 'displacement'):
        ranks = [m.rank for m in meanings if m.what == what]
        rank = min(ranks, default=BY_UNIT)
        places = [k for k, m in enumerate(meanings) if (m.what, m.rank) == (what, rank)]
        group = [names[k] for k in in_order(names, places)]
        if what in chosen or rank == BY_UNIT or (len(group) > 1 and not alike(group)):
            return
        groups.append((group, rank))
    counts = [len(group) for group, _ in groups]
    if max(counts) == 1 or (min(counts) == 1 and NOT_ENOUGH in [rank for _, rank in groups]):
        return
    raise several_axes(where, groups[0][0], groups[1][0])


def several_axes(
    where: object, voltages: Sequence[str], displacements: Sequence[str], take: str = ''
) -> SeveralAxesError:
    """Return the error with which data of several axes are refused by readers of one."""
    take = take or (
        f"`import FILE --voltage '{voltages[0]}' --displacement '{displacements[0]}' --out BAG`"
    )
    return SeveralAxesError(
        f'{where}: it has {counted_axes(len(voltages), len(displacements))} '
        f'({_range(voltages)}; {_range(displacements)}); use `identify --model '
        f'modes` for all of them (in Python ph.load_axes), or take one with {take}'
    )


def _range(names: Sequence[str]) -> str:
    return ', '.join(names) if len(names) <= 2 else f'{names[0]} to {names[-1]}'


def counted_axes(inputs: int, outputs: int) -> str:
    """Return the number of axes in words."""
    if inputs == outputs:
        return counted(inputs, 'axis')
    return f'{counted(inputs, "voltage")} and {counted(outputs, "displacement")}'


def _stated(name: str) -> str:
    """Return the text that stands where the unit of a column stands; empty if nothing does."""
    found = re.fullmatch(_STATED, name.strip())
    return found[2] if found else ''


def _chosen(
    names: Sequence[str],
    meanings: Sequence[Meaning],
    chosen: Mapping[str, str],
    length: str,
    where: object,
) -> tuple[dict[int, tuple[str, str]], set[int]]:
    """Return the columns that were named, and those whose unit is assumed."""
    found: dict[int, tuple[str, str]] = {}
    assumed = set()
    for what, text in chosen.items():
        name, unit = text, ''
        if name not in names:
            stem, colon, tail = text.rpartition(':')
            name, unit = (stem, tail) if colon else (text, '')
        place = list(names).index(name) if name in names else -1
        if place < 0 and name.isdigit():
            place = int(name) - 1
        if not 0 <= place < len(names):
            raise RecordError(f'{where}: it has no column {name!r}, but {", ".join(names)[:160]}')
        if unit and not _unit(unit, what):
            raise RecordError(f'{unit!r} is no unit of a {what}; use {", ".join(UNITS[what])}')
        if place in found:
            raise RecordError(
                f'{where}: column {names[place]!r} was named for {found[place][0]} and {what}'
            )
        own = _unit(meanings[place].unit, what) or _unit(_parts(names[place])[1], what)
        if not unit and not own and (stated := _stated(names[place])):
            raise RecordError(
                f'{where}: the unit {stated!r} of column {names[place]!r} is not known; write '
                f"--{what} '{names[place]}':UNIT with {', '.join(UNITS[what])}"
            )
        usual = length if what in ('displacement', 'reference') else ''
        if not unit and not own:
            assumed.add(place)
        found[place] = (what, _unit(unit, what) or own or usual or next(iter(UNITS[what])))
    return found, assumed


def _one_input(
    found: dict[int, tuple[str, str]],
    meanings: Sequence[Meaning],
    by_hand: Mapping[int, tuple[str, str]],
    where: object,
) -> dict[int, tuple[str, str]]:
    """Return the columns with a voltage or a force, the more certain of them."""
    inputs = sorted((-1 if k in by_hand else meanings[k].rank, k) for k, (what, _) in found.items()
                    if what in ('voltage', 'force'))  # fmt: skip
    if len(inputs) == 2 and inputs[0][0] == inputs[1][0]:
        raise RecordError(
            f'{where}: it has both a voltage and a force; keep the one that drives it'
        )
    return {k: v for k, v in found.items() if k not in [place for _, place in inputs[1:]]}


def _require(
    found: Mapping[int, tuple[str, str]],
    names: Sequence[str],
    meanings: Sequence[Meaning],
    uncertain: Sequence[str],
    where: object,
    of_file: bool,
    needed: Sequence[str],
) -> None:
    """Raise an error with the missing columns and how to name them."""
    known = {what for what, _ in found.values()}
    missing = [what for what in needed if what not in known]
    if 'force' in known and 'voltage' in missing:
        missing.remove('voltage')
    if not missing:
        return
    unclear = [f'rename {name!r} to {m.what}_{_usual(m.what)} (or its unit)'
               for k, (name, m) in enumerate(zip(names, meanings, strict=True))
               if m.what in missing and m.rank == NOT_ENOUGH and k not in found]  # fmt: skip
    advice = '; '.join([*uncertain, *unclear]) or f'columns are named like {EXAMPLE}'
    options = ' '.join(f'--{what} COLUMN:UNIT' for what in missing)
    last = f' and {missing[-1]}' if len(missing) > 1 else missing[-1]
    other = f', or use `import` with {options}' if of_file else ''
    if of_file and 'time' in missing:
        other += ' (--interval SECONDS if it has no time)'
    listed = ', '.join(repr(name) for name in names)[:120]
    raise RecordError(
        f'{where}: it has no column of {", ".join(missing[:-1])}{last} that is understood (its '
        f'columns are {listed}); {advice}{other}'
    )


def _usual(what: str) -> str:
    return 'um' if what in ('displacement', 'reference') else next(iter(UNITS[what]))


def stamped(name: str) -> Meaning:
    """Return what a column of dates is: a time in seconds, whatever unit its name states."""
    found = meaning(name)
    return Meaning('time', 's', found.rank if found.what == 'time' and found.unit else NAMED)


def with_unit(name: str, unit: str) -> str:
    """Return the name of a column with the unit that its file states next to it."""
    unit = unit.strip().strip('()[]{}<>').strip()
    if not unit or meaning(name).unit:
        return name
    return f'{name} ({unit})'


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
            stem = pattern_of(pattern, what)[0]
            places = [k for k, n in enumerate(names) if n == stem or fnmatchcase(n, stem)]
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


def second_column(text: str) -> dict[str, str]:
    """Return ``COLUMN[:UNIT]`` of a second channel by its quantity, which the unit states."""
    bare, _, tail = text.rpartition(':')
    unit = tail if bare else _parts(text.strip())[1]
    return {next((what for what in SECOND if _unit(unit, what)), SECOND[0]): text}


def pattern_of(text: str, what: str) -> tuple[str, str]:
    """Return the pattern and the unit of ``PATTERN[:UNIT]``."""
    stem, colon, unit = text.rpartition(':')
    return (stem, unit) if colon and unit in UNITS[what] else (text, '')


def channel(names: Sequence[str], place: int, unit: str) -> str:
    """Return how one column is named to the reader of one axis."""
    return f'{names[place]}:{unit}' if unit else names[place]


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
