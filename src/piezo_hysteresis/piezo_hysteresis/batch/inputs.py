"""Which jobs there are, where their results lie, and whether these still belong to their data."""

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

NOTE = 'job.json'  # written last: where it names the fingerprint, the folder is whole

#: Endings of files of columns that are looked for in folders.
COLUMNS = ('.csv', *FORMATS)


@dataclass(frozen=True)
class Job:
    """One set of data and where its results go.

    Attributes
    ----------
    name : str
        Of its folder and its row.
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
        """Return the row of an earlier run that still holds, None where there is none."""
        try:
            note = json.loads((Path(self.folder) / NOTE).read_text(encoding='utf-8'))
        except (OSError, ValueError):
            return None
        if not isinstance(note, dict) or note.get('fingerprint') != self.fingerprint:
            return None
        row = note.get('row')
        # a refusal of the data is a result; any other failure may have been of the machine
        return row if isinstance(row, dict) and row.get('state') in ('done', 'refused') else None

    def begin(self, verb: str) -> None:
        """Take away what an earlier run left, and that alone.

        Raises
        ------
        PiezoError
            If the folder holds something that no batch has put there.
        """
        clear(self.folder, verb)
        self.note({})

    def note(self, row: dict[str, Any]) -> None:
        """Write down how the job ended; an empty row says that it has started."""
        entry = {'fingerprint': self.fingerprint if row else None, 'row': row}
        write_folder(self.folder, {NOTE: json.dumps(entry, indent=2, allow_nan=False) + '\n'})


def jobs_of(task: Task, data: Sequence[str | Path], out: str | Path) -> list[Job]:
    """Return one job for every bag and file of columns.

    Parameters
    ----------
    task : Task
        What to do with each.
    data : sequence of str or Path
        Bags and files of columns; a folder that is no bag stands for all that lie in it.
    out : str or Path
        Folder of the results; never searched for data.

    Raises
    ------
    RecordError
        If a folder holds nothing of the kind, or nothing was given.
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
    """Return the bags and files of columns that a path stands for, as absolute paths in order.

    Raises
    ------
    RecordError
        If the path is a folder without any.
    """
    path = path.resolve()
    if not path.is_dir() or _is_bag(path):
        return [path]  # what is not there becomes a row that says so
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
    """Return name, size and time of change of all files of some data."""
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
