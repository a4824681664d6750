"""Mend what wheels cannot say: paths of this machine, and files that are links.

The CMake exports of the ROS wheels name the headers of the machine that built them, and CMake
refuses paths that do not exist. A wheel holds no links, so that libraries lie in it two or three
times, and those that many wheels bring along once in each: one copy is kept, the others become
links to it. Running it again changes nothing.
"""

from __future__ import annotations

import filecmp
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

FOREIGN = re.compile(r'/opt/(?:_internal|python)[^;"\s]*')

# Smaller libraries are not worth a link [bytes].
LARGE = 50_000

# Behind the parser of interfaces. A tree in the folder of the build is read only by that build.
KEPT_TREES = """

_parsed = get_ast_from_idl_string


def get_ast_from_idl_string(idl_string):  # added by tools/repair_wheels.py
    import hashlib
    import pickle
    folder = os.environ.get('PIEZO_TREES')
    if not folder:
        return _parsed(idl_string)
    path = os.path.join(folder, hashlib.sha256(idl_string.encode()).hexdigest())
    try:
        with open(path, 'rb') as kept:
            return pickle.load(kept)
    except FileNotFoundError:
        tree = _parsed(idl_string)
    os.makedirs(folder, exist_ok=True)
    part = f'{path}.{os.getpid()}'
    with open(part, 'wb') as kept:
        pickle.dump(tree, kept)
    os.replace(part, path)
    return tree
"""


def replacement(found: re.Match[str]) -> str:
    """Return the local folder for a header folder of the build machine."""
    if 'numpy' in found.group():
        return np.get_include()
    return str(sysconfig.get_config_var('INCLUDEPY'))


def mend_exports(prefix: Path) -> int:
    """Rewrite every export file that names a foreign folder; return how many."""
    count = 0
    for export in sorted(prefix.glob('share/*/cmake/*Export*.cmake')):
        text = export.read_text()
        mended = FOREIGN.sub(replacement, text)
        if mended != text:
            # under another name first: this one may be shared with the cache of the installer
            part = export.with_suffix('.part')
            part.write_text(mended)
            part.replace(export)
            count += 1
    return count


def copies(prefix: Path) -> Iterator[tuple[Path, Path]]:
    """Return pairs of shared libraries with the same content, the one to keep first."""
    sizes = defaultdict(list)
    for path in sorted(prefix.rglob('*.so*')):
        if path.is_file() and not path.is_symlink() and path.stat().st_size >= LARGE:
            sizes[path.stat().st_size].append(path)
    for same_size in sizes.values():
        kept: list[Path] = []
        # the longest name is that of the version, to which the others refer
        for path in sorted(same_size, key=lambda each: (-len(each.name), str(each))):
            twin = next((k for k in kept if filecmp.cmp(k, path, shallow=False)), None)
            if twin is None:
                kept.append(path)
            else:
                yield twin, path


def link_copies(prefix: Path) -> int:
    """Replace copies of shared libraries by links; return the bytes that it saved."""
    saved = 0
    for kept, copy in copies(prefix):
        saved += copy.stat().st_size
        part = copy.with_name(f'{copy.name}.part')
        part.symlink_to(os.path.relpath(kept, copy.parent))
        part.replace(copy)
    return saved


def share_trees(prefix: Path) -> None:
    """Let the parser of interfaces keep its trees in a folder, if one is named."""
    (parser,) = prefix.glob('lib/python*/site-packages/rosidl_parser/parser.py')
    text = parser.read_text(encoding='utf-8')
    if KEPT_TREES not in text:
        part = parser.with_suffix('.part')
        part.write_text(text + KEPT_TREES, encoding='utf-8')
        part.replace(parser)


def strip_symbols(prefix: Path) -> int:
    """Remove symbols for debuggers from shared libraries; return the bytes that it saved."""
    program, saved = shutil.which('strip'), 0
    if program is None:
        return 0
    for path in sorted(prefix.rglob('*.so*')):
        # what lies in `*.libs` has been edited by the maker of the wheel, which strip may not bear
        edited = any(parent.suffix == '.libs' for parent in path.parents)
        if path.is_symlink() or edited or path.stat().st_size < LARGE:
            continue
        part, before = path.with_name(f'{path.name}.part'), path.stat().st_size
        words = (program, '--strip-unneeded', '--preserve-dates', '-o', part, path)
        done = subprocess.run(words, capture_output=True, check=False)
        if done.returncode == 0 and part.stat().st_size < before:
            saved += before - part.stat().st_size
            part.replace(path)
        part.unlink(missing_ok=True)
    return saved


def main() -> int:
    """Mend the environment that runs this."""
    prefix = Path(sys.prefix)
    exports, linked, stripped = mend_exports(prefix), link_copies(prefix), strip_symbols(prefix)
    share_trees(prefix)
    print(
        f'  {exports} CMake exports mended; copies made links: {linked / 1e6:.0f} MB, '
        f'symbols of debuggers removed: {stripped / 1e6:.0f} MB'
    )
    return 0


if __name__ == '__main__':
    sys.exit(main())
