"""Install requirement files into the virtual environment that runs this: by uv, else by pip.

uv takes a third of the time and a quarter of the processor. It is used only where it can follow
the configuration of pip; where it fails pip takes over and installs again what is incomplete. uv
is not kept. Bytecode is written where a module is first imported: compiling all of it takes longer
than installing the packages, and half of it is never used.

    .venv/bin/python tools/install_wheels.py -r requirements.txt -c constraints-ros.txt
"""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from pathlib import Path

UV = 'uv==0.13.9'

PIP = (sys.executable, '-m', 'pip', '--disable-pip-version-check')

# Settings of pip and their names for uv; an empty name has no effect on the result.
SAME = {
    'index-url': 'UV_DEFAULT_INDEX',
    'extra-index-url': 'UV_INDEX',
    'find-links': 'UV_FIND_LINKS',
    'constraint': 'UV_CONSTRAINT',
    'cert': 'SSL_CERT_FILE',
    'timeout': 'UV_HTTP_TIMEOUT',
    'default-timeout': 'UV_HTTP_TIMEOUT',
    'disable-pip-version-check': '',
    'no-warn-script-location': '',
    'progress-bar': '',
    'cache-dir': '',
    'retries': '',
}


def uv_settings(config: str) -> dict[str, str] | None:
    """Return the environment in which uv does what pip does, None where it cannot."""
    # pip looks at all its indexes
    environment = {'UV_INDEX_STRATEGY': 'unsafe-best-match'}
    for line in config.split('\n'):
        name, _, value = line.strip().partition('=')
        section, _, key = name.rpartition('.')
        if section not in ('global', 'install', ':env:'):
            continue
        if key not in SAME:
            return None
        words = value.strip('\'"').replace('\\n', ' ').split()
        if SAME[key]:
            separator = ',' if key == 'find-links' else ' '
            environment[SAME[key]] = separator.join(words)
    return environment


def incomplete(site: Path) -> list[Path]:
    """Return the metadata of packages of which a file is missing; compiled code may be."""
    found = []
    for record in sorted(site.glob('*.dist-info/RECORD')):
        with record.open(encoding='utf-8', newline='') as lines:
            names = [line[0] for line in csv.reader(lines) if line]
        if not all(name.endswith('.pyc') or (site / name).exists() for name in names):
            found.append(record.parent)
    bare = (path for path in site.glob('*.dist-info') if not (path / 'RECORD').exists())
    return found + sorted(bare)


def run(words: Sequence[object], environment: dict[str, str] | None = None) -> bool:
    """Run a command; return whether it went well."""
    env = {**os.environ, **(environment or {})}
    return subprocess.run([str(word) for word in words], env=env, check=False).returncode == 0


def by_uv(arguments: Sequence[str], quiet: Sequence[str]) -> bool:
    """Install with uv; return whether that went well."""
    config = subprocess.run([*PIP, 'config', 'list'], capture_output=True, text=True, check=False)
    environment = uv_settings(config.stdout) if config.returncode == 0 else None
    if environment is None:
        return False
    if not os.access(os.environ.get('XDG_CACHE_HOME') or Path.home(), os.W_OK):
        environment['UV_NO_CACHE'] = 'true'  # it must have one, if only for this time
    own = shutil.which('uv')
    with tempfile.TemporaryDirectory(prefix='uv_') as folder:
        if own is None:
            own = str(Path(folder) / 'bin' / 'uv')
            bring = ('install', '-qq', '--no-compile', '--no-deps', '--target', folder, UV)
            if not run((*PIP, *bring)):
                return False
        words = (own, 'pip', 'install', '--python', sys.executable, *quiet, *arguments)
        return run(words, environment)


def main(arguments: Sequence[str]) -> int:
    """Install what the arguments say, as those of pip; return the exit code."""
    quiet = () if sys.stderr.isatty() else ('-q',)
    site = Path(sysconfig.get_path('purelib'))
    if by_uv(arguments, quiet) and not incomplete(site):
        return 0
    print('setup: uv cannot be used here; pip takes longer', file=sys.stderr)
    for metadata in incomplete(site):  # of an installation that was broken off
        shutil.rmtree(metadata)
    if not run((*PIP, 'install', '--no-compile', *quiet, *arguments)):
        return 1
    if left := incomplete(site):
        names = ', '.join(path.stem for path in left)
        print(f'setup: files of {names} are missing: remove .venv and try again', file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
