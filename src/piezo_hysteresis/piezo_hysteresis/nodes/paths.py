"""Paths in requests are restricted to a folder of the node."""

from __future__ import annotations

from pathlib import Path

from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile
from piezo_interfaces.srv import LoadModel


def inside(folder: str, path: str) -> Path:
    """Return `path` inside `folder`, both resolved."""
    base = Path(folder or '.').expanduser().resolve()
    try:
        target = (base / path).resolve()
        target.exists()  # raises where the name is too long
    except (OSError, ValueError) as error:
        raise PiezoError(f'{path[:40]!r} is no path: {reason_of(error)}') from None
    if not path or (target != base and base not in target.parents):
        raise PiezoError(f'{path!r} is not inside {base}: give a path below that folder')
    return target


def new_inside(folder: str, path: str) -> Path:
    """Return the new `path` inside `folder`."""
    target = inside(folder, path)
    if target.exists():
        raise PiezoError(f'{target} exists already; give another name')
    return target


def requested_model(request: LoadModel.Request, folder: str) -> ModelFile:
    """Return the model that `request` carries as text, or names by a path inside `folder`."""
    if request.yaml:
        return ModelFile.parse(request.yaml)
    return ModelFile.load(inside(folder, request.path))
