"""How large a file becomes, judged before it is expanded."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path

from piezo_hysteresis.errors import RecordError

#: Bytes that all columns of a file may take: 44 million samples of three columns.
LARGEST = 1 << 30
#: Cells of a sheet, filled or not.
MOST_CELLS = 20_000_000
_PIECE = 1 << 20


def judge(size: int, what: str = 'it') -> None:
    """Refuse content that would take more than `LARGEST` bytes."""
    if size > LARGEST:
        raise RecordError(
            f'{what} would take {size / 1e9:.4g} GB, at most {LARGEST / 1e9:.3g} GB are read; '
            'save time, voltage and displacement only, or shorter records'
        )


def judge_zip(path: Path) -> None:
    """Refuse an archive (``.npz``, ``.xlsx``) whose members are too large together."""
    with zipfile.ZipFile(path) as file:
        judge(sum(each.file_size for each in file.infolist()))


def judge_matlab(path: Path) -> None:
    """Refuse a MATLAB file of version 5 whose compressed elements are too large together."""
    size = path.stat().st_size
    judge(size)
    if 1100 * size < LARGEST:  # no stream of zlib is packed more tightly
        return
    total = 0
    with path.open('rb') as file:
        file.seek(126)
        order = 'little' if file.read(2) == b'IM' else 'big'
        while len(tag := file.read(8)) == 8:
            kind = int.from_bytes(tag[:4], order)  # type: ignore[arg-type]
            left = int.from_bytes(tag[4:], order)  # type: ignore[arg-type]
            if kind != 15:
                total += left
                file.seek(left, 1)
                continue
            stream = zlib.decompressobj()
            while left > 0 and (packed := file.read(min(left, _PIECE))):
                left -= len(packed)
                while packed:
                    total += len(stream.decompress(packed, _PIECE))
                    packed = stream.unconsumed_tail
                    judge(total)
