"""Point the CMake exports of the ROS wheels at this machine's Python and numpy headers.

The wheels name the headers of the machine that built them, and CMake refuses paths that do not
exist. Running it again changes nothing.
"""

import re
import sys
import sysconfig
from pathlib import Path

import numpy as np

FOREIGN = re.compile(r'/opt/(?:_internal|python)[^;"\s]*')


def replacement(found: re.Match[str]) -> str:
    """Answer the local folder for a header folder of the build machine."""
    if 'numpy' in found.group():
        return np.get_include()
    return str(sysconfig.get_config_var('INCLUDEPY'))


def main() -> int:
    """Rewrite every export file that names a foreign folder; print how many."""
    count = 0
    for export in sorted(Path(sys.prefix).glob('share/*/cmake/*Export*.cmake')):
        text = export.read_text()
        mended = FOREIGN.sub(replacement, text)
        if mended != text:
            export.write_text(mended)
            count += 1
    print(f'setup: {count} CMake exports of the ROS wheels now point at local headers')
    return 0


if __name__ == '__main__':
    sys.exit(main())
