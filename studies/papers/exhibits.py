"""A reproduced figure or table of a paper, and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import AutoLocator, MaxNLocator

from piezo_hysteresis.arrays import FloatArray

VERDICTS = ('better', 'equal', 'worse', 'as stated', 'not as stated', 'nothing to compare')
_EQUAL = 0.05  # relative difference up to which errors are equal
GOOD = 5.0
"""Relative rms error [%] up to which a model matches a measurement "well"."""

_LEGEND_COLUMNS = 6  # names of a legend side by side
_TICKS = 9  # that fit below a picture of one panel

Draw = Callable[[Figure], None]
Builders = Sequence[tuple[Sequence[str], Callable[[bool], Sequence['Exhibit']]]]


@dataclass(frozen=True)
class Exhibit:
    """One figure or table of a paper, reproduced."""

    paper: str  # fujii 2018 to Fang 2019
    name: str  # ``Figure 10``, ``Table 1``
    shows: str  # subject
    stated: str  # statement or numbers of the paper; quotation marks enclose its text
    ours: str  # result here
    draw: Draw  # draws it on a figure
    reason: str = ''  # reason of a difference, or '' if they agree
    numbers: dict[str, float] = field(default_factory=dict)  # the numbers in `ours`, for tests
    deviating: str = ''  # results of methods that are not those of the paper
    compared: Sequence[tuple[float, float]] = ()  # errors printed in the paper
    holds: bool | None = None

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`: how the errors here compare with the printed ones."""
        if not self.compared:
            if self.holds is None:
                return 'nothing to compare'
            return 'as stated' if self.holds else 'not as stated'
        ratios = [here / printed for printed, here in self.compared]
        if max(ratios) < 1.0 - _EQUAL:
            return 'better'
        if max(ratios) <= 1.0 + _EQUAL:
            return 'equal'
        return 'worse'

    @property
    def picture(self) -> str:
        """Name of the file of the picture."""
        key = self.paper.lower().replace(' ', '')
        return f'{key}_{self.name.lower().replace(" ", "_").replace(",", "")}.png'


def save(entry: Exhibit, folder: Path, dpi: int = 100) -> None:
    """Draw `entry` into `folder`."""
    figure = Figure(figsize=(7.5, 3.5), layout='constrained')
    entry.draw(figure)
    _spare_ticks(figure)
    _add_legend(figure)
    figure.suptitle(f'{entry.paper}, {entry.name}: {entry.shows}', fontsize=10)
    figure.savefig(folder / entry.picture, dpi=dpi)


def _add_legend(figure: Figure) -> None:
    """Place one legend below all panels, or one in each if the same line has several names."""
    shown = [axes for axes in figure.axes if axes.get_legend_handles_labels()[1]]
    lines = {
        label: handle
        for axes in shown
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    if len(lines) < 2:
        return
    looks = {
        (line.get_color(), line.get_linestyle(), line.get_marker())
        for line in lines.values()
        if isinstance(line, Line2D)
    }
    if len(looks) == len(lines):
        figure.legend(
            lines.values(),
            lines.keys(),
            loc='outside lower center',
            ncols=min(len(lines), _LEGEND_COLUMNS),
            fontsize=8,
            frameon=False,
        )
        return
    for axes in shown:
        axes.legend(fontsize=7)


def _spare_ticks(figure: Figure) -> None:
    """Limit the number of ticks of panels to their width."""
    columns = max(len({round(each.get_position().x0, 2) for each in figure.axes}), 1)
    for axes in figure.axes:
        if isinstance(axes.xaxis.get_major_locator(), AutoLocator):
            axes.xaxis.set_major_locator(MaxNLocator(max(_TICKS // columns, 2)))


def panels(figure: Figure, count: int) -> list[Axes]:
    """Return axes side by side, in two rows where there are many; the figure grows with them."""
    rows = 1 if count <= 4 else 2
    figure.set_size_inches(9, 4.2 if rows == 1 else 6.4)
    axes = figure.subplots(rows, -(-count // rows), squeeze=False)
    return list(axes.flat)[:count]


def loop(
    axis: Axes, voltage: FloatArray, displacement: FloatArray, label: str, style: str = '-'
) -> None:
    """Draw a hysteresis loop in micrometres."""
    axis.plot(voltage, displacement * 1e6, style, label=label, lw=1.0)
    axis.set(xlabel='input [V]', ylabel='displacement [µm]')
    axis.grid(alpha=0.3)


def finish(axis: Axes, x: str, y: str, title: str = '') -> None:
    """Label an axis and draw its grid."""
    axis.set(xlabel=x, ylabel=y, title=title)
    axis.grid(alpha=0.3)
