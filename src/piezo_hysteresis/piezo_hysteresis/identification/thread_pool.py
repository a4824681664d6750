"""Threads that work on records, the same few for all that goes on in a process.

Fits that run side by side share them: however many records and candidates there are, no more
threads compute than were asked for, and none of them waits while another has work left.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Item = TypeVar('Item')
Result = TypeVar('Result')


# Shares of the work for each thread: many cost more than they even out.
_SHARES = 2


@cache
def _shared_pool(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count, thread_name_prefix='records')


if hasattr(os, 'register_at_fork'):  # threads stay behind in the parent
    os.register_at_fork(after_in_child=_shared_pool.cache_clear)


def of_each(
    function: Callable[[Item], Result], items: Sequence[Item], workers: int
) -> list[Result]:
    """Return the function of all items in order, worked on by so many threads.

    Parameters
    ----------
    function : callable
        Of one item; must not ask the crew for more itself.
    items : sequence
        Records, or parts of them.
    workers : int
        Threads; 1 or fewer work where this is called.
    """
    if workers <= 1 or len(items) < 2:
        return [function(each) for each in items]
    shares = range(min(_SHARES * workers, len(items)))
    done = list(
        _shared_pool(workers).map(
            lambda first: [function(each) for each in items[first :: len(shares)]], shares
        )
    )
    return [done[place % len(shares)][place // len(shares)] for place in range(len(items))]
