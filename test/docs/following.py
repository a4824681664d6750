"""Follows a page as its reader does: types every block and compares what comes out."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from expectations import Live, Outcome
from pages import ROOT, Block, blocks_of

LONGEST = 900.0  # s that one block may take on a busy machine
ROS2 = (
    '[ "$1" = run ] || {{ echo "ros2 $1: not here" >&2; exit 9; }}\n'
    'exec {python} "{root}/install/$2/lib/$2/$3" "${{@:4}}"\n'
)
# Where a page is followed the workspace is set up, and nothing of it may be made anew.
MAKE = 'exec {make} -f "{root}/Makefile" -o setup -o setup-demo -o dev "$@"\n'


def prepare(folder: Path, **more: str) -> dict[str, str]:
    """Make a folder one to follow a page in; return its environment.

    `setup.bash` is in it, `make` makes the targets of this workspace, and `ros2 run` works also
    where only the wheels are there. `more` are variables that differ.
    """
    bin_ = folder / '.bin'
    bin_.mkdir(exist_ok=True)
    programs = {'make': MAKE.format(make=shutil.which('make'), root=ROOT)}
    if shutil.which('ros2') is None:
        programs['ros2'] = ROS2.format(python=sys.executable, root=ROOT)
    for name, text in programs.items():
        (bin_ / name).write_text(f'#!/bin/bash\n{text}')
        (bin_ / name).chmod(0o755)
    home = folder / '.home'
    home.mkdir(exist_ok=True)
    # What comes first on the path of this test stays first; setup.bash prepends to it.
    own = more.get('PYTHONPATH', os.environ.get('PYTHONPATH', ''))
    (folder / 'setup.bash').write_text(
        f'source "{ROOT}/setup.bash"\nexport PYTHONPATH="{own}" PATH="{bin_}:$PATH"\n'
    )
    path = f'{bin_}:{os.environ["PATH"]}'
    return {**os.environ, 'PATH': path, 'HOME': str(home), 'COLUMNS': '120', **more}


class Terminal:
    """A program that runs until Ctrl-C."""

    def __init__(self, words: list[str], folder: Path, env: Mapping[str, str], name: str) -> None:
        self.name = name
        self._said = (folder / f'.{name}.txt').open('w+')
        self._process = subprocess.Popen(
            words, cwd=folder, env=dict(env), stdout=self._said, stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip

    def check(self) -> None:
        """Raise AssertionError if it has ended by itself."""
        ended = self._process.poll()
        assert ended is None, f'{self.name} ended with {ended}: {self.said()[-2000:]}'

    def said(self) -> str:
        """Return what it has printed."""
        return Path(self._said.name).read_text(encoding='utf-8', errors='replace')

    def ctrl_c(self) -> None:
        """Press Ctrl-C and wait."""
        self.check()
        os.killpg(self._process.pid, signal.SIGINT)
        try:
            ended = self._process.wait(60)
        except subprocess.TimeoutExpired:
            self.kill()
            raise AssertionError(f'{self.name} outlives Ctrl-C: {self.said()[-2000:]}') from None
        text = self.said()
        assert ended in (0, 130, -signal.SIGINT), f'{self.name}: {ended}: {text[-2000:]}'
        assert 'Traceback' not in text, text[-2000:]

    def kill(self) -> None:
        """End it, however it is."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
        self._said.close()


class Follower:
    """Runs the blocks of a page in a folder."""

    def __init__(self, folder: Path, env: Mapping[str, str]) -> None:
        self._folder, self._env = folder, env
        self._open: list[Terminal] = []

    @contextmanager
    def session(self) -> Iterator[Follower]:
        """End what runs in terminals, also where a block fails."""
        try:
            yield self
            self.ctrl_c()
        finally:
            for each in self._open:
                each.kill()

    def follow(self, blocks: list[Block]) -> None:
        """Run blocks in order."""
        for block in blocks:
            if block.ctrl_c:
                self.ctrl_c()
            for command in block.given:
                self._run(['bash', '-eo', 'pipefail', '-c', command], block.line, (0,))
            if block.file is not None:
                path = self._folder / block.file
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(block.text, encoding='utf-8')
            elif block.is_command and block.not_run is None:
                self._do(block)

    def ctrl_c(self) -> None:
        """End what runs in terminals, the newest first."""
        while self._open:
            terminal = self._open.pop()
            try:
                terminal.ctrl_c()
            finally:
                terminal.kill()

    def _do(self, block: Block) -> None:
        if block.is_live:
            self._start(block)
            return
        refused = any(isinstance(e, Outcome) and e.kind == 'refused' for e in block.expected)
        python = shutil.which('python', path=self._env['PATH']) or sys.executable
        words = (
            [python, '-c', block.text]
            if block.language == 'python'
            else ['bash', '-eo', 'pipefail', '-c', block.text]
        )
        code, output = self._run(words, block.line, (2,) if refused else (0,))
        for each in block.expected:
            if isinstance(each, Outcome):
                try:
                    each.check(self._folder, code, output)
                except AssertionError as error:
                    raise AssertionError(f'line {block.line}: {error}') from None

    def _run(self, words: list[str], line: int, codes: tuple[int, ...]) -> tuple[int, str]:
        process = subprocess.Popen(
            words, cwd=self._folder, env=dict(self._env), stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
        )  # fmt: skip
        try:
            output, _ = process.communicate(timeout=LONGEST)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)  # with what it has started
            output, _ = process.communicate()
            raise AssertionError(f'line {line}: not done in {LONGEST:g} s: {output}') from None
        code = process.returncode
        assert code in codes, f'line {line}: exit code {code}: {output[-2000:]}'
        return code, output

    def _start(self, block: Block) -> None:
        from live_listener import listen

        if block.language == 'python':
            commands = [[sys.executable, '-c', block.text]]
        else:
            text = block.text.replace('\\\n', ' ')
            commands = [['bash', '-c', f'exec {line}'] for line in text.splitlines()]
        for number, words in enumerate(commands, 1):
            name = f'terminal-{block.line}-{number}'
            self._open.append(Terminal(words, self._folder, self._env, name))
        for each in block.expected:
            if isinstance(each, Live):
                try:
                    listen(each, int(self._env['ROS_DOMAIN_ID']), self._check)
                except AssertionError as error:
                    raise AssertionError(f'line {block.line}: {error}') from None

    def _check(self) -> None:
        for each in self._open:
            each.check()


def follow(page: Path, folder: Path, env: Mapping[str, str], until: str = '') -> None:
    """Run every block of a page, or those before the heading `until`."""
    blocks = blocks_of(page)
    if until:
        lines = page.read_text(encoding='utf-8').splitlines()
        end = lines.index(until)
        blocks = [block for block in blocks if block.line <= end]
    with Follower(folder, env).session() as follower:
        follower.follow(blocks)
