"""Reproduced figures of the papers, their drawing, and the pages that show them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import AutoLocator, MaxNLocator

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.papers.commands import COMMANDS

PAPERS = {
    'Fujii 2018': 'Fujii, Tatebatake, Morita, Shiinoki 2018 (bimorph, odd harmonic oscillation)',
    'Tatebatake 2017': 'Tatebatake and Fujii 2017 (bimorph, extended model)',
    'Zhou 2021': 'Zhou, Dong and Yang 2021 (actuator of a rotor flap)',
    'Xiao 2014': 'Xiao and Li 2014 (stack, inverse Bouc-Wen)',
    'Fang 2019': 'Fang, Li, Zhong and Long 2019 (stage, fuzzy PID)',
}

_HEAD = (
    '# Reproduction of five papers',
    '',
    'Each figure and table of five papers is reproduced and compared in the error metric of the',
    'paper. "Here" is the method of the paper on a simulated actuator; results of other methods',
    'of this project are listed separately. The actuators are the presets of `piezo_sim`; a',
    'preset states what is assumed where a paper gives no value. Models are identified from',
    'sweeps of the simulated actuator, as in the papers; no parameter is fitted to a published',
    'figure. A smaller error on a simulated actuator does not prove a smaller one on a real one.',
    '',
    '`piezo paper all --page docs/papers.md` writes these pages in a few minutes; `piezo paper',
    'fujii2018 --figure 16` makes one figure. [equations.md](equations.md) lists the code of each',
    'equation.',
    '',
)

# Figures and tables that are not reproduced, and why.
MISSING: dict[str, tuple[str, ...]] = {
    'Fujii 2018': ('Figures 1, 9, 12, 14: photograph and block diagrams.',),
    'Tatebatake 2017': ('Figures 4, 9, 10: block diagrams.',),
    'Zhou 2021': (
        'Figures 1, 2, 4, 8, 10: photographs and block diagrams.',
        'Figure 5: flow chart of the swarm; it is `identify --method zhou2021`.',
        'Table 1: data of the actuator; they are the preset.',
    ),
    'Xiao 2014': ('Figures 1, 2, 6, 9, 10, 11, 13: photographs and block diagrams.',),
    'Fang 2019': (
        'Figures 1, 2, 5, 6: drawings and block diagrams.',
        'The guide, 47.52 N/um: `python -m piezo_sim stage --preset fang_p845_stage`, 47.53 N/um.',
        'Table 2: its rules are missing; this project uses a file, `compensate --fuzzy-tables`.',
    ),
}

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
    """One figure or table of a paper, reproduced.

    Attributes
    ----------
    paper : str
        Fujii 2018 to Fang 2019.
    name : str
        ``Figure 10``, ``Table 1``.
    shows : str
        Subject.
    stated : str
        Statement or numbers of the paper; quotation marks enclose its text.
    ours : str
        Result here.
    reason : str
        Reason of a difference, or '' if they agree.
    draw : callable
        Draws it on a figure.
    numbers : dict of str to float
        The numbers in `ours`, for tests.
    deviating : str
        Results of methods that are not those of the paper, or '' if there are none.
    compared : sequence of tuple of float
        Errors printed in the paper, each with the one obtained here by its method.
    holds : bool, optional
        Whether a statement of the paper without a printed error holds here; by default the paper
        states nothing that can be compared.
    """

    paper: str
    name: str
    shows: str
    stated: str
    ours: str
    draw: Draw
    reason: str = ''
    numbers: dict[str, float] = field(default_factory=dict)
    deviating: str = ''
    compared: Sequence[tuple[float, float]] = ()
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


def page(entries: Sequence[Exhibit], pictures: str = '') -> str:
    """Return one page of all entries, Markdown; with `pictures`, a path to their folder, shown."""
    lines = [*_HEAD, *summary(entries)]
    for paper in _papers_of(entries):
        lines += [f'## {paper}: {PAPERS[paper]}', '', *_exhibits(paper, entries, pictures, '###')]
    return '\n'.join(lines)


def overview(entries: Sequence[Exhibit], folder: str) -> str:
    """Return the page that lists the papers and leads to their pages in `folder`."""
    lines = [*_HEAD, *summary(entries), '| Paper | Actuator and method |', '|---|---|']
    lines += [
        f'| [{paper}]({folder}/{paper_page(paper)}) | {PAPERS[paper]} |'
        for paper in _papers_of(entries)
    ]
    return '\n'.join([*lines, ''])


def one_paper(paper: str, entries: Sequence[Exhibit], pictures: str) -> str:
    """Return the page of one paper; `pictures` is the path from it to their folder."""
    lines = [
        f'# {paper}: {PAPERS[paper]}',
        '',
        '[All papers, method and verdicts](../papers.md)',
        '',
    ]
    return '\n'.join([*lines, *_exhibits(paper, entries, pictures, '##')])


def paper_page(paper: str) -> str:
    """Return the file name of the page of a paper."""
    return f'{paper.lower().replace(" ", "")}.md'


def write_pages(entries: Sequence[Exhibit], file: Path) -> None:
    """Write the overview to `file`, and pages and pictures of the papers into its folder."""
    pictures, folder = file.parent / 'pictures' / 'papers', file.parent / file.stem
    for each in (pictures, folder):
        each.mkdir(parents=True, exist_ok=True)
    for entry in entries:
        save(entry, pictures, dpi=75)
    for paper in _papers_of(entries):
        text = one_paper(paper, entries, '../pictures/papers')
        (folder / paper_page(paper)).write_text(text, encoding='utf-8')
    file.write_text(overview(entries, folder.name), encoding='utf-8')


def _papers_of(entries: Sequence[Exhibit]) -> list[str]:
    return [paper for paper in PAPERS if any(entry.paper == paper for entry in entries)]


def _exhibits(paper: str, entries: Sequence[Exhibit], pictures: str, heading: str) -> list[str]:
    lines = []
    own = [entry for entry in entries if entry.paper == paper]
    for entry in own:
        lines += [f'{heading} {entry.name}: {entry.shows}', '']
        if pictures:
            lines += [f'![{entry.name}]({pictures}/{entry.picture})', '']
        lines += [f'- Paper: {entry.stated}', f'- Here: {entry.ours}']
        if entry.deviating:
            lines.append(f'- With other methods: {entry.deviating}')
        if entry.reason:
            lines.append(f'- Reason for the difference: {entry.reason}')
        lines.append('')
    if len(own) > 1:
        lines += by_verbs(paper, heading)
    if MISSING.get(paper):
        lines += [f'{heading} Not reproduced', '', *(f'- {each}' for each in MISSING[paper]), '']
    return lines


def by_verbs(paper: str, heading: str) -> list[str]:
    """Return the lines with the commands for the main figures of a paper."""
    lines = [f'{heading} Commands', '', '```bash']
    for each in COMMANDS[paper]:
        program = 'python -m' if each.words.startswith('piezo_sim') else 'piezo'
        lines.append(f'{program} {each.words}' + (f'  # {each.figures}' if each.figures else ''))
    outcomes = [each.outcome for each in COMMANDS[paper] if each.outcome]
    return [*lines, '```', '<!-- expect:', '\n'.join(outcomes) + ' -->', '']


def summary(entries: Sequence[Exhibit]) -> list[str]:
    """Return the lines of a table: figures by paper and verdict."""
    lines = [
        '"Better", "equal" (within 5 %) and "worse" compare the printed errors with those of the',
        'same method here, by the largest ratio, or by the median over seeds. Without a printed',
        'number, "as stated" means that the statement of the paper on the figure holds here, and',
        f'a good match that the rms error is below {GOOD:g} % of the displacement. "Nothing to',
        'compare": the paper shows the figure without a statement, or for a reference that it',
        'does not print. Quotation marks enclose text of the paper.',
        '"Better" has little weight if the simulated actuator has the structure of the model',
        '(Zhou 2021) or parameters that are not printed; each figure states the assumptions.',
        '',
        f'| Paper | {" | ".join(VERDICTS)} |',
        f'|---|{"---|" * len(VERDICTS)}',
    ]
    for paper in PAPERS:
        own = [entry for entry in entries if entry.paper == paper]
        cells = [_numbers([e.name for e in own if e.verdict == verdict]) for verdict in VERDICTS]
        if own:
            lines.append(f'| {paper} | {" | ".join(cells)} |')
    return [*lines, '']


def _numbers(names: Sequence[str]) -> str:
    """Return names of figures and tables, shortened."""
    figures = [name.removeprefix('Figure ') for name in names if name.startswith('Figure')]
    tables = [name.lower() for name in names if not name.startswith('Figure')]
    return ', '.join([*(['figure ' + ', '.join(figures)] if figures else []), *tables])


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
