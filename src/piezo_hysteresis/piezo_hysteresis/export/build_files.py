"""Makefile and CMakeLists.txt of a library."""

from __future__ import annotations

from piezo_hysteresis.export.programs import filled


def makefile(name: str, with_loop: bool) -> str:
    """Return the Makefile: the example, the self-test and the bench; without a loop the test."""
    return filled('Makefile.txt', name=name, programs=_programs(with_loop))


def cmake(name: str, version: str, with_loop: bool) -> str:
    """Return the CMakeLists.txt."""
    return filled('CMakeLists.txt', name=name, version=version, programs=_programs(with_loop))


def _programs(with_loop: bool) -> str:
    return 'example selftest bench' if with_loop else 'selftest'
