"""Cells of text tables: what separates them, which mark is the decimal one, times of day."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence
from datetime import date

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError

SEPARATORS = ('\t', ';', ',', '|', '')  # the last one: spaces
_NUMBER = re.compile(r'[+-]?(?=[\d.,])[\d.,\' \u00a0\u202f\u2019]*(?:[eEdD][+-]?\d+)?$')
_STAMP = re.compile(
    r'(?:(?P<y>\d{4})[-/.](?P<m>\d\d?)[-/.](?P<d>\d\d?)'
    r'|(?P<a>\d\d?)(?P<mark>[./-])(?P<b>\d\d?)[./-](?P<year>\d{4}))?'
    r'[T ,]*(?P<hour>\d\d?):(?P<minute>\d\d):(?P<second>\d\d)(?:[.,:](?P<part>\d{1,9}))?'
    r'\s*(?P<half>AM|PM)?\s*(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?$',
    re.IGNORECASE,
)
_PLAIN = re.compile(r'[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?$', re.ASCII)
_TWO_POINTS = re.compile(r'\.[^\n]*\.')
_OTHER_THAN_PLAIN = re.compile(r'[^\d.eE+\n-]', re.ASCII)
HALF_DAY, DAY = 43_200, 86_400  # [s]


def split(line: str, separator: str) -> list[str]:
    """Return the cells of a line; a separator within quotes does not count."""
    if not separator:
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    return [cell.strip() for cell in cells]


def is_number(cell: str) -> bool:
    """Return whether a cell may be a number, with any decimal mark."""
    if _PLAIN.match(cell):
        return True
    bare = _bare(cell)
    return bool(_NUMBER.match(bare)) or bare.lower() in ('nan', 'inf', '-inf', '+inf')


def is_stamp(cell: str) -> bool:
    """Return whether a cell is a time of day, perhaps with a date."""
    return ':' in cell and _STAMP.match(cell.strip()) is not None


def _bare(cell: str) -> str:
    """Return a cell without quotes, and without the space behind a sign: ``+ 0.081``."""
    cell = cell.strip().strip('"').strip()
    return cell[0] + cell[1:].lstrip() if cell[:1] in ('+', '-') else cell


def separator_of(lines: Sequence[str]) -> str:
    """Return what separates the cells of lines of numbers; empty for spaces."""
    best, most = '', 0
    for mark in SEPARATORS:
        rows = [split(line, mark) for line in lines]
        widths = {len(row) for row in rows}
        filled = [[cell for cell in row if cell] for row in rows]
        good = sum(len(row) > 1 and sum(map(_is_cell, row)) >= 2 for row in filled)
        if good > most and len(widths) <= 2:
            best, most = mark, good
    return best if most else ','


def _is_cell(cell: str) -> bool:
    return is_number(cell) or is_stamp(cell)


def decimal_mark(cells: Iterable[str], where: object) -> tuple[str, bool]:
    """Return the decimal mark of a file, and whether the other mark groups thousands."""
    cells = list(cells)
    text = '\n'.join(cells)
    if ',' not in text and not _TWO_POINTS.search(text):
        return '.', False
    certain: set[str] = set()
    doubtful: dict[str, str] = {}
    grouped = False
    for cell in cells:
        bare = _bare(cell)
        if ('.' not in bare and ',' not in bare) or not _NUMBER.match(bare):
            continue
        marks = [letter for letter in bare if letter in '.,']
        whole, _, rest = bare.lstrip('+-').partition(marks[0])
        if len(set(marks)) == 2:
            certain.add(marks[-1])
            grouped = True
        elif len(marks) > 1:
            certain.add('.' if marks[0] == ',' else ',')
            grouped = True
        elif len(rest) != 3 or not 1 <= len(whole) <= 3 or whole[0] == '0':
            certain.add(marks[0])
        else:
            doubtful.setdefault(marks[0], bare)
    if len(certain) == 2 or (not certain and len(doubtful) == 2):
        raise RecordError(
            f'{where}: its numbers have decimal points and decimal commas; state which with '
            '--decimal , or --decimal .'
        )
    if certain:
        mark = certain.pop()
        return mark, grouped or bool(doubtful.keys() - {mark})
    if ',' in doubtful:
        raise RecordError(
            f'{where}: {doubtful[","]!r} may be {doubtful[","].replace(",", "")} or '
            f'{doubtful[","].replace(",", ".")}; state the decimal mark with --decimal , or '
            '--decimal .'
        )
    return '.', False


def numbers(cells: Sequence[str], mark: str) -> FloatArray:
    """Return cells as numbers; NaN for one that is none. Groups of three digits are joined."""
    if mark == '.' and not _OTHER_THAN_PLAIN.search('\n'.join(cells)):
        try:
            return np.array(list(map(float, cells)), dtype=np.float64)
        except ValueError:  # some of them are none
            pass
    other = '.' if mark == ',' else ','
    group = re.compile(rf"[+-]?\d{{1,3}}(?:[{re.escape(other)}' \u00a0\u202f\u2019]\d{{3}})+")
    found = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        bare = _bare(cell)
        whole, point, rest = bare.partition(mark)
        if group.fullmatch(whole):
            whole = re.sub(r'[^\d+-]', '', whole)
        try:
            found[k] = float(f'{whole}{"." if point else ""}{rest}'.replace('D', 'e'))
        except ValueError:
            continue
        if '_' in bare or (other in bare.replace(mark, '') and other in rest):
            found[k] = np.nan
    return found


def seconds(cells: Sequence[str], where: object) -> FloatArray:
    """Return times of day or dates as seconds from the first; NaN for a cell that is none.

    A time without a date that falls by more than half a day passes midnight.
    """
    whole = np.zeros(len(cells), np.int64)
    part = np.zeros(len(cells), np.int64)
    good = np.zeros(len(cells), np.bool_)
    turns, last, unclear = 0, -1, set()
    for k, cell in enumerate(cells):
        found = _STAMP.match(cell.strip().strip('"'))
        if found is None:
            continue
        moment = _time_of_day(found)
        day, doubtful = _day(found)
        if doubtful:
            unclear.add(doubtful)
        if day is None:
            turns += last - moment > HALF_DAY
            last = moment
            day = turns
        whole[k] = day * DAY + moment - _zone(found['zone'])
        part[k] = int((found['part'] or '0').ljust(9, '0'))
        good[k] = True
    if len(unclear) > 1:
        raise RecordError(f'{where}: {sorted(unclear)[0]} may be of two months; write dates as '
                          '2026-11-27')  # fmt: skip
    if not good.any():
        return np.full(len(cells), np.nan)
    begin = int(np.argmax(good))
    time = np.asarray(whole - whole[begin] + (part - part[begin]) / 1e9, np.float64)
    return np.where(good, time, np.nan)


def _time_of_day(found: re.Match[str]) -> int:
    hour = int(found['hour'])
    if found['half']:
        hour = hour % 12 + 12 * (found['half'].upper() == 'PM')
    return 3600 * hour + 60 * int(found['minute']) + int(found['second'])


def _day(found: re.Match[str]) -> tuple[int | None, str]:
    """Return the number of a day, None without a date, and the date if its order is not clear."""
    try:
        if found['y']:
            return date(int(found['y']), int(found['m']), int(found['d'])).toordinal(), ''
        if not found['year']:
            return None, ''
        a, b, year = int(found['a']), int(found['b']), int(found['year'])
        day_first = found['mark'] == '.' or a > 12
        day, month = (a, b) if day_first else (b, a)
        unclear = found['mark'] != '.' and a <= 12 and b <= 12 and a != b
        return date(year, month, day).toordinal(), f'{a}/{b}/{year}' if unclear else ''
    except ValueError:
        return 0, ''


def _zone(text: str | None) -> int:
    if not text or text[0] not in '+-':
        return 0
    digits = text[1:].replace(':', '')
    return (1 if text[0] == '+' else -1) * (3600 * int(digits[:2]) + 60 * int(digits[2:]))
