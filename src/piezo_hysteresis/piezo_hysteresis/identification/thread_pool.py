"""Thread pool for work on records, shared by all fits of a process.

Parallel fits share it: for any number of records and candidates, no more threads compute than
requested, and no thread is idle while there is work.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Item = TypeVar('Item')
Result = TypeVar('Result')


# Portions of the work per thread: more portions cost more time than they balance.
_SHARES = 2


@cache
def _shared_pool(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count, thread_name_prefix='records')


if hasattr(os, 'register_at_fork'):  # threads remain in the parent process
    os.register_at_fork(after_in_child=_shared_pool.cache_clear)


def of_each(
    function: Callable[[Item], Result], items: Sequence[Item], workers: int
) -> list[Result]:
    """Return the function of all items in order, computed by several threads."""
    if workers <= 1 or len(items) < 2:
        return [function(each) for each in items]
    shares = range(min(_SHARES * workers, len(items)))
    done = list(
        _shared_pool(workers).map(
            lambda first: [function(each) for each in items[first :: len(shares)]], shares
        )
    )
    return [done[place % len(shares)][place // len(shares)] for place in range(len(items))]
