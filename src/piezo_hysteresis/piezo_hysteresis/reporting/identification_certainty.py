"""Parameters with their standard deviations and correlations."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, FactorRange, HoverTool, LinearColorMapper
from bokeh.palettes import PuOr11

from piezo_hysteresis.identification.identify import Identification
from piezo_hysteresis.identification.uncertainty import CONDITION_LIMIT, CORRELATION_LIMIT
from piezo_hysteresis.reporting.display_units import shown, with_deviation
from piezo_hysteresis.reporting.page import PageSection, Plot, Table, table
from piezo_hysteresis.reporting.plot_parts import new_axes

_PAIRS = 5  # listed pairs with the strongest correlations
_WRITTEN = 9  # largest number of parameters with numbers in the cells


def parameter_section(found: Identification) -> PageSection:
    """Return the parameters with standard deviations and warnings."""
    text = (
        'Standard deviations are those of the linearised fit with its residual; they do '
        'not cover errors of the model structure.'
    )
    if found.warnings:
        text += '\n\n' + '\n'.join(f'- {warning}' for warning in found.warnings)
    return PageSection('Parameters', text, (), (_parameters(found),))


def _parameters(found: Identification) -> Table:
    rows = []
    for parameter in found.chain.parameters:
        unit, factor = shown(parameter.unit)
        std = found.std.get(parameter.name)
        value, deviation = with_deviation(
            factor * found.values[parameter.name], None if std is None else factor * std
        )
        rows.append((parameter.name, value, deviation, unit, parameter.description))
    headers = ('parameter', 'value', 'standard deviation', 'unit', 'description')
    return table(headers, rows, f'Parameters of {found.chain.name}, by {found.method}.')


def correlation_section(found: Identification) -> PageSection:
    """Return the correlations between the parameters and the condition of the fit."""
    limit = f'{CONDITION_LIMIT:.0e}'.replace('e+0', 'e')
    far = 'below' if found.condition < CONDITION_LIMIT else 'beyond'
    text = (
        f'The condition number of the fit is {found.condition:.2g}, {far} the {limit} from which '
        'on individual parameters are not determined. If the correlation of two parameters '
        f'exceeds ±{CORRELATION_LIMIT}, changes of both can cancel in the free run: '
        'their deviations are then large, and only their combined effect is known.'
    )
    pairs = _strongest(found)
    pairs_table = table(
        ('parameters', 'correlation'), pairs, 'Pairs with the largest correlation.'
    )
    return PageSection('Parameter correlations', text, (_map(found),), (pairs_table,))


def _strongest(found: Identification) -> list[tuple[str, str]]:
    size = len(found.names)
    order = sorted(
        ((i, j) for i in range(size) for j in range(i)),
        key=lambda pair: -abs(float(found.correlation[pair])),
    )
    return [
        (f'{found.names[j]}, {found.names[i]}', f'{found.correlation[i, j]:+.3f}')
        for i, j in order[:_PAIRS]
    ]


def _map(found: Identification) -> Plot:
    names = list(found.names)
    size = len(names)
    matrix = np.asarray(found.correlation, float)
    plot = new_axes(
        'Correlations', '', '',
        x_range=FactorRange(*names), y_range=FactorRange(*reversed(names)),
    )  # fmt: skip
    plot.xaxis.major_label_orientation = 1.1
    plot.grid.grid_line_color = None
    values = [float(matrix[i, j]) for i in range(size) for j in range(size)]
    source = ColumnDataSource(
        {
            'x': [names[j] for _ in range(size) for j in range(size)],
            'y': [names[i] for i in range(size) for _ in range(size)],
            'value': values,
            'words': [f'{value:.2f}'.replace('0.', '.') for value in values],
            'ink': ['#ffffff' if abs(value) > 0.75 else '#000000' for value in values],
        }
    )
    cells = plot.rect(
        'x', 'y', 0.96, 0.96, source=source, line_color=None,
        fill_color={
            'field': 'value',
            'transform': LinearColorMapper(palette=PuOr11, low=-1.0, high=1.0),
        },
    )  # fmt: skip
    if size <= _WRITTEN:
        plot.text(
            'x', 'y', 'words', source=source, text_align='center', text_baseline='middle',
            text_font_size='10px', text_color='ink',
        )  # fmt: skip
    columns = [('pair', '@y, @x'), ('correlation', '@value{0.000}')]
    plot.add_tools(HoverTool(renderers=[cells], tooltips=columns))
    caption = 'Orange: both are too large together. Violet: one too large, the other too small.'
    return Plot(plot, caption)
