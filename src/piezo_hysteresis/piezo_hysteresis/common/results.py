"""What every result of the Python interface offers: columns, HTML, a data frame, axes, a report.

Plots and reports live in `piezo_hysteresis.interface.presentation`, which is imported when a
result is drawn: the rooms that compute need no drawing library.
"""

from __future__ import annotations

import html
import importlib
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from piezo_hysteresis.common.wording import Guided, counted
from piezo_hysteresis.errors import PiezoError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

_PRESENTATION = 'piezo_hysteresis.interface.presentation'
_ROWS = 30  # of a table in a notebook


class Tabular(Guided, ABC):
    """A result that is a table: named columns of equal length."""

    @abstractmethod
    def columns(self) -> Mapping[str, Sequence[Any] | NDArray[Any]]:
        """Return the table by column; numbers are in SI units."""

    def to_frame(self) -> Any:
        """Return the table as a ``pandas.DataFrame``.

        Raises
        ------
        PiezoError
            If pandas is not installed.
        """
        try:
            import pandas
        except ImportError:
            raise PiezoError(
                'to_frame needs pandas, which is not installed: run "pip install pandas", or use '
                'columns(), which returns the same table as a dictionary'
            ) from None
        return pandas.DataFrame(dict(self.columns()))

    def _repr_html_(self) -> str:
        columns = self.columns()
        first, point, rest = html.escape(repr(self).partition('\n')[0]).partition('. ')
        head = ''.join(f'<th>{html.escape(name)}</th>' for name in columns)
        rows = list(zip(*columns.values(), strict=True)) if columns else []
        body = ''.join(
            f'<tr>{"".join(f"<td>{_cell(value)}</td>" for value in row)}</tr>'
            for row in rows[:_ROWS]
        )
        if not rows:
            return f'<p><b>{first}{point}</b>{rest}</p>'
        more = f'<p>{counted(len(rows) - _ROWS, "more row")}</p>' if len(rows) > _ROWS else ''
        return (
            f'<p><b>{first}{point}</b>{rest}</p><table><thead><tr>{head}</tr></thead>'
            f'<tbody>{body}</tbody></table>{more}'
        )


class Plottable(Tabular):
    """A result that can be drawn."""

    def plot(self, axes: Axes | None = None, *, record: str = '') -> Axes:
        """Draw the result with matplotlib.

        Parameters
        ----------
        axes : matplotlib.axes.Axes, optional
            Where to draw; new axes by default.
        record : str
            Name of the record that is drawn, for results of several; the worst by default.

        Returns
        -------
        matplotlib.axes.Axes
            With labels; displacements are in µm.

        Raises
        ------
        PiezoError
            If there is no such record.
        """
        drawn: Axes = importlib.import_module(_PRESENTATION).draw(self, axes, record)
        return drawn


class Reportable(Plottable):
    """A result that can be written as a folder with a report."""

    def report(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write ``report.html`` and the files of the command of the same name.

        Parameters
        ----------
        path : str or Path
            Folder of the results; it is created if it does not exist.
        overwrite : bool
            Whether to write into a folder that holds other files or results.

        Returns
        -------
        Path
            The report.

        Raises
        ------
        PiezoError
            If the folder cannot be written, or holds other files and `overwrite` is false.
        """
        importlib.import_module(_PRESENTATION).write(self, str(path), overwrite=overwrite)
        return Path(path) / 'report.html'


def _cell(value: object) -> str:
    if value is None:
        return ''
    return html.escape(f'{value:.4g}' if isinstance(value, float) else str(value))
