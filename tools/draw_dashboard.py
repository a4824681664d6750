"""Draw docs/pictures/dashboard.png: the live page of a converged loop, in a browser.

python tools/draw_dashboard.py [--phone PNG]
"""

from __future__ import annotations

import argparse
import base64
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test' / 'ros'))

from dashboard_browser import Browser  # noqa: E402

PORT = 5016
MODEL = 'prandtl_ishlinskii_fine+mode+sensor_nonlinearity'


def ran(folder: Path, *words: str) -> None:
    """Run a program of the suite to its end."""
    subprocess.run([sys.executable, '-m', *words], cwd=folder, check=True)


def main() -> None:
    """Record, identify, run the loop until it has converged, and take the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'pictures' / 'dashboard.png')
    parser.add_argument('--phone', type=Path, help='also the page on a phone')
    parser.add_argument('--seconds', type=float, default=45.0, help='run time before the picture')
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sweep = '--frequencies 1,14,23,50 --amplitudes 0.5,1 --seconds 3 --warm-up 1 --out sweep'
        ran(folder, 'piezo_sim', 'sweep', *sweep.split())
        ran(folder, *f'piezo_hysteresis identify sweep --model {MODEL} --out fit'.split())
        words = f'-m piezo_hysteresis loop --model fit/model.yaml --port {PORT} --folder .'
        loop = subprocess.Popen(
            [sys.executable, *words.split()], cwd=folder,
            env={**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'},
        )  # fmt: skip
        browser = Browser(folder)
        try:
            browser.until(lambda: opened(browser))
            set_method = ['param', 'set', '/identification', 'method', 'pi_bank']
            ran(folder, 'piezo_hysteresis', *set_method)
            time.sleep(asked.seconds)
            photograph(browser, 1500, asked.out)
            if asked.phone:
                photograph(browser, 390, asked.phone)
        finally:
            browser.close()
            loop.send_signal(signal.SIGINT)
            loop.wait(60.0)


def opened(browser: Browser) -> bool:
    """Open the page; return whether the loop serves it by now."""
    browser.command('Page.navigate', url=f'http://localhost:{PORT}/')
    time.sleep(2.0)
    return bool(browser.run('window.Bokeh?.documents.length > 0'))


def photograph(browser: Browser, width: int, out: Path) -> None:
    """Open the page on a screen of this width and write a picture of all of it."""
    browser.size(width, 844, phone=width < 900)
    browser.until(lambda: opened(browser))
    time.sleep(5.0)
    height = browser.run('document.documentElement.scrollHeight')
    browser.size(width, height, phone=width < 900)
    time.sleep(5.0)
    picture = browser.command('Page.captureScreenshot', format='png')['data']
    out.write_bytes(base64.b64decode(picture))
    print(f'{out}: {width} x {height} pixels')


if __name__ == '__main__':
    main()
