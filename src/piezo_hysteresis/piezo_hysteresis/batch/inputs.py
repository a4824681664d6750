"""Jobs of a batch: their data, their folders, and whether existing results are still valid."""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from piezo_hysteresis import __version__
from piezo_hysteresis.batch.tasks import Task
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.bag_content import READERS
from piezo_hysteresis.records.formats.reading import FORMATS
from piezo_hysteresis.reporting.folder import clear, write_folder

NOTE = 'job.json'  # written last: if it has the fingerprint, the folder is complete

#: Extensions of column files that are searched in folders.
COLUMNS = ('.csv', *FORMATS)


@dataclass(frozen=True)
class Job:
    """One set of data and the folder of its results.

    Attributes
    ----------
    name : str
        Name of its folder and its row.
    data : str
        Absolute path of a bag or a file of columns.
    folder : str
        Absolute path of the results.
    fingerprint : str
        Changes with the data, the settings or the version of the suite.
    """

    name: str
    data: str
    folder: str
    fingerprint: str

    def finished(self) -> dict[str, Any] | None:
        """Return the row of a valid earlier run, None if there is none."""
        try:
            note = json.loads((Path(self.folder) / NOTE).read_text(encoding='utf-8'))
        except (OSError, ValueError):
            return None
        if not isinstance(note, dict) or note.get('fingerprint') != self.fingerprint:
            return None
        row = note.get('row')
        # rejected data are a result; any other failure may be one of the machine
        return row if isinstance(row, dict) and row.get('state') in ('done', 'refused') else None

    def begin(self, verb: str) -> None:
        """Delete the results of an earlier run, and nothing else.

        Raises
        ------
        PiezoError
            If the folder has other content.
        """
        clear(self.folder, verb)
        self.note({})

    def note(self, row: dict[str, Any]) -> None:
        """Store the result of the job; an empty row states that it has started."""
        entry = {'fingerprint': self.fingerprint if row else None, 'row': row}
        write_folder(self.folder, {NOTE: json.dumps(entry, indent=2, allow_nan=False) + '\n'})


def jobs_of(task: Task, data: Sequence[str | Path], out: str | Path) -> list[Job]:
    """Return one job for every bag and file of columns.

    Parameters
    ----------
    task : Task
        Work on each set of data.
    data : sequence of str or Path
        Bags and column files; a folder that is no bag includes all of them in it.
    out : str or Path
        Folder of the results, which is not searched for data.

    Raises
    ------
    RecordError
        If a folder contains no data, or no path is given.
    """
    root = Path(out).resolve()
    paths = list(dict.fromkeys(p for given in data for p in expanded(Path(given), root)))
    if not paths:
        raise RecordError('no data were given; name bags, CSV files or a folder of them')
    stems = Counter(path.stem for path in paths)
    common = _print([[task.settings(), __version__], *map(_state_of, task.files)])
    jobs = []
    for path in paths:
        unique = stems[path.stem] == 1
        name = path.stem if unique else f'{path.stem}-{_print([str(path)])[:8]}'
        fingerprint = _print([common, str(path), _contents(path)])
        jobs.append(Job(name, str(path), str(root / name), fingerprint))
    return jobs


def expanded(path: Path, out: Path) -> list[Path]:
    """Return the absolute paths of the bags and column files of a path, in order.

    Raises
    ------
    RecordError
        If the path is a folder without data.
    """
    path = path.resolve()
    if not path.is_dir() or _is_bag(path):
        return [path]  # a missing path results in a row with the error
    found = sorted(_search(path, out))
    if not found:
        raise RecordError(f'{path} holds no bag and no file of columns; name the folder that does')
    return found


def _search(top: Path, out: Path) -> Iterator[Path]:
    for folder, below, files in os.walk(top):
        place = Path(folder)
        below[:] = sorted(d for d in below if place / d != out and not d.startswith('.'))
        if _is_bag(place):
            below.clear()
            yield place
        else:
            yield from (place / f for f in files if f.lower().endswith(COLUMNS))


def _is_bag(folder: Path) -> bool:
    return (folder / 'metadata.yaml').is_file() or any(
        entry.suffix in READERS for entry in folder.iterdir()
    )


def _contents(path: Path) -> list[Any]:
    """Return name, size and modification time of all files of some data."""
    if path.is_dir():
        return [_state_of(each) for each in sorted(path.rglob('*')) if each.is_file()]
    return [_state_of(each) for each in (path, path.with_name('records.yaml')) if each.is_file()]


def _state_of(path: str | Path) -> list[Any]:
    try:
        about = Path(path).stat()
    except OSError:
        return [str(path)]
    return [str(Path(path).resolve()), about.st_size, about.st_mtime_ns]


def _print(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
