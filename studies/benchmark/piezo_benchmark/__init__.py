"""Benchmark of missing physics: records, a baseline that lacks something, a sealed truth, scores.

The package shares no code with any method that it measures. `VERSION` changes with everything
that changes a task or a score; results of two versions do not compare.
"""

from __future__ import annotations

VERSION = '1.1.0'
