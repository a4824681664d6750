"""No room grows beyond its lines in the table of CONTRIBUTING.md."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
CORE = ROOT / 'src' / 'piezo_hysteresis' / 'piezo_hysteresis'
ROW = re.compile(r'^\|(?P<folders>[^|]+)\|(?P<lines> [\d ]+)\|', re.MULTILINE)


def table() -> dict[tuple[str, ...], int]:
    """Return the limit of each row by its folders."""
    text = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
    return {
        tuple(re.findall('`([^`]+)`', row['folders'])): int(row['lines'].replace(' ', ''))
        for row in ROW.finditer(text)
    }


def files(folder: str) -> list[Path]:
    """Return the files of a folder, given from the root or within the core package."""
    folder = folder.removeprefix('src/piezo_hysteresis/.../')
    if folder == '*.py':
        return list(CORE.glob('*.py'))
    inside = CORE / folder if (CORE / folder).is_dir() else ROOT / folder
    return list(inside.rglob('*.py'))


def lines(folders: tuple[str, ...]) -> int:
    return sum(
        file.read_text(encoding='utf-8').count('\n') for each in folders for file in files(each)
    )


def test_no_room_exceeds_its_lines() -> None:
    rooms = {folders: (lines(folders), most) for folders, most in table().items()}
    beyond = {room: both for room, both in rooms.items() if not 0 < both[0] <= both[1]}
    assert not beyond, (
        'take away what the new lines replace, or raise the number with the reason in the commit'
    )


def test_every_room_has_a_limit() -> None:
    rooms = {path.name for path in CORE.iterdir() if (path / '__init__.py').exists()}
    listed = {name.rpartition('/')[2] for folders in table() for name in folders}
    assert rooms - listed == set()
