"""Names that a package loads when they are used are where the package says."""

from __future__ import annotations

import importlib

import pytest

PACKAGES = ('piezo_sim', 'piezo_hysteresis', 'piezo_hysteresis.discovery')


@pytest.mark.parametrize('package', PACKAGES)
def test_every_public_name_can_be_loaded(package: str) -> None:
    module = importlib.import_module(package)
    assert module.__all__
    for name in module.__all__:
        assert getattr(module, name) is not None
