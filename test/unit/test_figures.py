"""The README shows the figures of the last measured run, and nothing else in their places."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from tools import write_figures as figures  # noqa: E402


def test_the_readme_shows_the_measured_figures() -> None:
    known = json.loads(figures.FIGURES.read_text(encoding='utf-8'))
    page = figures.README.read_text(encoding='utf-8')
    assert set(known) == set(figures.DIGITS) == {m[2] for m in figures.PLACE.finditer(page)}
    assert figures.with_figures(page, known) == page
    bare = re.sub('<!--.*?-->', '', page)
    for name, row in (
        ('no_compensation_um', '| no compensation | {} |'),
        ('feedforward_um', '| feedforward | {} |'),
        ('feedforward_attenuation_um', '| feedforward + attenuation | {} |'),
    ):
        assert row.format(figures.shown(name, known[name])) in bare


@pytest.mark.parametrize(
    ('value', 'text'), [(0.0447, '0.045'), (0.4, '0.40'), (1.921, '1.9'), (12.34, '12')]
)
def test_figures_keep_their_digits(value: float, text: str) -> None:
    assert figures.shown('feedforward_um', value) == text


def test_a_run_with_other_figures_is_reported(tmp_path: Path) -> None:
    for name in ('README.md', 'docs/figures.json', 'tools/write_figures.py'):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    known = json.loads(figures.FIGURES.read_text(encoding='utf-8'))
    names = {
        'no compensation': 'no_compensation_um', 'feedforward': 'feedforward_um',
        'feedforward + attenuation': 'feedforward_attenuation_um',
    }  # fmt: skip

    def check(factor: float) -> tuple[int, str]:
        runs = [
            {'name': name, 'rmse_m': factor * 1e-6 * known[key]} for name, key in names.items()
        ]
        (tmp_path / 'summary.json').write_text(json.dumps({'tracking': {'runs': runs}}))
        words = ['tools/write_figures.py', '--check', '--demo', str(tmp_path)]
        done = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        return done.returncode, done.stderr

    assert check(1.01) == (0, '')
    code, printed = check(1.2)
    assert code == 1
    assert len(printed.splitlines()) == 3
    page = (tmp_path / 'README.md').read_text(encoding='utf-8')
    (tmp_path / 'README.md').write_text(page.replace('-->43.2<', '-->43.9<'), encoding='utf-8')
    code, printed = check(1.0)
    assert code == 1
    assert 'README.md shows other figures' in printed
