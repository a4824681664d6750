"""Pages of the reproduced figures: what the papers state, what comes out here, commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from studies.papers.exhibits import GOOD, VERDICTS, Exhibit, save

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
    'sweeps of the simulated actuator, as in the papers, and not fitted to published figures.',
    'The hysteresis of two presets is: that of the bimorph is designed for the spectra of Fujii',
    '2018, figures 5 and 6, that of the stack for table 1 of Xiao 2014. These figures confirm the',
    'preset only. A smaller error on a simulated actuator does not prove one on a real one.',
    '',
    '`python studies/papers/write_pages.py --page docs/papers.md` writes these pages in a few',
    'minutes; `python studies/papers/fujii2018.py --figure 16` makes one figure.',
    '[equations.md](equations.md) lists the code of each equation.',
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
        'Table 2: its rules are missing; this project uses a file, `feedback.fuzzy.tables`.',
    ),
}

# What the figures of a paper do not say.
REMARKS: dict[str, tuple[str, ...]] = {
    'Fujii 2018': (
        (
            'Figures 5 and 6: the hysteresis of the preset was designed for these spectra; '
            'they are no result of a method.'
        ),
        (
            'Figure 7 is measured with 0.02 V, at which the hysteresis is small; the paper '
            'prints no voltage.'
        ),
        (
            'Figures 10 and 11: errors of the last fifth of the record (20 of 100 s), after '
            'RLS has settled.'
        ),
        (
            'Order of the harmonic: the paper sets it from experience, 5 at 14 Hz and 3 from '
            '18 to 28 Hz, and so do the figures. `identify --per-frequency` finds it in the '
            'record: 5 at 14 Hz, 3 from 19 to 25 Hz, where the harmonic exceeds 5 % of the '
            'fundamental.'
        ),
        (
            'Figure 15: at 69 Hz the linear mode of the preset moves by millimetres, more '
            'than a bimorph can; only the phase compares.'
        ),
        (
            'ZV input shaping and the odd harmonic repetitive controller have no figure in '
            'the paper and none here. Cancellation of odd orders (`attenuation.orders=[1,3,5]`) '
            'contains '
            'the same model of the disturbance at these orders as the latter.'
        ),
    ),
    'Tatebatake 2017': (
        ('Figures 14 to 16: 40 s of control, the last 20 s evaluated; the paper uses 100 s.'),
        (
            'Figures 11 and 14 compare two models and one estimator, and the estimator '
            'decides at most frequencies. At 10 Hz RLS leaves 12 µm with the basic and 2.5 µm'
            ' with the extended model (20 s), output error 0.77 µm and 0.21 µm: the basic '
            'model by output error is better than the extended one by RLS. At 23 Hz the '
            'structure decides: output error leaves 29 µm with the basic and 0.33 µm with the'
            ' extended model.'
        ),
        (
            'The numbers of parameters, 4 against 20 or 5050 of other models, and the low '
            'computation cost are statements on models that are not built here; nothing is '
            'compared.'
        ),
    ),
    'Fang 2019': (
        (
            'Classical model: the paper prints k1c 1.86, k3c -0.75, alpha 1.14, beta 2.49, '
            'gamma -2.08; its swarm finds beta 2.06 ± 15 and gamma 0.31 ± 26 here. The record '
            'does not determine them, so that equal errors go with any of these values.'
        ),
        (
            '(9), figure 4 and table 1: the "asymmetric sinusoidal voltage signals" of the '
            'paper are missing from its text; sines of 4.8 V about a bias of 4.9 V are used, '
            'which lie on one side of zero.'
        ),
    ),
}


class Command(NamedTuple):
    """One command."""

    words: str  # ``piezo_sim`` is a program of its own; everything else is a verb of ``piezo``
    figures: str = ''  # figures and tables that it contributes to, or ''
    outcome: str = ''  # expected result in the form of test/docs/expectations.py, or ''


_BIMORPH = '--plant preset:fdk_pzba_00030'
_BIMORPH_SWEEP = 'piezo_sim sweep --preset fdk_pzba_00030 --seconds 100'
_STACK = (
    '--plant preset:xiao_pi_stack --plant-set amplifier.range_low=-30 amplifier.range_high=130 '
    '--set feedforward.law=xiao2014 attenuation.enabled=false'
)
_STAGE = (
    'compensate --model fang_slow/model.yaml --plant preset:fang_p845_stage --set '
    'feedforward.law=fang2019 attenuation.enabled=false feedback.method=fuzzy_pid '
    'feedback.pid.proportional=1.43e5 feedback.pid.integral=1.43e8 feedback.pid.derivative=120 '
    'feedback.fuzzy.error_scale=1e-7 feedback.fuzzy.rate_scale=2e-5 '
    'feedback.fuzzy.proportional_range=7.1e4 feedback.fuzzy.integral_range=7.1e7'
)
_STAGE_SWEEP = (
    'piezo_sim sweep --preset fang_p845_stage --amplitudes 4.8 --options '
    'offset=4.9 --seconds 8 --warm-up 4'
)

COMMANDS: dict[str, tuple[Command, ...]] = {
    'Fujii 2018': (
        Command(f'{_BIMORPH_SWEEP} --frequencies 23 --out b23'),
        Command('identify b23 --method fujii2018 --model extended --warm-up 80 --out extended',
                'figures 10, 11'),
        Command('identify b23 --method fujii2018 --model enhanced3 --warm-up 80 --out enhanced',
                'figures 10, 11', 'enhanced/summary.json records[0].free_run_rms_m < 2e-6'),
        Command(f'compensate --model enhanced/model.yaml {_BIMORPH} --low -5 --high 5 --set '
                'feedforward.law=fujii2018 attenuation.method=rls attenuation.orders=[3] '
                'attenuation.forgetting=1 attenuation.sign_rule=printed --reference '
                'sine:frequency=23,amplitude=143e-6,duration=40,ramp=1 --from-seconds 20 --out '
                'tracked', 'figures 16, 17',
                'tracked/summary.json runs[2].rms_without_mean_m < 5e-6'),
    ),
    'Tatebatake 2017': (
        Command(f'{_BIMORPH_SWEEP} --frequencies 10 --out b10'),
        Command('identify b10 --method rls --model classical --out basic', 'figure 11'),
        Command('identify b10 --method rls --model extended --out extended', 'figure 11',
                'extended/summary.json records[0].free_run_rms_m < 3e-6'),
        Command(f'compensate --model extended/model.yaml {_BIMORPH} --set '
                'feedforward.law=tatebatake2017 attenuation.enabled=false --reference '
                'sine:frequency=10,amplitude=120e-6,duration=40,ramp=1 --from-seconds 20 --out '
                'tracked', 'figures 14, 20',
                'tracked/summary.json runs[1].rms_without_mean_m < 4e-6'),
    ),
    'Zhou 2021': (
        Command('piezo_sim sweep --preset zhou_tef --frequencies 1,30 --seconds 4 --out flap'),
        Command('identify flap --method zhou2021 --model second_order --hold A1=5.5e-6 '
                'stiffness=8e5 mass=0.05138 --out zhou', 'table 2, figures 6, 7',
                'zhou/summary.json records[1].free_run_rms_m < 1e-6'),
        Command('compensate --model zhou/model.yaml --plant preset:zhou_tef --set '
                'feedforward.law=zhou2021 attenuation.enabled=false feedback.method=pid '
                'feedback.pid.proportional=1e5 feedback.pid.integral=5e7 --reference '
                'sine:frequency=10,amplitude=200e-6,duration=4,ramp=0.3 --out tracked',
                'figures 9, 11, 12', 'tracked/summary.json runs[2].largest_m < 9e-6'),
    ),
    'Xiao 2014': (
        Command('piezo_sim sweep --preset xiao_pi_stack --waveform triangle --frequencies '
                '10,40,100 --seconds 1 --out stack'),
        Command('identify stack --method xiao2014 --model inverse_selector --out xiao'),
        Command(f'compensate --model xiao/model.yaml {_STACK} --reference '
                'triangle:frequency=40,amplitude=15e-6,duration=2 --from-seconds 1.2 --out '
                'tracked', 'table 1, figure 15', 'tracked/summary.json runs[1].rms_m < 1.895e-6'),
        Command('piezo_sim sweep --preset xiao_pi_stack --waveform step --amplitudes 2 --options '
                'offset=0,delay=0.005 --seconds 0.6 --warm-up 0 --out step'),
        Command('linear step --method arx --out linear.yaml', 'figure 12',
                'linear.yaml nrmse_percent < 5.0'),
        Command(f'compensate --model xiao/model.yaml {_STACK} feedback.method=h_infinity '
                'feedback.h_infinity.bandwidth=150 feedback.h_infinity.peak=2 '
                'feedback.h_infinity.control=0.3 --transfer-function linear.yaml '
                '--reference composite_xiao2014:amplitude=12e-6,duration=1.5,ramp=0.3 '
                '--from-seconds 0.75 --out closed', 'figure 19',
                'closed/summary.json runs[2].largest_m < 1e-6'),
    ),
    'Fang 2019': (
        Command(f'{_STAGE_SWEEP} --frequencies 0.5,1,5,10 --out stage'),
        Command(f'{_STAGE_SWEEP} --frequencies 0.5,1 --out slow'),
        Command('identify stage --method fang2019 --model rate_dependent --max-evaluations 6000 '
                '--out fang', 'figure 4, table 1',
                'fang/summary.json records[0].nrmse_percent < 5.0'),
        Command('identify slow --method fang2019 --model classical --out fang_slow'),
        Command(f'{_STAGE} --reference sine:frequency=1,amplitude=6e-6,duration=12,ramp=1 '
                '--from-seconds 6 --out tracked', 'figure 8',
                'tracked/summary.json runs[2].largest_m < 0.045e-6'),
    ),
}  # fmt: skip
"""Commands of each paper, to be run one after another in one folder."""


def overview(entries: Sequence[Exhibit], folder: str) -> str:
    """Return the page that lists the papers and leads to their pages in `folder`."""
    lines = [*_HEAD, *summary(entries), '| Paper | Actuator and method |', '|---|---|']
    lines += [
        f'| [{paper}]({folder}/{paper_page(paper)}) | {PAPERS[paper]} |'
        for paper in _papers_of(entries)
    ]
    return '\n'.join([*lines, ''])


def one_paper(
    paper: str, entries: Sequence[Exhibit], pictures: str, others: Sequence[str] = ()
) -> str:
    """Return the page of one paper; `pictures` is the path from it to their folder.

    `others` are the lines of a section on other actuators.
    """
    lines = [
        f'# {paper}: {PAPERS[paper]}',
        '',
        '[All papers, method and verdicts](../papers.md)',
        '',
    ]
    return '\n'.join([*lines, *_exhibits(paper, entries, pictures, others)])


def paper_page(paper: str) -> str:
    """Return the file name of the page of a paper."""
    return f'{paper.lower().replace(" ", "")}.md'


def write_pages(
    entries: Sequence[Exhibit], file: Path, others: Mapping[str, Sequence[str]] | None = None
) -> None:
    """Write the overview to `file`, and pages and pictures of the papers into its folder.

    `others` are the sections on other actuators, by paper.
    """
    pictures, folder = file.parent / 'pictures' / 'papers', file.parent / file.stem
    for each in (pictures, folder):
        each.mkdir(parents=True, exist_ok=True)
    for entry in entries:
        save(entry, pictures, dpi=75)
    for paper in _papers_of(entries):
        text = one_paper(paper, entries, '../pictures/papers', (others or {}).get(paper, ()))
        (folder / paper_page(paper)).write_text(text, encoding='utf-8')
    file.write_text(overview(entries, folder.name), encoding='utf-8')


def _papers_of(entries: Sequence[Exhibit]) -> list[str]:
    return [paper for paper in PAPERS if any(entry.paper == paper for entry in entries)]


def _exhibits(
    paper: str, entries: Sequence[Exhibit], pictures: str, others: Sequence[str]
) -> list[str]:
    lines = []
    own = [entry for entry in entries if entry.paper == paper]
    for entry in own:
        lines += [f'## {entry.name}: {entry.shows}', '']
        lines += [f'![{entry.name}]({pictures}/{entry.picture})', '']
        lines += [f'- Paper: {entry.stated}', f'- Here: {entry.ours}']
        if entry.deviating:
            lines.append(f'- With other methods: {entry.deviating}')
        if entry.reason:
            lines.append(f'- Reason for the difference: {entry.reason}')
        lines.append('')
    if len(own) > 1:
        lines += by_verbs(paper)
    if others:
        lines += ['## Other actuators', '', *others, '']
    if REMARKS.get(paper):
        lines += ['## Remarks', '', *(f'- {each}' for each in REMARKS[paper]), '']
    if MISSING.get(paper):
        lines += ['## Not reproduced', '', *(f'- {each}' for each in MISSING[paper]), '']
    return lines


def by_verbs(paper: str) -> list[str]:
    """Return the lines with the commands for the main figures of a paper."""
    lines = ['## Commands', '', '```bash']
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
