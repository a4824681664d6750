"""The figures and tables of five papers, made again on the simulated actuators."""

from __future__ import annotations

__version__ = '0.1.0'
