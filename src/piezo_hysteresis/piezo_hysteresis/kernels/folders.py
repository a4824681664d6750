"""Where the machine code of kernels lies: with the workspace, else with the user."""

from __future__ import annotations

import functools
import os
from pathlib import Path

# Where set-up leaves them, below the root of the workspace.
WITHIN = Path('install', 'kernels')


@functools.cache
def folders() -> tuple[Path, ...]:
    """Return where to look, in this order; what is new goes into the first that can be written.

    ``NUMBA_CACHE_DIR`` comes first where it is set, then the workspace, whose folder is read where
    it cannot be written too, then the cache folder of the user.
    """
    named = os.environ.get('NUMBA_CACHE_DIR')
    own = [Path(named) / 'piezo_kernels'] if named else []
    return (*own, _workspace(), *_user())


def _workspace() -> Path:
    """Return the folder in the workspace of this very file, however that is installed."""
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
        return []  # nobody's process: it has no home
