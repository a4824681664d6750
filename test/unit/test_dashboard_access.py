"""Who may speak to the live page: names, origins, token; every handler is behind one door."""

from __future__ import annotations

import asyncio
import http.client
import json
import logging
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from dashboard_fakes import Backend, filled
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

from piezo_hysteresis.dashboard.page_server import AccessPolicy, DashboardServer
from piezo_hysteresis.errors import PiezoError

TOKEN = 'a-token-of-enough-letters'
EVERY_PATH = (
    '/', '/ws', '/reports/one/report.html', '/static/js/bokeh.min.js', '/autoload.js', '/metadata',
    '/favicon.ico', '/nowhere',
)  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / 'runs'
    (folder / 'one').mkdir(parents=True)
    (folder / 'one' / 'report.html').write_text('<p>report</p>')
    (folder / 'model.yaml').write_text('secret')
    (tmp_path / 'outside.html').write_text('secret')
    (folder / 'link.html').symlink_to(tmp_path / 'outside.html')
    return folder


@pytest.fixture
def serve(folder: Path) -> Iterator[Callable[..., Any]]:
    running = []

    def start(**more: Any) -> DashboardServer:
        backend = Backend()
        filled(backend)
        server = DashboardServer(backend, address='127.0.0.1', port=0, folder=str(folder), **more)
        server.start()
        running.append(server)
        return server

    yield start
    for server in running:
        server.stop()


@pytest.fixture
def server(serve: Callable[..., Any]) -> Any:
    return serve()


def ask(
    server: Any, path: Any, host: str | None = None, method: str = 'GET', **headers: Any
) -> Any:
    """Return status, headers and text of an answer; a `host` without port gets the server's."""
    host = host or '127.0.0.1'
    named = host if ':' in host.rpartition(']')[2] else f'{host}:{server.port}'
    connection = http.client.HTTPConnection('127.0.0.1', server.port, timeout=60)
    connection.request(method, path, headers={'Host': named, **headers})
    answer = connection.getresponse()
    return answer.status, answer.headers, answer.read().decode(errors='replace')


def connect(server: Any, **headers: Any) -> None:
    """Open the WebSocket of the page and close it; the error of the handshake comes through."""

    async def run() -> None:
        request = HTTPRequest(f'ws://127.0.0.1:{server.port}/ws', headers=headers)
        socket = await websocket_connect(request, subprotocols=['bokeh', 'no-session'])
        socket.close()

    asyncio.run(run())


def test_reports_are_served_and_nothing_else(server: Any) -> None:
    assert server.local
    status, _, text = ask(server, '/reports/one/report.html')
    assert (status, text) == (200, '<p>report</p>')
    for path in ('model.yaml', '../outside.html', '%2e%2e/outside.html', 'link.html', 'one', ''):
        status, _, text = ask(server, f'/reports/{path}')
        assert status in (403, 404)
        assert 'secret' not in text


def test_the_page_needs_nothing_from_elsewhere(server: Any) -> None:
    status, _, text = ask(server, '/?actuator=stage')
    assert status == 200
    assert 'Actuator stage' in text
    assert 'cdn' not in text


@pytest.mark.parametrize('path', EVERY_PATH)
@pytest.mark.parametrize('method', ['GET', 'HEAD', 'POST', 'OPTIONS'])
def test_a_foreign_name_gets_nothing_from_any_handler(server: Any, path: Any, method: str) -> None:
    for host in ('rebound.example', '127.0.0.1.rebound.example', '127.0.0.1:1', 'localhost.'):
        status, _, text = ask(server, path, host, method)
        assert status == 403
        assert 'token' not in text
        assert 'rebound' not in text


def test_a_name_in_the_line_of_the_request_opens_nothing(server: Any) -> None:
    connection = http.client.HTTPConnection('127.0.0.1', server.port, timeout=60)
    connection.putrequest('GET', f'http://127.0.0.1:{server.port}/', skip_host=True)
    connection.putheader('Host', 'rebound.example')
    connection.endheaders()
    assert connection.getresponse().status == 403


@pytest.mark.parametrize('name', ['localhost', '127.0.0.1', '[::1]', 'LocalHost'])
def test_every_local_name_opens_the_page(server: Any, name: str) -> None:
    assert ask(server, '/', name)[0] == 200


def test_a_rebinding_page_gets_no_websocket(server: Any) -> None:
    """What Tornado takes for the same origin: both names are the foreign one."""
    foreign = f'rebound.example:{server.port}'
    own = f'127.0.0.1:{server.port}'
    with pytest.raises(HTTPClientError, match='403'):
        connect(server, Host=foreign, Origin=f'http://{foreign}')
    with pytest.raises(HTTPClientError, match='403'):
        connect(server, Host=foreign)
    for origin in (f'http://{foreign}', 'http://localhost:8888', 'null', f'file://{own}', '['):
        with pytest.raises(HTTPClientError, match='403'):
            connect(server, Host=own, Origin=origin)
    # Let in, it lacks the token of a session only.
    connect(server, Host=own, Origin=f'http://{own}')


@pytest.mark.component
def test_a_foreign_page_may_not_even_ask(server: Any) -> None:
    assert ask(server, '/', Origin='http://rebound.example')[0] == 403
    assert ask(server, '/', Origin=f'http://localhost:{server.port}')[0] == 200


@pytest.mark.component
def test_configured_names_open_the_page(serve: Callable[..., Any]) -> None:
    server = serve(origins=['bench:5006', 'Lab.example'])
    assert ask(server, '/', 'bench:5006')[0] == 200
    assert ask(server, '/', 'lab.example:443', Origin='https://lab.example')[0] == 200
    assert ask(server, '/', 'bench:5007')[0] == 403
    connect(server, Host='bench:5006', Origin='http://bench:5006')


@pytest.mark.parametrize('path', EVERY_PATH)
def test_no_answer_can_be_framed(server: Any, path: Any) -> None:
    _, headers, _ = ask(server, path)
    assert "frame-ancestors 'none'" in headers['Content-Security-Policy']
    assert headers['X-Frame-Options'] == 'DENY'
    assert headers['X-Content-Type-Options'] == 'nosniff'


def test_a_look_whether_the_page_is_there_is_answered(server: Any) -> None:
    status, headers, text = ask(server, '/', method='HEAD')
    assert (status, text) == (200, '')
    assert headers['Content-Type'].startswith('text/html')


def test_a_token_is_required_of_every_client(serve: Callable[..., Any]) -> None:
    server = serve(token=TOKEN)
    for path in (*EVERY_PATH, '/?token=wrong', f'/reports/one/report.html?token={TOKEN}'):
        assert ask(server, path)[0] == 401
    with pytest.raises(HTTPClientError, match='401'):
        connect(server)
    status, headers, _ = ask(server, f'/?token={TOKEN}&actuator=stage_x&x=%2F%2Frebound.example')
    assert status == 302
    assert headers['Location'] == '/?actuator=stage_x&x=%2F%2Frebound.example'
    cookie = headers['Set-Cookie']
    assert 'HttpOnly' in cookie
    assert TOKEN not in cookie
    shown = cookie.partition(';')[0]
    assert ask(server, '/', Cookie=shown)[0] == 200
    assert ask(server, '/reports/one/report.html', Cookie=f'other=1; {shown}')[0] == 200
    connect(server, Cookie=shown)
    assert ask(server, '/', 'rebound.example', Cookie=shown)[0] == 403
    assert ask(server, '/', Cookie=f'{shown[:-1]}x')[0] == 401


def test_no_log_holds_what_stands_behind_an_address(
    serve: Callable[..., Any], caplog: pytest.LogCaptureFixture
) -> None:
    server = serve(token=TOKEN)
    with caplog.at_level('DEBUG'):
        for path in ('/', '/reports/one/report.html', '/nowhere'):
            for host in ('127.0.0.1', 'rebound.example'):
                ask(server, f'{path}?token={TOKEN}', host)
        ask(server, f'/?token={TOKEN}x')
    assert '403 GET /' in caplog.text
    assert TOKEN not in caplog.text


@pytest.mark.parametrize(
    ('more', 'says'),
    [
        ({'token': 'short'}, 'has to be 16 or more'),
        ({'origins': ['http://bench:5006']}, 'write HOST:PORT'),
        ({'origins': ['*']}, 'write HOST:PORT'),
    ],
)
def test_what_would_let_everybody_in_is_refused(more: dict[str, Any], says: str) -> None:
    with pytest.raises(PiezoError, match=says):
        DashboardServer(Backend(), address='127.0.0.1', port=0, folder='.', **more)


def test_the_address_that_it_listens_at_is_a_name_of_it() -> None:
    assert '10.0.0.7:5006' in AccessPolicy('10.0.0.7', 5006).names
    assert '[fd00::7]:5006' in AccessPolicy('fd00::7', 5006).names
    assert AccessPolicy('0.0.0.0', 5006).names == AccessPolicy('::', 5006).names
    assert AccessPolicy('localhost', 80).names == ('localhost', '127.0.0.1', '[::1]')


def test_a_port_in_use_is_reported_in_one_line(server: Any) -> None:
    with pytest.raises(PiezoError, match='give another port'):
        DashboardServer(Backend(), address='127.0.0.1', port=server.port, folder='.')


@pytest.mark.parametrize('path', ['/%00', '/reports/%00', '/reports/a%00b.html', '/static/%00.js'])
def test_a_path_with_a_null_byte_is_refused_without_a_traceback(
    server: Any, path: str, caplog: pytest.LogCaptureFixture
) -> None:
    status, _, text = ask(server, path)
    assert status == 400
    assert text == 'the path has a null byte: open / instead\n'
    assert [record for record in caplog.records if record.exc_info] == []


HEAD = {'msgid': '1', 'msgtype': 'PATCH-DOC'}


@pytest.mark.component
@pytest.mark.parametrize(
    'parts',
    [
        ['rubbish'] * 3,
        [b'\xff\x00'],
        ['[]'] * 3,
        ['{"msgid": "1"}', '{}', '{}'],
        [json.dumps({**HEAD, 'msgtype': 'NOTHING'}), '{}', '{}'],
        [json.dumps(HEAD), '{}', '{}'],
        [json.dumps(HEAD), '{}', '{"events": [{"kind": "Rubbish"}]}'],
    ],
)
def test_rubbish_in_a_websocket_is_one_line_of_the_log(
    server: Any, parts: list[str | bytes], caplog: pytest.LogCaptureFixture
) -> None:
    found = re.search(r'"token":"([^"]+)"', ask(server, '/')[2])
    assert found is not None

    async def run() -> None:
        request = HTTPRequest(f'ws://127.0.0.1:{server.port}/ws')
        socket = await websocket_connect(request, subprotocols=['bokeh', found[1]])
        assert await asyncio.wait_for(socket.read_message(), 60) is not None
        for part in parts:
            await socket.write_message(part, binary=isinstance(part, bytes))
        while await asyncio.wait_for(socket.read_message(), 60) is not None:
            if caplog.records:  # an answer that names the error: the page stays connected
                break

    asyncio.run(run())
    (record,) = [each for each in caplog.records if each.name.startswith('bokeh')]
    assert '\n' not in logging.Formatter().format(record)
    assert ask(server, '/')[0] == 200
