"""Finds what a model misses: check, locate, compete, verdict, advise."""

from piezo_hysteresis.discovery.verdict import Verdict
from piezo_hysteresis.discovery.workflow import Discovery, discover

__all__ = ['Discovery', 'Verdict', 'discover']
