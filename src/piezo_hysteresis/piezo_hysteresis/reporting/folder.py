"""Folders of results: every file whole, or none."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

from piezo_hysteresis.errors import PiezoError


def write_folder(folder: str | Path, files: Mapping[str, bytes | str]) -> None:
    """Write files into a folder: all under temporary names first, then renamed.

    Parameters
    ----------
    folder : str or Path
        Made where it is not there; other files in it stay.
    files : mapping of str to bytes or str
        Content by file name.

    Raises
    ------
    PiezoError
        If the folder cannot be written; then none of the files is changed.
    """
    target = Path(folder)
    waiting: list[tuple[Path, Path]] = []
    try:
        target.mkdir(parents=True, exist_ok=True)
        try:
            for name, content in files.items():
                handle, temporary = tempfile.mkstemp(dir=target, prefix=f'.{name}.')
                waiting.append((Path(temporary), target / name))
                with os.fdopen(handle, 'wb') as file:
                    file.write(content.encode() if isinstance(content, str) else content)
                Path(temporary).chmod(0o644)
            while waiting:
                temporary_path, final = waiting[0]
                temporary_path.replace(final)
                waiting.pop(0)
        finally:
            for temporary_path, _ in waiting:
                temporary_path.unlink(missing_ok=True)
    except OSError as error:
        reason = error.strerror or error
        raise PiezoError(f'{target} cannot be written ({reason}); name another folder') from error
