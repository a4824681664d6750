"""The Python class of a message type by its name."""

from __future__ import annotations

import importlib

from piezo_hysteresis.errors import PiezoError


def message_type(name: str) -> type:
    """Return the class of ``package/msg/Name``.

    Raises
    ------
    PiezoError
        If its package is not built or sourced.
    """
    package, _, kind = name.partition('/msg/')
    try:
        found: type = getattr(importlib.import_module(f'{package}.msg'), kind)
    except (ImportError, AttributeError):
        raise PiezoError(
            f'messages of type {name} are not known here: source the workspace that has {package}'
        ) from None
    return found
