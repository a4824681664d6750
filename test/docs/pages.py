"""Takes code blocks out of pages and runs them as a reader would."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
FENCE = re.compile(r'^```(\w+)([^\n]*)\n(.*?)^```$', re.MULTILINE | re.DOTALL)
FILE = re.compile(r'# ([\w./-]+\.(?:py|yaml))\n')


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, what stands behind that, its text and its line."""

    language: str
    note: str
    text: str
    line: int

    @property
    def file(self) -> str | None:
        """Name under which the reader is to save it: its first line is a comment with a path."""
        found = FILE.match(self.text)
        return found.group(1) if found else None


def blocks_of(page: Path) -> list[Block]:
    """Return the fenced blocks of a page in order."""
    text = page.read_text(encoding='utf-8')
    return [
        Block(m.group(1), m.group(2).strip(), m.group(3), text.count('\n', 0, m.start()) + 1)
        for m in FENCE.finditer(text)
    ]


def environment(folder: Path, **more: str) -> dict[str, str]:
    """Return an environment in which `ros2 run` works, also where only the wheels are there."""
    env = {**os.environ, **more}
    if shutil.which('ros2') is None:
        shim = folder / 'bin' / 'ros2'
        shim.parent.mkdir(exist_ok=True)
        shim.write_text(
            '#!/bin/bash\n[ "$1" = run ] || exit 9\n'
            f'exec {sys.executable} "{ROOT}/install/$2/lib/$2/$3" "${{@:4}}"\n'
        )
        shim.chmod(0o755)
        env['PATH'] = f'{shim.parent}:{env["PATH"]}'
    return env


def run(block: Block, folder: Path, env: Mapping[str, str]) -> str:
    """Save or run a block in a folder; return what it printed.

    Raises
    ------
    AssertionError
        If it fails; the message shows what it printed.
    """
    if block.file is not None:
        (folder / block.file).parent.mkdir(parents=True, exist_ok=True)
        (folder / block.file).write_text(block.text, encoding='utf-8')
        return ''
    words = {
        'bash': ['bash', '-euo', 'pipefail', '-c', block.text],
        'python': [sys.executable, '-c', block.text],
    }[block.language]
    done = subprocess.run(
        words, cwd=folder, env=dict(env), capture_output=True, text=True, timeout=3000, check=False
    )
    assert done.returncode == 0, f'line {block.line}: {done.stdout[-2000:]}{done.stderr[-2000:]}'
    return done.stdout


class Terminal:
    """A block that runs until Ctrl-C."""

    def __init__(self, block: Block, folder: Path, env: Mapping[str, str]) -> None:
        self._said = (folder / f'terminal{block.line}.txt').open('w+')
        self._process = subprocess.Popen(
            ['bash', '-c', f'exec {block.text}'], cwd=folder, env=dict(env), stdout=self._said,
            stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip

    def ctrl_c(self) -> str:
        """Press Ctrl-C and wait; return what it had printed.

        Raises
        ------
        AssertionError
            If it ended in any other way.
        """
        ended = self._process.poll()
        if ended is None:
            os.killpg(self._process.pid, signal.SIGINT)
            try:
                ended = self._process.wait(60)
            except subprocess.TimeoutExpired:
                os.killpg(self._process.pid, signal.SIGKILL)
        self._said.seek(0)
        text = self._said.read()
        self._said.close()
        assert ended in (0, 130, -signal.SIGINT), text[-2000:]
        assert 'Traceback' not in text, text[-2000:]
        return text
