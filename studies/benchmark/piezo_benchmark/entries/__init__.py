"""Entries: each file holds one function ``answer(task) -> Answer``.

An entry that sets ``NEEDS_TRUTH`` gets the truth as well and does not compete. The first
line of its docstring is what the page says of it.
"""

from __future__ import annotations

#: In the order of the page.
NAMES = (
    'ideal_observer', 'suite', 'least_squares_bic', 'pysindy', 'sysidentpy', 'joint_fit', 'coin',
    'most_frequent', 'always_none',
)  # fmt: skip
#: Entries with a function ``statement(task)``, whose probabilities are calibrated.
CALIBRATED = ('suite', 'least_squares_bic', 'pysindy', 'sysidentpy', 'joint_fit')
