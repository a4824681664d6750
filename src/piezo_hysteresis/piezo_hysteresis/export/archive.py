"""A static library of one object file, written without a tool: no compiler is needed to export."""

from __future__ import annotations

import struct

_MAGIC = b'!<arch>\n'


def archive(name: str, code: bytes, symbols: list[str]) -> bytes:
    """Return an archive in the format of ar (SysV), with the table of symbols that linkers read.

    Parameters
    ----------
    name : str
        Of the object file; up to 15 letters.
    code : bytes
        The object file.
    symbols : list of str
        What it defines for others.
    """
    names = b''.join(symbol.encode() + b'\0' for symbol in symbols)
    size = 4 + 4 * len(symbols) + len(names)
    first = len(_MAGIC) + 60 + size + size % 2
    table = struct.pack(f'>{1 + len(symbols)}I', len(symbols), *([first] * len(symbols))) + names
    return _MAGIC + _member('/', table) + _member(f'{name}/', code)


def _member(name: str, content: bytes) -> bytes:
    head = f'{name:<16}{0:<12}{0:<6}{0:<6}{"644":<8}{len(content):<10}'.encode() + b'`\n'
    return head + content + b'\n' * (len(content) % 2)
