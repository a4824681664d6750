"""The verbs as executables of their own: ``ros2 run piezo_hysteresis identify ...``."""

from __future__ import annotations

import sys
from collections.abc import Callable

from piezo_hysteresis.cli.main import VERBS, main


def _executable(verb: str) -> Callable[[], None]:
    def run() -> None:
        sys.exit(main(verb=verb))

    run.__doc__ = f'Run the verb {verb}.'
    return run


globals().update({f'{verb}_': _executable(verb) for verb in VERBS})
