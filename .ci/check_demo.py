"""Check what ``make demo`` left: python .ci/check_demo.py FOLDER."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

NAMES = ('no compensation', 'feedforward', 'feedforward + attenuation')


def main() -> int:
    """Compare the three tracking errors with each other and print them."""
    folder = Path(sys.argv[1])
    summary = json.loads((folder / 'summary.json').read_text(encoding='utf-8'))
    runs = {run['name']: 1e6 * run['rmse_m'] for run in summary['tracking']['runs']}
    none, feedforward, attenuated = (runs[name] for name in NAMES)
    print(', '.join(f'{name} {runs[name]:.3g} um' for name in NAMES))
    report = (folder / 'report.html').stat().st_size
    # written when set-up has compiled the kernels of the demo, and nothing else
    set_up, kernels = Path('install/.compiled-for-demo'), Path('install/kernels').glob('*.nbi')
    compiled = set_up.stat().st_mtime if set_up.exists() else math.inf
    late = [path.name for path in kernels if path.stat().st_mtime > compiled]
    found = {
        'no compensation leaves 10 to 100 um': 10.0 < none < 100.0,
        'feedforward leaves less than a fifth of that': 0.0 < feedforward < 0.2 * none,
        'attenuation leaves less than a tenth of what feedforward does': 0.0
        < attenuated
        < 0.1 * feedforward,
        f'the demo compiles nothing {late}': not late,
        'the report holds its plots': report > 100_000,
        'the model was identified': bool(summary['parameters']) and bool(summary['records']),
    }
    wrong = [words for words, holds in found.items() if not holds]
    for words in wrong:
        print(f'error: it does not hold that {words}', file=sys.stderr)
    return int(bool(wrong))


if __name__ == '__main__':
    sys.exit(main())
