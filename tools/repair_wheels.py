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
import sys
import sysconfig
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

FOREIGN = re.compile(r'/opt/(?:_internal|python)[^;"\s]*')

# Smaller libraries are not worth a link [bytes].
LARGE = 50_000


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


def main() -> int:
    """Mend the environment that runs this."""
    prefix = Path(sys.prefix)
    exports, saved = mend_exports(prefix), link_copies(prefix)
    print(f'  {exports} CMake exports mended, {saved / 1e6:.0f} MB of copies made links')
    return 0


if __name__ == '__main__':
    sys.exit(main())
