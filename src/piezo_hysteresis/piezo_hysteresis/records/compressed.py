"""Bags that ``ros2 bag record`` compressed, by file or by message."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Generator
from pathlib import Path

import numpy as np

from piezo_hysteresis.arrays import IntArray
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.storage import MessageBlock, Storage, Topic

PIECE = 1 << 20
LARGEST_MESSAGE = 1 << 30


class CompressedFile:
    """A storage file compressed as a whole (``.mcap.zstd``, ``.db3.zstd``).

    Parameters
    ----------
    path : Path
        The compressed file.
    log : DamageLog
        Where damage is listed, or raised.
    reader : callable
        Makes the storage of the uncompressed file.
    """

    def __init__(
        self, path: Path, log: DamageLog, reader: Callable[[Path, DamageLog], Storage]
    ) -> None:
        self.path = path
        self.log = log
        self.topics: dict[int, Topic] = {}
        self._reader = reader

    def blocks(self) -> Generator[MessageBlock]:
        """Yield the blocks of the uncompressed file, which lies in a temporary folder."""
        from backports import zstd

        with tempfile.TemporaryDirectory() as folder:
            plain = Path(folder) / self.path.stem
            try:
                with zstd.open(self.path, 'rb') as source, plain.open('wb') as target:
                    while piece := source.read(PIECE):
                        target.write(piece)
            except (zstd.ZstdError, EOFError) as error:
                self.log.add(self.path, f'it cannot be decompressed to its end ({error})')
            storage = self._reader(plain, self.log)
            for block in storage.blocks():
                self.topics = storage.topics
                yield block


def decompressed(block: MessageBlock, path: Path, log: DamageLog) -> MessageBlock:
    """Return a block whose messages were compressed one by one."""
    from backports import zstd

    payloads, good = [], np.ones(block.topic.size, np.bool_)
    for index in range(block.topic.size):
        try:
            decompressor = zstd.ZstdDecompressor()
            payloads.append(decompressor.decompress(block.payload(index), LARGEST_MESSAGE))
        except zstd.ZstdError:
            good[index] = False
    bad = int(good.size - good.sum())
    if bad:
        log.add(path, f'{bad} messages cannot be decompressed', count=bad, lost=bad)
    length: IntArray = np.array([len(payload) for payload in payloads], np.int64)
    return MessageBlock(
        np.frombuffer(b''.join(payloads), np.uint8),
        block.topic[good],
        block.log_time[good],
        np.cumsum(length) - length,
        length,
    )
