"""The tutorials show what their script draws of what their commands leave."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / 'tools'))
import draw_tutorials  # noqa: E402


@pytest.mark.parametrize('name', draw_tutorials.NAMES)
def test_every_tutorial_of_the_verbs_shows_its_picture(name: Any) -> None:
    assert (
        f'](../pictures/tutorials/{name}.png)' in (draw_tutorials.PAGES / f'{name}.md').read_text()
    )
    assert (draw_tutorials.FOLDER / f'{name}.png').stat().st_size > 10_000
