"""Folder of the machine code of kernels: in the workspace, otherwise of the user."""

from __future__ import annotations

import functools
import os
from pathlib import Path

# Where set-up leaves them, below the root of the workspace.
WITHIN = Path('install', 'kernels')


@functools.cache
def folders() -> tuple[Path, ...]:
    """Return the folders in search order; new entries go to the first writable one.

    The order is ``NUMBA_CACHE_DIR`` if set, the workspace, which is also read if it is not
    writable, and the cache folder of the user.
    """
    named = os.environ.get('NUMBA_CACHE_DIR')
    own = [Path(named) / 'piezo_kernels'] if named else []
    return (*own, _workspace(), *_user())


def _workspace() -> Path:
    """Return the folder in the workspace of this file, for any kind of installation."""
    here = Path(__file__).resolve()
    for parent in here.parents:
        if (parent / 'setup.bash').is_file() and parent.name != 'install':
            return parent / WITHIN
    return here.parent / 'kernels'


def _user() -> list[Path]:
    named = os.environ.get('XDG_CACHE_HOME')
    try:
        return [(Path(named) if named else Path.home() / '.cache') / 'piezo_kernels']
    except RuntimeError:
        return []  # a process without a home folder
