"""What a folder or a pattern of paths contains: bags, files of columns, and anything else."""

from __future__ import annotations

import os
from dataclasses import dataclass
from glob import glob, has_magic
from pathlib import Path

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.bag_content import READERS
from piezo_hysteresis.records.formats.reading import has_format
from piezo_hysteresis.records.metadata import NAME

_TEXT = ('.csv', '.txt', '.tsv', '.dat', '.lvm', '.asc', '.prn')
_COMPANIONS = ('records.yaml',)  # belongs to files of columns


def is_csv(path: Path) -> bool:
    """Return whether a file is text in columns, by its name."""
    return path.suffix.lower() in _TEXT


def is_of_columns(path: Path) -> bool:
    """Return whether a file is one of columns, by its name."""
    return is_csv(path) or has_format(path)


@dataclass(frozen=True)
class FolderContent:
    """Content of a folder, each part in the order of the names; hidden entries are left out."""

    is_bag: bool
    files: tuple[Path, ...] = ()
    bags: tuple[Path, ...] = ()
    folders: tuple[Path, ...] = ()
    others: tuple[Path, ...] = ()


def content_of(folder: Path) -> FolderContent:
    """Return what a folder contains; of a bag only that it is one."""
    inside = sorted(each for each in folder.iterdir() if not each.name.startswith('.'))
    if any(each.name == NAME or not READERS.keys().isdisjoint(each.suffixes) for each in inside):
        return FolderContent(True)
    folders = [each for each in inside if each.is_dir()]
    bags = [each for each in folders if (each / NAME).is_file()]
    files = [each for each in inside if each.is_file()]
    columns = [each for each in files if is_of_columns(each)]
    known = {*columns, *bags}
    return FolderContent(
        False,
        tuple(columns),
        tuple(bags),
        tuple(each for each in folders if each not in known),
        tuple(each for each in files if each not in known and each.name not in _COMPANIONS),
    )


def files_of(path: Path) -> list[Path]:
    """Return the files on which the records of a path depend."""
    if not path.is_dir():
        return [each for each in (path, path.with_name(_COMPANIONS[0])) if each.is_file()]
    content = content_of(path)
    if content.is_bag:
        return [each for each in sorted(path.rglob('*')) if each.is_file()]
    inner = [each for bag in content.bags for each in files_of(bag)]
    return [*content.files, *inner, *(each for each in [path / _COMPANIONS[0]] if each.is_file())]


def matching(pattern: str | Path) -> list[Path]:
    """Return the paths that a pattern such as ``train/*.csv`` stands for, or a plain path."""
    if not has_magic(str(pattern)) or os.path.exists(pattern):  # noqa: PTH110 - never raises
        return [Path(pattern)]
    found = sorted(map(Path, glob(str(pattern), recursive=True)))  # noqa: PTH207 - absolute too
    if not found:
        raise RecordError(f'no file matches {pattern}; check the folder and the pattern')
    return found
