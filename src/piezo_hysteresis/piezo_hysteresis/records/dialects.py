"""The text files that instruments and programs write, one entry each: what is where in the head.

A dialect finds the names of the columns, the first row of numbers, and what the head states for
them: interval, number of samples, units. `text_tables` does the rest for all of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import UNITS, Meaning, meaning, unit_known, with_unit
from piezo_hysteresis.records.text_cells import is_number, is_stamp, separator_of, split

NAMED = 1
_SAMPLE = 200  # lines of numbers that decide what separates the cells


@dataclass(frozen=True)
class TextLayout:
    """Where the columns of one table stand in the lines of a text file."""

    names: list[str]  # of the columns, with the units that the head states
    first: int
    last: int = -1
    separator: str = ','  # between the cells; empty for spaces
    interval: float = 0.0
    count: int = 0
    assumed: str = ''  # what was recognised and assumed
    decimal: str = ''  # decimal mark that the head states; empty: found from the cells
    known: Mapping[int, Meaning] = field(default_factory=dict)  # what columns are by the dialect
    clock: str = ''  # ``''``: a column
    sparse: bool = False
    title: str = ''
    head: int = 0  # lines in front that were not read


@dataclass(frozen=True)
class Dialect:
    """One kind of text file."""

    name: str  # for `info`
    mark: str  # regular expression that its head contains
    assumes: str
    interval: str = ''
    count: str = ''
    known: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    layouts: Callable[[Dialect, Sequence[str]], list[TextLayout]] | None = None
    sparse: bool = False

    def read(self, lines: Sequence[str]) -> list[TextLayout]:
        """Return the tables of a file of this dialect."""
        found = (self.layouts or _general)(self, lines)
        return [
            replace(
                each,
                assumed=f'read as {self.name}: {self.assumes}',
                known={**self._columns(each.names), **each.known},
                sparse=self.sparse,
            )
            for each in found
        ]

    def _columns(self, names: Sequence[str]) -> dict[int, Meaning]:
        found = {}
        for k, name in enumerate(names):
            for pattern, (what, unit) in self.known.items():
                if re.match(pattern, name, re.IGNORECASE):
                    own = meaning(name).unit
                    found[k] = Meaning(what, own if own in UNITS[what] else unit, NAMED)
                    break
        return found


def dialect_of(lines: Sequence[str]) -> Dialect | None:
    """Return the dialect of a file by its first lines; None for a plain table."""
    head = '\n'.join(lines[:60])
    return next((each for each in DIALECTS if re.search(each.mark, head, re.MULTILINE)), None)


def plain(lines: Sequence[str], header_row: int | None, path: object) -> TextLayout:
    """Return the table of a file of no dialect: names, perhaps their units, then numbers."""
    begin = 0
    if header_row is not None:
        if not 1 <= header_row <= len(lines):
            raise RecordError(
                f'{path}: it has no line {header_row}, but {counted(len(lines), "line")}'
            )
        begin = header_row - 1
    filled = [k for k in range(begin, len(lines)) if lines[k].strip() and lines[k][0] != '#']
    if not filled:
        raise RecordError(
            f'{path}: the file is empty; it needs the columns time_s,voltage_V,displacement_um'
        )
    if header_row is not None:
        return _below(lines, filled[0])
    named = next((k for k in filled[:100] if _is_names(lines[k])), None)
    start = _first_numbers(lines, filled)
    if named is None or (start is not None and named > start):
        named = filled[0]
        if start is not None:
            named = _names_above(lines, start)
    found = _below(lines, named)
    head = sum(k < named for k in filled)
    if lines[named][:1] == '#' and _all_numbers(found.names):
        return found
    return replace(found, head=head)


def _is_names(line: str) -> bool:
    """Return whether two cells of a line are quantities with a unit."""
    for mark in ('\t', ';', ',', '|', '  ', None):
        cells = [cell.strip().strip('"') for cell in line.split(mark)]
        known = [meaning(cell) for cell in cells if not is_number(cell)]
        if len({each.what for each in known if each.what and each.rank <= NAMED}) >= 2:
            return True
    return False


def _first_numbers(lines: Sequence[str], filled: Sequence[int]) -> int | None:
    """Return the first of three lines of numbers of one width."""
    separator = separator_of([lines[k] for k in filled[-_SAMPLE:]])
    before, alike = 0, 0
    for place, k in enumerate(filled):
        width = _width(lines[k], separator)
        alike = alike + 1 if width == before else 1
        if width > 1 and alike == 3:
            return filled[place - 2]
        before = width
    return None


def _width(line: str, separator: str) -> int:
    """Return the number of cells of a line of numbers; 0 for other lines."""
    cells = split(line, separator)
    numbers = sum(is_number(cell) or is_stamp(cell) for cell in cells)
    first = cells[0] if cells else ''
    good = not first or is_number(first) or is_stamp(first)
    return len(cells) if good and numbers >= 2 else 0


def _names_above(lines: Sequence[str], start: int) -> int:
    """Return the line of names above the first numbers: behind a comment mark too."""
    separator = separator_of(lines[start : start + _SAMPLE])
    width = len(split(lines[start], separator))
    for k in range(start - 1, max(start - 4, -1), -1):
        cells = split(lines[k].lstrip('# '), separator)
        if not lines[k].strip() or _all_units(cells):
            continue
        comment = lines[k][0] == '#' and not _is_names(lines[k].lstrip('# '))
        if len(cells) >= min(width, 2) and not comment:
            return k
        break
    return start


def _all_numbers(names: Sequence[str]) -> bool:
    return all(name.isdigit() for name in names)


def _all_units(cells: Sequence[str]) -> bool:
    filled = [cell for cell in cells if cell]
    return bool(filled) and all(unit_known(cell) or cell[0] in '([' for cell in filled)


def _below(lines: Sequence[str], head: int) -> TextLayout:
    """Return the table below a line of names, or of numbers that begin there."""
    line = lines[head].lstrip('#').strip() if lines[head][:1] == '#' else lines[head]
    rows = [k for k in range(head + 1, min(head + 1 + 3 * _SAMPLE, len(lines)))
            if lines[k].strip() and lines[k][0] != '#'][:_SAMPLE]  # fmt: skip
    separator = separator_of([lines[k] for k in rows[3:] or rows] or [line])
    bare = split(line, separator)
    if rows and '\t' not in line and separator == '' and len(bare) != len(lines[rows[-1]].split()):
        bare = re.split(r'\s{2,}', line.strip())
    if not rows or (len(split(line, separator)) < 2 and separator):
        separator = next((mark for mark in ('\t', ';', ',') if mark in line), separator)
        bare = split(line, separator)
    if all(is_number(cell) or is_stamp(cell) or not cell for cell in bare):
        names = [str(k) for k in range(1, len(bare) + 1)]
        return TextLayout(names, head, separator=separator)
    names = [name.strip().strip('"\'') for name in bare]
    while names and not names[-1]:
        names.pop()
    first = head + 1
    for k in rows[:2]:  # units, between the names and the numbers
        cells = split(lines[k], separator)
        if any(is_number(cell) or is_stamp(cell) for cell in cells) or not any(cells):
            break
        if not _all_units(cells):
            break
        cells += [''] * (len(names) - len(cells))
        names = [with_unit(name, unit) for name, unit in zip(names, cells, strict=False)]
        first = k + 1
    return TextLayout(names, first, separator=separator)


def _general(dialect: Dialect, lines: Sequence[str]) -> list[TextLayout]:
    """Return the one table below a head of metadata; the head states interval and count."""
    head = '\n'.join(lines[:200])
    layout = plain(lines, None, dialect.name)
    return [
        replace(
            layout,
            head=0,
            interval=_seconds(dialect.interval, head),
            count=int(_found(dialect.count, head)),
        )
    ]


def _found(pattern: str, head: str) -> float:
    found = re.search(pattern, head, re.MULTILINE | re.IGNORECASE) if pattern else None
    return float(found[1]) if found else 0.0


def _seconds(pattern: str, head: str) -> float:
    """Return an interval of the head [s]; its unit may follow the number."""
    found = re.search(pattern, head, re.MULTILINE | re.IGNORECASE) if pattern else None
    if found is None:
        return 0.0
    unit = (found[2] if found.lastindex and found.lastindex > 1 else '') or 's'
    divisor = UNITS['time'].get(unit)
    return 0.0 if divisor is None else float(found[1]) / divisor


_VALUE = r'[-+]?[\d.]+(?:[eE][-+]?\d+)?'


def _pi_recorder(dialect: Dialect, lines: Sequence[str]) -> list[TextLayout]:
    """``# KEY = value`` up to ``# END_HEADER``; names in ``NAME0``, ``NAME1``, ..."""
    end = next((k for k, line in enumerate(lines) if re.match(r'#\s*END_HEADER', line)), None)
    if end is None:
        raise RecordError('its header has no END_HEADER; save it again')
    keys = {
        found[1]: found[2].strip()
        for line in lines[:end]
        if (found := re.match(r'#\s*(\w+)\s*=\s*(.*)', line))
    }
    width = int(keys.get('DIM', '0')) or len(split(lines[end + 1], ''))
    code = int(keys.get('SEPARATOR', '32'))
    names = [keys.get(f'NAME{k}', str(k + 1)) for k in range(width)]
    separator = '' if code == 32 else chr(code)
    interval = float(keys.get('SAMPLE_TIME', '0'))
    return [TextLayout(names, end + 1, separator=separator, interval=interval,
                   count=int(keys.get('NDATA', '0')))]  # fmt: skip


def _labview(dialect: Dialect, lines: Sequence[str]) -> list[TextLayout]:
    """One file header, then a header for each segment; ``X_Columns`` One, Multi or No."""
    ends = [k for k, line in enumerate(lines) if line.startswith('***End_of_Header***')]
    top = _labview_keys(lines[: ends[0]], '\t')
    separator = {'Comma': ',', 'Tab': '\t'}.get(top.get('Separator', ['Tab'])[0], '\t')
    decimal = top.get('Decimal_Separator', [''])[0]
    style = top.get('X_Columns', ['One'])[0]
    if separator == ',' and ',' not in lines[ends[-1]]:
        separator = '\t' if '\t' in lines[ends[-1] + 1] else ','
    layouts = []
    begins = ends[1:] or ends
    for number, end in enumerate(begins):
        before = ends[number] + 1 if len(ends) > 1 else 0
        top_of = next((k for k in range(end - 1, before - 1, -1)
                       if lines[k].startswith('Channels')), before)  # fmt: skip
        keys = _labview_keys(lines[top_of:end], separator)
        last = len(lines)
        if number + 1 < len(begins):
            last = next((k for k in range(begins[number + 1], end, -1)
                         if lines[k].startswith('Channels')), begins[number + 1])  # fmt: skip
        title = str(number + 1) if len(begins) > 1 else ''
        made = _labview_segment(lines, (end + 1, last), separator, style, keys, title)
        layouts.append(replace(made, decimal=decimal if decimal in ('.', ',') else ''))
    return layouts


def _labview_keys(lines: Sequence[str], separator: str) -> dict[str, list[str]]:
    rows = [line.split(separator) for line in lines]
    return {row[0].strip(): [cell.strip() for cell in row[1:]] for row in rows if row[0].strip()}


def _labview_segment(
    lines: Sequence[str],
    span: tuple[int, int],
    separator: str,
    style: str,
    keys: Mapping[str, list[str]],
    title: str,
) -> TextLayout:
    head, last = span
    while head < last and not lines[head].strip():
        head += 1
    names = [name.strip().strip('"') for name in lines[head].split(separator)]
    while names and not names[-1]:
        names.pop()
    units = keys.get('Y_Unit_Label', [])
    channels = [k for k, name in enumerate(names) if name not in ('X_Value', 'Comment')]
    for k, unit in zip(channels, units, strict=False):
        names[k] = with_unit(names[k], unit)
    steps = {float(text.replace(',', '.')) for text in keys.get('Delta_X', []) if text}
    counts = {int(float(text)) for text in keys.get('Samples', []) if text}
    filled = [k for k in range(head + 1, last) if lines[k].strip()]
    end = filled[-1] + 1 if filled else head + 1
    known = {}
    if style.lower() == 'no':
        known = {k: Meaning() for k, name in enumerate(names) if name == 'X_Value'}
        # the empty column of times is not read: only here a key betrays that its line is no sample
        cells = {k: lines[k].split(separator)[0].strip().strip('"') for k in filled if known}
        if key := next((k for k, cell in cells.items() if cell and not is_number(cell)), 0):
            raise RecordError(
                f'line {key + 1} begins with {cells[key][:40]!r} among the samples: it belongs to '
                'a header; delete it or put it back'
            )
        if len(steps) > 1:
            raise RecordError(f'segment {title}: its channels have different Delta_X')
    return TextLayout(
        names, head + 1, end, separator,
        interval=steps.pop() if len(steps) == 1 else 0.0,
        count=counts.pop() if len(counts) == 1 else 0,
        known=known, title=title,
    )  # fmt: skip


def _rigol(dialect: Dialect, lines: Sequence[str]) -> list[TextLayout]:
    """``X,CH1,CH2,Start,Increment``; below it units, start and increment."""
    names, units = (split(line, ',') for line in lines[:2])
    names, begin = names[: names.index('Start')], names.index('Start')
    start, step = float(units[begin]), float(units[begin + 1])
    named = [with_unit(name, unit) for name, unit in zip(names, units, strict=False)]
    named[0] = f'X {start!r}'
    return [
        TextLayout(named, 2, interval=step, clock='index', known={0: Meaning('time', 's', NAMED)})
    ]


def _rigol_without_times(dialect: Dialect, lines: Sequence[str]) -> list[TextLayout]:
    """``CH1V,CH2V,t0 = -0.005, tInc = 1e-06,``; the rows hold the channels only."""
    cells = split(lines[0], ',')
    step = next(float(c.partition('=')[2]) for c in cells if c.replace(' ', '').startswith('tInc'))
    names = [re.sub(r'^(CH\d+|D\d+.*|MATH\d*)(m?V)$', r'\1 (\2)', c) for c in cells
             if c and '=' not in c]  # fmt: skip
    width = len([cell for cell in split(lines[1], ',') if cell])
    timed = width == len(names) and bool(re.match('Time', names[0]))
    known = {0: Meaning('time', 's', NAMED)} if timed else {}
    return [TextLayout(names, 1, interval=step, known=known)]


def _siglent(dialect: Dialect, lines: Sequence[str]) -> list[TextLayout]:
    """Metadata, ``Source,CH1,CH2``, ``Second,Value,Value``, numbers."""
    (layout,) = _general(dialect, lines)
    head = next(k for k, line in enumerate(lines) if re.match(r'(Second|Time),', line))
    cells = split(lines[head], ',')
    source = next((split(li, ',')[1:] for li in lines[:head] if li.startswith('Source,')), [])
    units = next((li for li in lines[:head] if li.startswith('Vertical Units')), '')
    found = [text.partition(':')[2] or text for text in split(units, ',')[1:]]
    names = ['Time (s)']
    for k in range(1, len([cell for cell in cells if cell])):
        name = source[k - 1] if k <= len(source) and source[k - 1] else cells[k]
        names.append(with_unit(name, found[k - 1] if k <= len(found) else ''))
    return [replace(layout, names=names, first=head + 1, separator=',')]


def _lecroy(dialect: Dialect, lines: Sequence[str]) -> list[TextLayout]:
    """``Segments,2,SegmentSize,500``, trigger times, then ``Time,Ampl`` and all segments."""
    (layout,) = _general(dialect, lines)
    found = re.match(r'Segments,(\d+),SegmentSize,(\d+)', lines[1])
    number, size = (int(found[1]), int(found[2])) if found else (1, 0)
    if number == 1:
        return [replace(layout, count=size)]
    return [
        replace(
            layout,
            first=layout.first + k * size,
            last=layout.first + (k + 1) * size,
            count=size,
            title=str(k + 1),
        )
        for k in range(number)
    ]


def _graphtec(dialect: Dialect, lines: Sequence[str]) -> list[TextLayout]:
    """Channels, then ``Data``, names, units, numbers such as ``+ 0.081``."""
    mark = next(k for k, line in enumerate(lines) if re.match(r'"?Data"?,?\s*$', line))
    names, units = (split(lines[mark + k], ',') for k in (1, 2))
    named = [with_unit(name, unit if unit_known(unit) else '') for name, unit in
             zip(names, units, strict=False)]  # fmt: skip
    known = {k: Meaning() for k, name in enumerate(names)
             if re.match(r'Number|Date|Time|ms$|us$|Alarm', name)}  # fmt: skip
    head = '\n'.join(lines[:mark])
    return [TextLayout(named, mark + 3, separator=',', interval=_seconds(dialect.interval, head),
                   count=int(_found(dialect.count, head)), known=known)]  # fmt: skip


def _nanonis(dialect: Dialect, lines: Sequence[str]) -> list[TextLayout]:
    """Metadata, ``[DATA]``, names with units, numbers; all between tabs."""
    mark = next(k for k, line in enumerate(lines) if line.startswith('[DATA]'))
    names = [name.strip() for name in lines[mark + 1].split('\t')]
    return [TextLayout(names, mark + 2, separator='\t')]


def _aixacct(dialect: Dialect, lines: Sequence[str]) -> list[TextLayout]:
    """Blocks of ``key: value``, each with a table that begins with ``Time [s]``."""
    heads = [k for k, line in enumerate(lines) if line.startswith('Time [')]
    layouts = []
    for number, head in enumerate(heads):
        names = [name.strip() for name in lines[head].split('\t') if name.strip()]
        last = head + 1
        while last < len(lines) and is_number(lines[last].split('\t')[0]):
            last += 1
        title = str(number + 1) if len(heads) > 1 else ''
        layouts.append(TextLayout(names, head + 1, last, '\t', title=title))
    return layouts


def _ros_echo(dialect: Dialect, lines: Sequence[str]) -> list[TextLayout]:
    """No names; seconds and nanoseconds of the header first."""
    names = [str(k) for k in range(1, len(split(lines[0], ',')) + 1)]
    return [TextLayout(names, 0, separator=',', clock='sec_nanosec')]


_TIME = 'time from its column'
DIALECTS = (
    Dialect(
        'PI recorder file', r'^#\s*END_HEADER', 'rows are SAMPLE_TIME apart; volts, and µm for '
        'positions', layouts=_pi_recorder,
        known={r'.*position error': ('', ''),
               r'(control|output|piezo)?\s*voltage': ('voltage', 'V'),
               r'(target|commanded) position': ('reference', 'um'),
               r'(real|current|actual|measured)?\s*(position|displacement)':
               ('displacement', 'um')},
    ),
    Dialect(
        'LabVIEW measurement (.lvm)', r'\*\*\*End_of_Header\*\*\*', 'each segment is a record; '
        'without X columns rows are Delta_X apart', layouts=_labview,
    ),
    Dialect(
        'Rigol CSV', r'^X,.*Start,Increment', 'row k is at Start + k Increment', layouts=_rigol,
    ),
    Dialect(
        'Rigol CSV with t0 and tInc', r'^.*t0\s*=.*tInc\s*=', 'rows are tInc apart',
        layouts=_rigol_without_times,
    ),
    Dialect(
        'Siglent CSV', r'^Record Length,.*\n(?:.*\n)*?(Second|Time),', f'{_TIME}; units of '
        'Vertical Units', interval=rf'^Sample Interval,\D*?({_VALUE})', layouts=_siglent,
        count=r'^Record Length,\D*?(\d+)',
    ),
    Dialect(
        'Keysight CSV', r'^x-axis,', f'{_TIME}', known={'x-axis': ('time', 's')},
    ),
    Dialect(
        'Tektronix CSV', r'^(Model|Firmware Version),.*\n(?:.*\n)*?TIME,', f'{_TIME}; units of '
        'Vertical Units', interval=rf'^Sample Interval,({_VALUE})', known={'TIME$': ('time', 's')},
        count=r'^Record Length,(\d+)',
    ),
    Dialect(
        'LeCroy CSV', r'^Segments,\d+,SegmentSize', f'{_TIME}; each segment is a record',
        known={'Time$': ('time', 's')}, layouts=_lecroy,
    ),
    Dialect(
        'PicoScope CSV', r'^(Time|Zeit)[,;].*\n\(\w?s\)[,;]', f'{_TIME}; units of the second line',
    ),
    Dialect(
        'GRAPHTEC CSV', r'GRAPHTEC', 'rows are one Sampling interval apart', layouts=_graphtec,
        interval=r'^"?Sampling interval"?\s*[,:]\s*"?([\d.]+)\s*(ms|us|s|min|h)',
        count=r'^"?Total data points"?\s*[,:]\s*"?(\d+)',
    ),
    Dialect('Nanonis .dat', r'^\[DATA\]', 'names and units of the line behind [DATA]',
            layouts=_nanonis),
    Dialect(
        'aixACCT .dat', r'^Time \[s\].*V\+ \[V\]', 'V+ is the voltage, D1 the displacement',
        known={r'V\+ \[V\]': ('voltage', 'V'), r'V-': ('', ''),
               r'D1 \[': ('displacement', 'nm')}, layouts=_aixacct,
    ),
    Dialect(
        'PlotJuggler CSV', r'^"?__time', 'a signal holds its value where its cell is empty',
        known={'__time': ('time', 's')}, sparse=True,
    ),
    Dialect(
        'mcap CSV', r'^.*\b(log_time|publish_time)\b', 'times are log_time; a signal holds its '
        'value where its cell is empty', known={'log_time': ('time', 's'),
                                                'publish_time': ('', '')}, sparse=True,
    ),
    Dialect(
        'ros2 topic echo --csv', r'\A1\d{9},\d{1,9},', 'columns 1 and 2 are the stamp of the '
        'header; name the others by their number', layouts=_ros_echo,
    ),
)  # fmt: skip
