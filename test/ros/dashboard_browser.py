"""A browser without a screen, driven over its debugging protocol."""

from __future__ import annotations

import asyncio
import base64
import json
import shutil
import signal
import subprocess
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tornado.websocket import websocket_connect

BROWSER = next(
    filter(None, map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome'))), None
)
FLAGS = (
    '--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run',
    '--disable-background-networking', '--disable-component-update', '--disable-sync',
    '--hide-scrollbars', '--remote-debugging-port=0',
)  # fmt: skip

# Finds a model of the page by its name; its view has what is on the screen.
FIND = """
const model = (name) => Bokeh.documents[0].get_model_by_name(name);
const view = (name) => Bokeh.index.find_one_by_id(model(name).id);
"""


class Disturbed(Exception):
    """The page changed while it was asked, or has not got what was asked for."""


class Browser:
    """One page in a browser; everything it says, and asks the network for, is kept."""

    def __init__(self, folder: Path, *flags: str) -> None:
        assert BROWSER is not None
        self._loop = asyncio.new_event_loop()
        self._number = 0
        self._waiting: dict[int, Any] = {}
        self.complaints: list[str] = []
        self.requests: list[str] = []
        profile = folder / 'profile'
        self._process = subprocess.Popen(
            [BROWSER, *FLAGS, *flags, f'--user-data-dir={profile}', 'about:blank'],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        port = self._port(profile / 'DevToolsActivePort')
        with urllib.request.urlopen(f'http://127.0.0.1:{port}/json/list', timeout=30) as answer:
            (page,) = (t for t in json.load(answer) if t['type'] == 'page')
        self._socket = self._loop.run_until_complete(self._connect(page['webSocketDebuggerUrl']))
        for domain in ('Page', 'Runtime', 'Network', 'Log'):
            self.command(f'{domain}.enable')

    def _port(self, file: Path) -> int:
        end = time.monotonic() + 60.0
        while not (file.exists() and file.read_text().strip()):
            assert self._process.poll() is None, 'the browser ended at once'
            assert time.monotonic() < end, 'the browser did not start'
            time.sleep(0.05)
        return int(file.read_text().split()[0])

    async def _connect(self, url: str) -> Any:
        return await websocket_connect(url, max_message_size=1 << 28)

    def command(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command of the protocol and return its result."""
        self._number += 1
        number = self._number
        message = {'id': number, 'method': method, 'params': parameters}
        return self._loop.run_until_complete(self._exchange(number, message))

    async def _exchange(self, number: int, message: dict[str, Any]) -> dict[str, Any]:
        await self._socket.write_message(json.dumps(message))
        while True:
            text = await asyncio.wait_for(self._socket.read_message(), 60.0)
            assert text is not None, 'the browser ended'
            told = json.loads(text)
            if told.get('id') == number:
                if 'error' in told:
                    raise Disturbed(told['error'])
                return dict(told['result'])
            self._note(told.get('method', ''), told.get('params', {}))

    def _note(self, method: str, about: dict[str, Any]) -> None:
        if method == 'Network.requestWillBeSent':
            self.requests.append(about['request']['url'])
        elif method == 'Network.webSocketCreated':
            self.requests.append(about['url'])
        elif method == 'Runtime.exceptionThrown':
            self.complaints.append(json.dumps(about['exceptionDetails'])[:2000])
        elif method == 'Runtime.consoleAPICalled' and about['type'] in ('error', 'warning'):
            self.complaints.append(' '.join(str(a.get('value', a)) for a in about['args'])[:2000])
        elif method == 'Log.entryAdded' and about['entry']['level'] == 'error':
            self.complaints.append(str(about['entry']['text']))

    def size(self, width: int, height: int, phone: bool = False) -> None:
        """Make the screen so many pixels large."""
        self.command(
            'Emulation.setDeviceMetricsOverride', width=width, height=height,
            deviceScaleFactor=1, mobile=phone,
        )  # fmt: skip

    def open(self, url: str) -> None:
        """Open a page and wait until Bokeh has drawn it."""
        self.command('Page.navigate', url=url)
        self.until('window.Bokeh?.documents.length > 0 && Bokeh.documents[0].is_idle', 240.0)

    def run(self, code: str) -> Any:
        """Return what an expression is on the page."""
        done = self.command(
            'Runtime.evaluate', expression=f'(() => {{ {FIND} return {code} }})()',
            returnByValue=True, awaitPromise=True,
        )  # fmt: skip
        if 'exceptionDetails' in done:
            raise Disturbed(done['exceptionDetails'])
        return done['result'].get('value')

    def until(
        self, condition: str | Callable[[], Any], timeout: float = 120.0, what: str = ''
    ) -> Any:
        """Wait until an expression (or function) is true; return what it is."""
        end = time.monotonic() + timeout
        problem: object = ''
        while True:
            try:
                found = self.run(condition) if isinstance(condition, str) else condition()
            except Disturbed as error:
                found, problem = None, error
            if found:
                return found
            assert time.monotonic() < end, f'did not happen: {what or condition} {problem}'
            time.sleep(0.1)

    def value(self, name: str, field: str = 'value') -> Any:
        """Return a property of a model of the page."""
        return self.run(f'model({name!r})?.{field}')

    def place(self, name: str, inner: str = '') -> tuple[float, float, float, float]:
        """Return left, top, width and height of what is on the screen, scrolled into view."""
        element = f'view({name!r}).el' if not inner else f'view({name!r}).{inner}'
        box = self.run(
            f"(() => {{ const e = {element}; e.scrollIntoView({{block: 'center'}});"
            ' const b = e.getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; })()'
        )
        return tuple(box)

    def click(self, name: str, inner: str = '') -> None:
        """Click into the middle of a widget."""
        left, top, width, height = self.place(name, inner)
        self.drag((left + width / 2, top + height / 2))

    def drag(self, start: tuple[float, float], end: tuple[float, float] | None = None) -> None:
        """Press the mouse at a point, move it to another one and let it go."""
        button = {'button': 'left', 'clickCount': 1}
        x, y = start
        self.command('Input.dispatchMouseEvent', type='mouseMoved', x=x, y=y)
        self.command('Input.dispatchMouseEvent', type='mousePressed', x=x, y=y, **button)
        across, down = (end[0] - x, end[1] - y) if end else (0.0, 0.0)
        for share in (0.25, 0.5, 0.75, 1.0) if end else ():
            x = start[0] + share * across
            y = start[1] + share * down
            self.command('Input.dispatchMouseEvent', type='mouseMoved', x=x, y=y, buttons=1)
        self.command('Input.dispatchMouseEvent', type='mouseReleased', x=x, y=y, **button)

    def type(self, name: str, text: str) -> None:
        """Put a text into a field in place of what is there, and press return."""
        self.click(name, 'input_el')
        self.run(f'view({name!r}).input_el.select()')
        self.command('Input.insertText', text=text)
        key = {'key': 'Enter', 'code': 'Enter', 'windowsVirtualKeyCode': 13, 'text': '\r'}
        self.command('Input.dispatchKeyEvent', type='keyDown', **key)
        self.command('Input.dispatchKeyEvent', type='keyUp', **key)

    def photograph(self, path: Path, whole: bool = True) -> None:
        """Write a picture of the page."""
        done = self.command('Page.captureScreenshot', format='png', captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(done['data']))

    def close(self) -> None:
        """End the browser."""
        self._socket.close()
        self._loop.run_until_complete(asyncio.sleep(0.05))
        self._loop.close()
        self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
