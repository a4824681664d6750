"""A table of results and goals."""

from __future__ import annotations

import time
from dataclasses import dataclass, field


@dataclass
class Goals:
    """Prints each figure as it comes and remembers the ones that miss their goal."""

    missed: list[str] = field(default_factory=list)
    started: float = field(default_factory=time.perf_counter)

    def heading(self, words: str) -> None:
        """Begin a section."""
        print(f'\n{words}  [{time.perf_counter() - self.started:.0f} s]', flush=True)

    def check(self, what: str, value: float, bound: float, unit: str) -> None:
        """Print a figure that should be at most `bound`."""
        good = value <= bound
        print(
            f'  {what:<58}{value:>10.4g}  goal {bound:>8.4g} {unit:<4}'
            f'{"ok" if good else "MISSED"}',
            flush=True,
        )
        if not good:
            self.missed.append(what)

    def note(self, words: str) -> None:
        """Print something without a goal."""
        print(f'  {words}', flush=True)

    def finish(self) -> int:
        """Print the verdict; return the exit code."""
        if self.missed:
            print(f'\n{len(self.missed)} goals missed: ' + '; '.join(self.missed))
        else:
            print('\nevery goal reached')
        return 1 if self.missed else 0
