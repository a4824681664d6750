"""What set-up does to the virtual environment, and how it asks for packages."""

from __future__ import annotations

import ctypes
import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / 'tools'))

import install_wheels
import repair_wheels


def test_uv_receives_the_options_of_pip() -> None:
    config = r"""
        global.index-url='https://index.example/simple'
        global.extra-index-url='\nhttps://one.example\nhttps://two.example'
        install.find-links='/wheels /more'
        global.constraint='/etc/constraints.txt'
        :env:.cert='/my.pem'
        freeze.timeout='10'
    """
    assert install_wheels.uv_settings(config) == {
        'UV_INDEX_STRATEGY': 'unsafe-best-match',
        'UV_DEFAULT_INDEX': 'https://index.example/simple',
        'UV_INDEX': 'https://one.example https://two.example',
        'UV_FIND_LINKS': '/wheels,/more',
        'UV_CONSTRAINT': '/etc/constraints.txt',
        'SSL_CERT_FILE': '/my.pem',
    }


@pytest.mark.parametrize('line', ["global.proxy='http://x'", "global.trusted-host='x'"])
def test_pip_is_used_for_options_that_only_pip_has(line: str) -> None:
    assert install_wheels.uv_settings(line) is None


@pytest.mark.component
def test_pip_takes_over_where_uv_fails(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ran: list[list[str]] = []

    def run(words: list[object], environment: object = None) -> bool:
        ran.append([str(word) for word in words])
        return 'uv' not in Path(ran[-1][0]).name

    monkeypatch.setattr(install_wheels, 'run', run)
    monkeypatch.setattr(install_wheels, 'uv_settings', lambda config: {})
    assert install_wheels.main(['-r', 'some.txt']) == 0
    assert ran[-1][1:3] == ['-m', 'pip']
    assert ran[-1][-2:] == ['-r', 'some.txt']
    assert 'pip takes longer' in capsys.readouterr().err


@pytest.mark.component
def test_pip_takes_nothing_for_installed_that_is_not_all_there(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    site, libraries = tmp_path / 'site', tmp_path / 'lib'
    libraries.mkdir()

    def install(name: str, *, whole: bool) -> Path:
        metadata = site / f'{name}-1.dist-info'
        metadata.mkdir(parents=True)
        listed = [f'../lib/{name}.so,,', f'{name}/gone.pyc,,', f'{metadata.name}/RECORD,,']
        (metadata / 'RECORD').write_text('\n'.join(listed))
        if whole:
            (libraries / f'{name}.so').touch()
        return metadata

    whole, half = install('whole', whole=True), install('half', whole=False)
    half_done = site / 'half_done-1.dist-info'
    half_done.mkdir()
    assert install_wheels.incomplete(site) == [half, half_done]

    def run(words: list[object], environment: object = None) -> bool:
        if install_wheels.UV in words or Path(str(words[0])).name == 'uv':
            return True  # and yet not all is there
        missing = not half.exists()
        install('half' if missing else 'third', whole=missing)
        return True

    monkeypatch.setattr(install_wheels, 'run', run)
    monkeypatch.setattr(install_wheels, 'uv_settings', lambda config: {})
    monkeypatch.setattr(install_wheels.sysconfig, 'get_path', lambda name: str(site))
    assert install_wheels.main(['-r', 'some.txt']) == 0
    assert install_wheels.incomplete(site) == []
    assert whole.exists()
    assert not half_done.exists()
    assert install_wheels.main(['-r', 'some.txt']) == 0  # nothing is left to do
    (libraries / 'whole.so').unlink()
    assert install_wheels.main(['-r', 'some.txt']) == 1
    assert not whole.exists()
    assert 'third-1' in capsys.readouterr().err


def test_copies_of_libraries_become_links_to_the_version(tmp_path: Path) -> None:
    content = os.urandom(repair_wheels.LARGE)
    for name in ('lib/libx.so', 'lib/libx.so.2', 'lib/libx.so.2.1', 'other.libs/libx.so'):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    (tmp_path / 'lib' / 'liby.so').write_bytes(content[::-1])
    (tmp_path / 'lib' / 'small.so').write_bytes(b'x')
    (tmp_path / 'lib' / 'small.so.1').write_bytes(b'x')
    cached = tmp_path / 'cache'  # the installer's own copy is the same file
    cached.hardlink_to(tmp_path / 'lib' / 'libx.so')
    assert repair_wheels.link_copies(tmp_path) == 3 * repair_wheels.LARGE
    links = {str(p.relative_to(tmp_path)) for p in tmp_path.rglob('*') if p.is_symlink()}
    assert links == {'lib/libx.so', 'lib/libx.so.2', 'other.libs/libx.so'}
    assert (tmp_path / 'other.libs' / 'libx.so').resolve() == tmp_path / 'lib' / 'libx.so.2.1'
    assert all((tmp_path / name).read_bytes() == content for name in links)
    assert not cached.is_symlink()
    assert cached.read_bytes() == content
    assert repair_wheels.link_copies(tmp_path) == 0


def test_exports_are_corrected_without_changing_the_cache_of_the_installer(tmp_path: Path) -> None:
    export = tmp_path / 'share' / 'x' / 'cmake' / 'xExport.cmake'
    export.parent.mkdir(parents=True)
    export.write_text('set(a "/opt/python/cp311/include/python3.11;/usr/include")')
    cached = tmp_path / 'cached'
    cached.hardlink_to(export)
    assert repair_wheels.mend_exports(tmp_path) == 1
    assert '/opt/python' not in export.read_text()
    assert '/usr/include' in export.read_text()
    assert '/opt/python' in cached.read_text()
    assert repair_wheels.mend_exports(tmp_path) == 0


def test_symbols_of_debuggers_are_removed_once(tmp_path: Path) -> None:
    source, library = tmp_path / 'x.c', tmp_path / 'lib' / 'libx.so'
    edited = tmp_path / 'x.libs' / 'libx.so'
    source.write_text('static int inner[20000] = {1}; int *outer(void) { return inner; }')
    for path in (library, edited):
        path.parent.mkdir()
        subprocess.run(['gcc', '-g', '-shared', '-fPIC', '-o', path, source], check=True)
    before = edited.stat().st_size
    saved = repair_wheels.strip_symbols(tmp_path)
    assert saved == before - library.stat().st_size > 0
    assert edited.stat().st_size == before
    assert ctypes.CDLL(str(library)).outer() != 0
    assert repair_wheels.strip_symbols(tmp_path) == 0


def test_the_parser_of_interfaces_keeps_its_trees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parser = tmp_path / 'lib' / 'python3' / 'site-packages' / 'rosidl_parser' / 'parser.py'
    parser.parent.mkdir(parents=True)
    parser.write_text(
        'import os\nparsed = []\n'
        'def get_ast_from_idl_string(text):\n    parsed.append(text)\n    return [text]\n'
    )
    repair_wheels.share_trees(tmp_path)
    once = parser.read_text()
    repair_wheels.share_trees(tmp_path)
    assert parser.read_text() == once
    space = runpy.run_path(str(parser))
    for folder, count in (('', 2), (str(tmp_path / 'trees'), 1)):
        monkeypatch.setenv('PIEZO_TREES', folder)
        space['parsed'].clear()
        assert [space['get_ast_from_idl_string']('a') for _ in range(2)] == [['a'], ['a']]
        assert len(space['parsed']) == count
