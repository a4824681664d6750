"""The page of one client, updated at the rate at which its browser draws."""

from __future__ import annotations

import time

from bokeh.document import Document
from bokeh.models import CustomJS, Div, Select

from piezo_hysteresis.dashboard.backend import Backend
from piezo_hysteresis.dashboard.panel import Controls
from piezo_hysteresis.dashboard.pictures import Pictures
from piezo_hysteresis.dashboard.template import WIDGET_STYLE, page_template
from piezo_hysteresis.dashboard.texts import banner, pulse, set_text, text_div

SLOWLY = 0.3  # shortest interval of updates of texts and spectra [s]
TIMEOUT = 10.0  # time after which an update is treated as lost [s]

# Runs in the browser after an update is drawn; in a hidden tab it waits.
SEEN = (
    'const tags = cb_obj.tags; requestAnimationFrame(() => setTimeout(() => {seen.tags = tags}))'
)


class Flow:
    """Flow control: the next update is sent only after the browser has drawn the previous one.

    Otherwise a slow browser would accumulate a delay.
    """

    def __init__(self, beat: Div) -> None:
        self._beat = beat
        self._number = 0
        self._sent_at = 0.0
        self.seen = Div(name='seen')
        beat.js_on_change('tags', CustomJS(args={'seen': self.seen}, code=SEEN))

    def ready(self) -> bool:
        """Return whether the browser waits for an update."""
        late = time.monotonic() - self._sent_at > TIMEOUT
        return late or list(self.seen.tags) == list(self._beat.tags)

    def sent(self) -> None:
        """Note that an update is sent."""
        self._number += 1
        self._sent_at = time.monotonic()
        self._beat.tags = [self._number]


class Page:
    """The document of one client."""

    def __init__(
        self,
        document: Document,
        backend: Backend,
        actuator: str,
        chosen: bool = False,
        refresh: float = 10.0,  # [Hz]
    ) -> None:
        self._backend, self._chosen = backend, chosen
        self._live = backend.live(actuator)
        self._pictures = Pictures()
        self._controls = Controls(backend, actuator)
        self._banner = text_div('banner')
        self._pulse = Div(text='', name='pulse', stylesheets=[WIDGET_STYLE])
        self._actuator = Select(
            value=actuator or '/', options=[actuator or '/'], name='actuator', width=180
        )
        self._actuator.js_on_change(
            'value',
            CustomJS(code="location.search = '?actuator=' + encodeURIComponent(cb_obj.value)"),
        )
        self._flow = Flow(self._pulse)
        self._slow = 0.0
        document.title = f'Actuator {actuator}'.strip()
        document.template = page_template()
        with document.models.freeze():  # otherwise each root would count all models again
            for root in (
                self._actuator, self._pulse, self._banner, *self._pictures.roots,
                *self._controls.roots,
            ):  # fmt: skip
                document.add_root(root)
            self._controls.refresh()
            self._draw(self._is_slow())
        document.add_periodic_callback(self.refresh, round(1000 / refresh))

    def refresh(self) -> None:
        """Update all parts of the page."""
        self._controls.refresh()
        if self._flow.ready():
            self._draw(self._is_slow())
            self._flow.sent()

    def _is_slow(self) -> bool:
        now = time.monotonic()
        if now - self._slow < SLOWLY:
            return False
        self._slow = now
        return True

    def _draw(self, slowly: bool) -> None:
        if slowly:
            self._offer_actuators()
            set_text(self._banner, banner(self._live))
            set_text(self._pulse, pulse(self._live, self._pictures.tracking))
            self._controls.show_state()
        self._pictures.refresh(self._live, slowly)

    def _offer_actuators(self) -> None:
        found = self._backend.actuators()
        options = sorted({name or '/' for name in (*found, self._live.actuator)})
        if options != list(self._actuator.options):
            self._actuator.options = options
        self._actuator.visible = len(options) > 1
        if not self._chosen and not self._live.received and self._live.actuator not in found:
            self._actuator.value = found[0] or '/'
