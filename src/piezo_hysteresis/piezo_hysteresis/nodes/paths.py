"""Paths that come over services stay inside a folder that the node was given."""

from __future__ import annotations

from pathlib import Path

from piezo_hysteresis.errors import PiezoError


def inside(folder: str, path: str) -> Path:
    """Return `path` inside `folder`, both resolved.

    Raises
    ------
    PiezoError
        If it leads out of the folder, by ``..``, by a link or by being absolute elsewhere.
    """
    base = Path(folder or '.').resolve()
    target = (base / path).resolve()
    if not path or (target != base and base not in target.parents):
        raise PiezoError(f'{path!r} is not inside {base}: give a path below that folder')
    return target
