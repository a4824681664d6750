"""Output folders: all files or none are written, and a verb replaces only its own results."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from piezo_hysteresis import __version__
from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.errors import PiezoError

# File with the verb that wrote a folder, and the names of its files.
MARKER = '.results.json'


@dataclass(frozen=True)
class FolderMarker:
    """Owner of the results in a folder."""

    verb: str  # verb that wrote the results
    files: tuple[str, ...] = ()  # names of the written files and folders

    def text(self) -> str:
        """Return the content of the file."""
        content = {'verb': self.verb, 'version': __version__, 'files': sorted(self.files)}
        return json.dumps(content, indent=2) + '\n'


def marker_of(folder: str | Path) -> FolderMarker | None:
    """Return the marker of a folder, or None."""
    content = _read(Path(folder) / MARKER)
    if not isinstance(content.get('verb'), str):
        return None
    files = content.get('files')
    names = files if isinstance(files, list) else []
    # Plain names only: an entry of the file must not point outside the folder.
    return FolderMarker(
        content['verb'], tuple(n for n in names if isinstance(n, str) and _plain(n))
    )


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding='utf-8'))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _plain(name: str) -> bool:
    return Path(name).name == name and name not in ('', '.', '..')


def check_folder(folder: str | Path, verb: str) -> None:
    """Reject a folder that contains anything but results of `verb`; call it before a long task."""
    target = Path(folder)
    found = marker_of(target)
    try:
        if found is None and target.is_dir() and any(target.iterdir()):
            held = 'files that are no results'
        elif found is not None and found.verb != verb:
            held = f'the results of {found.verb}'
        else:
            return
    except OSError as error:
        raise _unwritable(target, error) from error
    raise PiezoError(
        f'{target} holds {held}; give {verb} another folder, or overwrite it '
        '(--overwrite, in Python overwrite=True)'
    )


def overwrite(folder: str | Path, verb: str) -> None:
    """Let `verb` write into a folder with any content; results of another verb are replaced."""
    if Path(folder).is_dir():
        found = marker_of(folder)
        _mark(folder, FolderMarker(verb, found.files if found is not None else ()))


def claim(folder: str | Path, verb: str) -> None:
    """Mark a folder before a task that writes its results one by one; its content stays."""
    check_folder(folder, verb)
    if not (Path(folder) / MARKER).is_file():
        _mark(folder, FolderMarker(verb))


def clear(folder: str | Path, verb: str) -> None:
    """Remove the results of an earlier run of `verb`, keep other files, and mark the folder."""
    check_folder(folder, verb)
    for name in _stale(Path(folder), ()):
        (Path(folder) / name).unlink()
    _mark(folder, FolderMarker(verb))


def _mark(folder: str | Path, marker: FolderMarker) -> None:
    write_folder(folder, {MARKER: marker.text()})


def write_folder(folder: str | Path, files: Mapping[str, bytes | str], verb: str = '') -> None:
    """Write files into a folder: first all under temporary names, then renamed."""
    target = Path(folder)
    stale: set[str] = set()
    if verb:
        check_folder(target, verb)
        stale = _stale(target, files)
        files = {MARKER: FolderMarker(verb, tuple(files)).text(), **files}
    waiting: list[tuple[Path, Path]] = []
    try:
        target.mkdir(parents=True, exist_ok=True)
        try:
            for name, content in files.items():
                # opened as a usual file, so that the umask sets its permissions
                temporary = target / f'.{name}.{os.getpid()}.tmp'
                waiting.append((temporary, target / name))
                temporary.write_bytes(content.encode() if isinstance(content, str) else content)
            while waiting:
                temporary_path, final = waiting[0]
                temporary_path.replace(final)
                waiting.pop(0)
            for name in stale:
                (target / name).unlink(missing_ok=True)
        finally:
            for temporary_path, _ in waiting:
                temporary_path.unlink(missing_ok=True)
    except OSError as error:
        raise _unwritable(target, error) from error


def _stale(folder: Path, names: Iterable[str]) -> set[str]:
    """Return the result files of a folder that are not among `names`."""
    found = marker_of(folder)
    left = set(found.files) - set(names) if found is not None else set()
    return {name for name in left if (folder / name).is_file()}


@contextmanager
def replacing(folder: Path, verb: str) -> Iterator[Path]:
    """Provide an empty folder whose content moves into `folder` only after success.

    Results of an earlier run of `verb` are removed, other files stay.
    """
    check_folder(folder, verb)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        if folder.exists() and not folder.is_dir():
            raise NotADirectoryError(0, 'it is a file')
        staging = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f'.{folder.name}.'))
    except OSError as error:
        raise _unwritable(folder, error) from error
    try:
        made = staging / 'new'
        made.mkdir()
        yield made
        names = tuple(path.name for path in made.iterdir())
        (made / MARKER).write_text(FolderMarker(verb, names).text(), encoding='utf-8')
        _move(made, folder, staging / 'old')
    except OSError as error:
        raise _unwritable(folder, error) from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _move(made: Path, folder: Path, old: Path) -> None:
    folder.mkdir(exist_ok=True)
    old.mkdir()
    new = sorted(path.name for path in made.iterdir())
    for name in sorted({*new, *_stale(folder, new)}):
        if (folder / name).exists():
            (folder / name).replace(old / name)
    for name in new:
        (made / name).replace(folder / name)


def _unwritable(folder: Path, error: OSError) -> PiezoError:
    return PiezoError(f'{folder} cannot be written ({reason_of(error)}); name another folder')
