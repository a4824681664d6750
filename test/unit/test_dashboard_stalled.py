"""What a client sends by mistake, and one that stops reading."""

from __future__ import annotations

import logging
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip('bokeh')

from piezo_hysteresis.dashboard.page_server import StalledClients, in_one_line


class Stream:
    """A connection with something in its queue."""

    def __init__(self) -> None:
        self._total_write_done_index, self.closed, self.queued = 0, False, True

    def writing(self) -> bool:
        return self.queued

    def close(self) -> None:
        self.closed = True


def test_a_client_that_stops_reading_is_disconnected() -> None:
    streams = reads, _, idle = Stream(), Stream(), Stream()
    idle.queued = False
    clients: Any = [
        SimpleNamespace(_socket=SimpleNamespace(ws_connection=SimpleNamespace(stream=each)))
        for each in streams
    ]
    clients.append(SimpleNamespace(_socket=SimpleNamespace(ws_connection=None)))
    watch = StalledClients(SimpleNamespace(_clients=clients))
    for _ in range(3):
        watch.look()
        reads._total_write_done_index += 1000
    assert [each.closed for each in streams] == [False, True, False]


def test_rubbish_is_logged_in_one_line() -> None:
    try:
        raise ValueError('rubbish')
    except ValueError as error:
        details: Any = (ValueError, error, error.__traceback__)
    record = logging.LogRecord('a', logging.ERROR, '', 1, 'bad\n%s', ('x' * 999,), details)
    assert in_one_line(record)
    assert logging.Formatter().format(record) == 'bad'
