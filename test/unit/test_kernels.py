"""Kernels: compiled by set-up, cached, found again by every process, never confused."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from piezo_hysteresis.jit import inline_jit, jit

TOOLS = Path(__file__).parents[2] / 'tools'
sys.path.insert(0, str(TOOLS))

from compile_kernels import CALLS  # noqa: E402

# Kernels that neither were run by a call of set-up nor are called by one that was.
FRESH = """
    import importlib, pkgutil, sys
    sys.path.insert(0, sys.argv[1])
    from compile_kernels import CALLS, run
    from piezo_hysteresis.kernels import cache
    from piezo_hysteresis.kernels.compile import MADE
    # packages that need ROS, and one whose kernels are compiled for other machines only
    elsewhere = '__main__', '.nodes', '.ros', '.export.'
    failed = [failure for _, failure in map(run, CALLS) if failure]
    kernels = {}
    for package in 'piezo_sim', 'piezo_hysteresis':
        root = importlib.import_module(package)
        for info in pkgutil.walk_packages(root.__path__, f'{package}.'):
            if not any(each in info.name for each in elsewhere):
                for value in vars(importlib.import_module(info.name)).values():
                    function = getattr(value, 'py_func', None)
                    if function is not None and function.__module__ == info.name:
                        kernels[f'{info.name}.{function.__qualname__}'] = value
    reached = set()
    for kernel in (*kernels.values(), *MADE):  # those generated at run time are in no module
        if kernel.signatures:
            reached.update(cache.within(kernel.py_func))
    assert len(kernels) > 100
    print(failed + sorted(name for name, each in kernels.items() if each.py_func not in reached))
"""


def python(code: str, *arguments: Path | str | int, **environment: str) -> Any:
    """Run Python in a process of its own; answer its lines and those of its errors."""
    words = [sys.executable, '-c', textwrap.dedent(code), *map(str, arguments)]
    done = subprocess.run(
        words, env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines(), done.stderr.splitlines()


def kept(folder: Path) -> list[Any]:
    return sorted(path.name for path in Path(folder).rglob('*.nbc'))


@pytest.fixture
def module(tmp_path: Path) -> Callable[..., Any]:
    """Make two modules, the kernel of one calls that of the other; answer how they are written."""

    def write(factor: float = 2.0) -> None:
        (tmp_path / 'piezo_inner.py').write_text(
            'from piezo_hysteresis.kernels.compile import inline_jit\n'
            f'@inline_jit\ndef times(x):\n    return {factor} * x\n'
        )
        (tmp_path / 'piezo_outer.py').write_text(
            'from piezo_inner import times\n'
            'from piezo_hysteresis.kernels.compile import jit\n'
            '@jit\ndef outer(x):\n    return times(x) + 1\n'
        )

    write()
    return write


CALL = """
    import sys
    sys.path.insert(0, sys.argv[1])
    from piezo_outer import outer
    print(outer(eval(sys.argv[2])), sum(outer.stats.cache_misses.values()))
"""


BLAS = """
import sys
import numpy as np
from piezo_hysteresis.kernels.compile import jit
@jit
def plain(x):
    return x + 1.0
@jit
def product(a):
    return np.dot(a, a)
print(plain(1.0), 'scipy.linalg' in sys.modules)
print(np.array_equal(product(2.0 * np.eye(2)), 4.0 * np.eye(2)), 'scipy.linalg' in sys.modules)
"""


@pytest.mark.component
def test_only_kernels_that_use_blas_import_scipy(tmp_path: Path) -> None:
    (tmp_path / 'piezo_blas.py').write_text(BLAS)
    code = 'import sys; sys.path.insert(0, sys.argv[1]); import piezo_blas'
    lines, _ = python(code, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / 'kept'))
    assert lines == ['2.0 False', 'True True']


@pytest.mark.component
def test_set_up_runs_every_kernel() -> None:
    assert python(FRESH, TOOLS)[0] == ['[]'], 'let a call of compile_kernels run these'


def test_set_up_of_the_demo_finds_its_calls() -> None:
    names = re.search("make_workspace '([^']+)';", (TOOLS / 'setup.sh').read_text())
    assert names is not None
    assert CALLS.keys() >= set(names[1].split()) == {'plant', 'fit', 'demo'}


@pytest.mark.component
def test_a_kernel_is_compiled_once(module: Callable[..., Any], tmp_path: Path) -> None:
    folder = tmp_path / 'kept'
    first = python(CALL, tmp_path, '1.0', NUMBA_CACHE_DIR=str(folder))[0]
    again = python(CALL, tmp_path, '1.0', NUMBA_CACHE_DIR=str(folder))[0]
    assert (first, again) == (['3.0 1'], ['3.0 0'])
    assert len(kept(folder)) == 1


def test_a_piece_called_from_python_runs_its_source() -> None:
    @inline_jit
    def twice(x: float) -> float:
        return 2.0 * x

    @jit
    def outer(x: float) -> float:
        return twice(x) + twice(3.0)

    assert (outer(1.5), twice(1.5)) == (9.0, 3.0)


@pytest.mark.component
def test_a_kernel_is_compiled_anew_when_one_that_it_calls_has_changed(
    module: Callable[..., Any], tmp_path: Path
) -> None:
    # Python takes an edit of equal length within one second for no edit: no .pyc, for both runs.
    environment = {'NUMBA_CACHE_DIR': str(tmp_path / 'kept'), 'PYTHONDONTWRITEBYTECODE': '1'}
    assert python(CALL, tmp_path, '1.0', **environment)[0] == ['3.0 1']
    module(factor=5.0)
    assert python(CALL, tmp_path, '1.0', **environment)[0] == ['6.0 1']


@pytest.mark.slow
def test_a_damaged_file_is_compiled_over(module: Callable[..., Any], tmp_path: Path) -> None:
    folder = tmp_path / 'kept'
    python(CALL, tmp_path, '1.0', NUMBA_CACHE_DIR=str(folder))
    (file,) = folder.rglob('*.nbc')
    file.write_bytes(file.read_bytes()[:100])
    assert python(CALL, tmp_path, '1.0', NUMBA_CACHE_DIR=str(folder))[0] == ['3.0 1']
    assert python(CALL, tmp_path, '1.0', NUMBA_CACHE_DIR=str(folder))[0] == ['3.0 0']


@pytest.mark.slow
def test_processes_that_start_at_once_never_mix_signatures(
    module: Callable[..., Any], tmp_path: Path
) -> None:
    folder = tmp_path / 'kept'
    environment = {**os.environ, 'NUMBA_CACHE_DIR': str(folder)}
    kinds = ['1.0', '1', '1j', '1.0', '1', '1j']
    running = [
        subprocess.Popen(
            [sys.executable, '-c', textwrap.dedent(CALL), str(tmp_path), kind],
            env=environment, stdout=subprocess.PIPE, text=True,
        )
        for kind in kinds
    ]  # fmt: skip
    values = ['3.0', '3.0', '(1+2j)', '3.0', '3.0', '(1+2j)']
    assert [process.communicate()[0].split()[0] for process in running] == values
    assert len(kept(folder)) == 3
    for kind, value in zip(kinds[:3], values, strict=False):
        assert python(CALL, tmp_path, kind, NUMBA_CACHE_DIR=str(folder))[0] == [f'{value} 0']


@pytest.mark.component
def test_without_a_writable_folder_it_compiles_in_memory_with_one_message(
    module: Callable[..., Any], tmp_path: Path
) -> None:
    code = """
    import piezo_hysteresis.kernels.cache as cache
    from pathlib import Path
    cache.folders = lambda: (Path('/dev/null/a'), Path('/dev/null/b'))
    """
    lines, printed = python(code + CALL + '\n    outer(1)', tmp_path, '1.0')
    assert lines == ['3.0 1']
    (note,) = printed
    assert note.startswith('note: compiled kernels cannot be kept in /dev/null/a nor /dev/null/b')


@pytest.mark.slow
def test_a_folder_that_cannot_be_written_is_read(
    module: Callable[..., Any], tmp_path: Path
) -> None:
    folder = tmp_path / 'kept'
    python(CALL, tmp_path, '1.0', NUMBA_CACHE_DIR=str(folder))
    code = """
    import errno, pathlib
    from numba.core.caching import IndexDataCacheFile
    def refuse(*_, **__):
        raise OSError(errno.EROFS, 'read-only')
    pathlib.Path.mkdir = IndexDataCacheFile.save = refuse
    """
    lines, printed = python(code + CALL, tmp_path, '1.0', NUMBA_CACHE_DIR=str(folder))
    assert (lines, printed) == (['3.0 0'], [])


@pytest.mark.component
def test_a_full_folder_leaves_the_kernel_to_the_next(
    module: Callable[..., Any], tmp_path: Path
) -> None:
    code = """
    import errno, sys
    from pathlib import Path
    from numba.core.caching import IndexDataCacheFile
    import piezo_hysteresis.kernels.cache as cache
    cache.folders = lambda: (Path(sys.argv[1]) / 'full', Path(sys.argv[1]) / 'free')
    save = IndexDataCacheFile._save_data
    def limited(self, name, data):
        if self._cache_path.endswith('full'):  # the index fits, the machine code does not
            raise OSError(errno.ENOSPC, 'No space left on device')
        save(self, name, data)
    IndexDataCacheFile._save_data = limited
    """
    assert python(code + CALL, tmp_path, '1.0') == (['3.0 1'], [])
    assert len(kept(tmp_path / 'free')) == 1
    assert python(code + CALL, tmp_path, '1.0') == (['3.0 0'], [])


def test_kernels_lie_in_the_workspace_and_then_with_the_user() -> None:
    code = 'from piezo_hysteresis.kernels.cache import folders; print(*folders(), sep="\\n")'
    root = Path(__file__).parents[2].resolve()
    environment = {'XDG_CACHE_HOME': '/home/me/cache', 'NUMBA_CACHE_DIR': '/my'}
    assert python(code, **environment)[0] == [
        '/my/piezo_kernels',
        str(root / 'install/kernels'),
        '/home/me/cache/piezo_kernels',
    ]


def test_kernels_of_the_same_parts_in_another_order_are_two() -> None:
    from piezo_hysteresis.kernels.cache import closure
    from piezo_hysteresis.kernels.compile import jit

    def scaled(factor: Any) -> Any:
        @jit
        def scale(x: Any) -> Any:
            return factor * x

        return scale

    def after(one: Any, other: Any) -> Any:
        @jit
        def both(x: Any) -> Any:
            return other(one(x) + 1.0)

        return both

    two, three = scaled(2.0), scaled(3.0)
    assert closure(after(two, three).py_func) != closure(after(three, two).py_func)
    assert closure(after(two, three).py_func) == closure(after(scaled(2.0), scaled(3.0)).py_func)
    assert after(two, three)(1.0) == 9.0
    assert after(three, two)(1.0) == 8.0


TWINS = """
    from piezo_hysteresis.kernels.compile import jit, inline_jit

    def made(factor):
        @inline_jit
        def inner(x, n):
            return factor * x if n <= 0 else inner(x + 1.0, n - 1)

        @jit
        def outer(x, n):
            return inner(x, n)

        return outer
"""


@pytest.mark.slow
def test_kernels_of_one_text_that_other_processes_kept_stay_two(tmp_path: Path) -> None:
    (tmp_path / 'piezo_twins.py').write_text(textwrap.dedent(TWINS))
    call = """
    import sys
    sys.path.insert(0, sys.argv[1])
    from piezo_twins import made
    kernels = [made(float(factor)) for factor in sys.argv[2:]]
    print(*[each(1.0, 2) for each in kernels],
          sum(sum(each.stats.cache_misses.values()) for each in kernels))
    """
    environment = {'NUMBA_CACHE_DIR': str(tmp_path / 'kept')}
    assert python(call, tmp_path, 2, **environment)[0] == ['6.0 1']
    assert python(call, tmp_path, 3, **environment)[0] == ['9.0 1']
    assert python(call, tmp_path, 2, 3, **environment)[0] == ['6.0 9.0 0']
