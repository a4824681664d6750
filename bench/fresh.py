"""Does the first command work on a fresh machine? `make demo` in fresh clones, idle and loaded.

    python bench/fresh.py --clones 10 --loaded 5 --busy 4

Every clone has a folder and a HOME of its own and no caches. Prints one line per clone: exit
code, time, processor time, size of ``.venv`` and the tracking errors; ends with 1 where one fails.
`--quick` makes one clone and asks it for `make help`, which sets nothing up.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from bench.quick import parsed

ROOT = Path(__file__).resolve().parents[1]

# Environment after a login; a sourced workspace adds the rest.
KEPT = ('LANG', 'LC_ALL', 'PATH', 'TMPDIR', 'USER', 'ROS_DOMAIN_ID')
KEPT_GROUPS = ('PIP_', 'SSL_', 'HTTP', 'http', 'NO_PROXY', 'no_proxy', 'PYENV_')
LIMIT = 1800.0  # [s]


@dataclass(frozen=True)
class Outcome:
    """What became of one clone.

    Attributes
    ----------
    code : int
        Exit code of ``make demo``.
    seconds, processor : float
        Wall and processor time of it [s].
    size : float
        Of ``.venv`` [bytes].
    errors : tuple of float
        Rms tracking errors without compensation, with feedforward, and with attenuation [m].
    tail : str
        Last words, where it failed.
    wanted : int
        How many errors the target leaves.
    """

    code: int
    seconds: float
    processor: float
    size: float
    errors: tuple[float, ...]
    tail: str
    wanted: int = 3

    @property
    def good(self) -> bool:
        """Whether it ended well, with each error smaller than the one before."""
        falls = all(later < before for before, later in pairwise(self.errors))
        return self.code == 0 and len(self.errors) == self.wanted and falls

    def line(self) -> str:
        """Return it in words."""
        microns = ' > '.join(f'{1e6 * error:.3f}' for error in self.errors)
        return (
            f'{"ok" if self.good else "FAILED"}: code {self.code}, {self.seconds:.0f} s, '
            f'processor {self.processor:.0f} s, .venv {self.size / 1e6:.0f} MB, '
            f'rms {microns} µm {self.tail}'
        )


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Keep `count` processes busy during the context."""
    neighbours = [
        subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(count)
    ]
    try:
        yield
    finally:
        for neighbour in neighbours:
            neighbour.kill()
            neighbour.wait()


def environment(home: Path) -> dict[str, str]:
    """Return the environment of a new login."""
    kept = {k: v for k, v in os.environ.items() if k in KEPT or k.startswith(KEPT_GROUPS)}
    own = Path(sys.prefix).resolve()
    folders = kept.get('PATH', os.defpath).split(os.pathsep)
    path = [each for each in folders if not Path(each).resolve().is_relative_to(own)]
    return {**kept, 'PATH': os.pathsep.join(path), 'HOME': str(home)}


def made(target: str, clone: Path, env: Mapping[str, str]) -> Outcome:
    """Run ``make`` with a target in a clone."""
    started, used = time.monotonic(), _processor()
    done = subprocess.run(
        ['make', target], cwd=clone, env=env, capture_output=True, text=True, timeout=LIMIT
    )
    seconds, processor = time.monotonic() - started, _processor() - used
    files = (path for path in (clone / '.venv').rglob('*') if not path.is_dir())
    size = float(sum(path.lstat().st_size for path in files))
    summary = clone / 'out' / 'demo' / 'summary.json'
    errors: tuple[float, ...] = ()
    if summary.exists():
        content = json.loads(summary.read_text())
        errors = tuple(run['rmse_m'] for run in content['tracking']['runs'])
    tail = ' | '.join((done.stdout + done.stderr).splitlines()[-3:]) if done.returncode else ''
    wanted = 3 if target == 'demo' else 0
    return Outcome(done.returncode, seconds, processor, size, errors, tail, wanted)


def _processor() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> int:
    """Run the clones one after another."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--clones', type=int, default=2, help='how many (2)')
    parser.add_argument('--loaded', type=int, default=1, help='so many of them loaded (1)')
    parser.add_argument('--busy', type=int, default=4, help='busy neighbours of those (4)')
    parser.add_argument('--target', default='demo', help='of make (demo)')
    words = parsed(parser, clones=1, busy=1, target='help')
    good = 0
    for k in range(words.clones):
        neighbours = words.busy if k < words.loaded else 0
        with tempfile.TemporaryDirectory(prefix='fresh_') as folder:
            clone, home = Path(folder) / 'clone', Path(folder) / 'home'
            home.mkdir()
            subprocess.run(['git', 'clone', '-q', ROOT, clone], check=True)
            with busy(neighbours):
                outcome = made(words.target, clone, environment(home))
        good += outcome.good
        print(f'clone {k + 1}, {neighbours} busy neighbours: {outcome.line()}', flush=True)
    print(f'{good} of {words.clones} clones')
    return 0 if good == words.clones else 1


if __name__ == '__main__':
    sys.exit(main())
