"""Makefile and CMakeLists.txt of a library."""

from __future__ import annotations

from piezo_hysteresis.export.programs import template

_PROGRAMS = 'example selftest bench'


def makefile(name: str, with_loop: bool) -> str:
    """Return the Makefile: the example, the self-test and the bench; without a loop the test."""
    text = template('Makefile.txt')
    text = text if with_loop else text.replace(_PROGRAMS, 'selftest')
    return text.replace('NAME', name)


def cmake(name: str, version: str, with_loop: bool) -> str:
    """Return the CMakeLists.txt."""
    text = template('CMakeLists.txt')
    text = text if with_loop else text.replace(_PROGRAMS, 'selftest')
    return text.replace('=NAME=', name).replace('VERSION_', version)
