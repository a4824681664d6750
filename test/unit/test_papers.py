"""The figures of the papers, shortened: what the papers state of them holds here too."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from studies.papers import (
    fang2019,
    flap,
    fujii2018,
    stack,
    stage,
    tatebatake2017,
    xiao2014,
    zhou2021,
)
from studies.papers.bimorph import Length
from studies.papers.exhibits import Exhibit, save
from studies.papers.pages import PAPERS, one_paper, paper_page, write_pages
from studies.papers.script import main

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.slow

SHORT = Length(20.0, 8.0, 5.0, (1.0, 10.0, 14.0, 22.0, 23.0))


def numbers(entry: Exhibit) -> dict[str, float]:
    return entry.numbers


def test_odd_harmonics_stand_out_at_14_and_23_hz_only() -> None:
    shares = numbers(fujii2018.figure_6())
    assert shares['23'] > 0.3
    assert shares['14'] > 0.05
    assert max(shares['1'], shares['15']) < 0.04


def test_resonance_and_the_turn_of_the_polarity() -> None:
    assert 67 <= numbers(fujii2018.figure_7())['peak'] <= 71
    phases = numbers(fujii2018.figure_15())
    assert phases['66'] > -90 > phases['69']


def test_the_enhanced_model_mends_what_the_extended_one_misses() -> None:
    errors = numbers(fujii2018.figure_10(SHORT))
    assert errors['extended 23'] > 10 * errors['enhanced 23']
    assert errors['extended 14'] > 1.8 * errors['enhanced 14']


def test_the_tracking_error_at_23_hz_is_the_third_harmonic_and_is_attenuated() -> None:
    spectrum, time = fujii2018.figure_13_17(SHORT)
    assert numbers(spectrum)['third'] > 5 * numbers(spectrum)['rest']
    assert numbers(spectrum)['extended'] > 3 * numbers(spectrum)['rest']
    errors = numbers(time)
    assert errors['proposed'] < 0.2 * errors['extended']


def test_extended_model_beats_the_basic_one() -> None:
    error, *_ = tatebatake2017.figures_11_12_13(SHORT)
    assert numbers(error)['better'] >= 0.8


def test_the_state_of_the_basic_model_turns_clockwise_and_its_output_the_other_way() -> None:
    shown = {entry.name: entry for entry in tatebatake2017.loop_figures()}
    for name in ('Figure 1', 'Figure 3'):
        assert shown[name].ours.startswith('clockwise')
    for name in ('Figure 2', 'Figure 5'):
        assert shown[name].ours.startswith('counterclockwise')
    assert all(entry.holds is not False for entry in shown.values())


def test_bouc_wen_loops_of_the_stack_do_not_match_as_well_as_the_paper_says() -> None:
    verdicts = {entry.name: entry.verdict for entry in xiao2014.loop_figures()}
    assert verdicts == {
        'Figure 3': 'as stated', 'Figure 4': 'as stated', 'Figure 5': 'as stated',
        'Figure 7': 'not as stated', 'Figure 8': 'not as stated',
    }  # fmt: skip


def test_a_figure_without_a_statement_is_not_called_reproduced() -> None:
    shown = Exhibit('Fang 2019', 'Figure 4', 'loops', 'shown', 'drawn', lambda figure: None)
    assert shown.verdict == 'nothing to compare'
    assert replace(shown, holds=False).verdict == 'not as stated'
    assert replace(shown, compared=[(0.1, 0.103)]).verdict == 'equal'
    assert replace(shown, compared=[(0.1, 0.09), (0.1, 0.2)]).verdict == 'worse'


def test_figures_17_and_18_of_tatebatake_are_open_loop_and_show_the_hysteresis() -> None:
    figures = {entry.name: entry for entry in tatebatake2017.figures_17_22(SHORT)}
    assert all('open loop' in figures[name].shows for name in ('Figure 17', 'Figure 18'))
    opened, closed = figures['Figure 17'].numbers, figures['Figure 20'].numbers
    assert opened['phase'] < -5.0
    assert opened['error'] > 2.0 * closed['error']
    assert figures['Figure 18'].numbers['third'] > 20.0


def test_table_1_of_xiao_is_beaten_with_its_mean_and_its_largest_error() -> None:
    ratios = numbers(xiao2014.stack_table((10.0, 100.0))[0])
    assert ratios['worst selector'] < 0.8
    assert ratios['worst largest'] < 0.8
    assert ratios['worst inverse'] < 0.5


def test_the_controller_of_xiao_meets_its_weights_on_the_identified_plant() -> None:
    assert numbers(xiao2014.step_figure())['gamma'] <= 1.0
    assert stack.transfer().nrmse_percent < 5.0


def test_table_2_of_zhou_comes_out_of_its_two_steps() -> None:
    shares = numbers(zhou2021.table())
    for name in ('alpha', 'beta', 'b'):
        assert shares[name] == pytest.approx(1.0, abs=0.05)


def test_equation_8_and_pid_stay_below_the_errors_of_zhou() -> None:
    nine, _, twelve = zhou2021.control((10.0,), 1.0)
    assert numbers(nine)['inverse'] < 14.0
    assert numbers(twelve)['compound'] < 9.0


def test_the_printed_rule_of_the_sign_fails_at_22_hz() -> None:
    _, time = fujii2018.figure_13_17(SHORT)
    assert numbers(time)['printed 22'] > 20.0


def test_loops_of_zhou_widen_with_the_frequency() -> None:
    (entry,) = zhou2021.loop_figure()
    assert numbers(entry)['60'] > 1.8 * numbers(entry)['1']


def test_figure_12_of_xiao_has_its_slow_pole_and_zero() -> None:
    found = numbers(xiao2014.step_figure())
    assert found['pole'] == pytest.approx(-29.4, abs=2.0)
    assert found['zero'] == pytest.approx(-31.5, abs=2.0)


def test_fang_by_its_own_method_is_below_the_paper_up_to_1_hz_by_every_seed_tried() -> None:
    for seed in (1, 2):
        models = stage.by_fang(seed, 1500), stage.slow_by_fang(seed, 1500)
        _, spec, _, printed = stage.FIGURES[0]
        run = stage.run(spec, 'switched inverse + fuzzy PID', *models)
        assert stage.largest_error(run) < printed


def test_the_page_states_where_fang_is_worse_by_its_own_method() -> None:
    text = (ROOT / 'docs' / 'papers' / 'fang2019.md').read_text()
    part = text[text.index('## Figure 9: 4 µm, 5 Hz') : text.index('## Figure 11: composite')]
    assert part.count('Worse than the paper') == 2
    assert part.count('does not help') == 2
    summary = (ROOT / 'docs' / 'papers.md').read_text()
    row = next(line for line in summary.splitlines() if line.startswith('| Fang 2019 |'))
    assert row.split('|')[4].strip() == 'figure 9, 10'


def test_models_are_found_from_sweeps() -> None:
    _, values = flap.identified()
    assert values['A1'] == pytest.approx(5.5e-6, rel=0.01)
    assert values['damping_ratio'] == pytest.approx(1.265, rel=0.02)


def test_page_and_picture_of_an_entry(tmp_path: Path) -> None:
    entry = fujii2018.figure_5()
    save(entry, tmp_path)
    assert (tmp_path / 'fujii2018_figure_5.png').read_bytes().startswith(b'\x89PNG')
    text = one_paper('Fujii 2018', [entry], 'pictures')
    assert '## Figure 5' in text
    assert 'pictures/fujii2018_figure_5.png' in text
    assert entry.stated in text
    write_pages([entry], tmp_path / 'docs' / 'papers.md')
    assert '(papers/fujii2018.md)' in (tmp_path / 'docs' / 'papers.md').read_text()
    assert '## Figure 5' in (tmp_path / 'docs' / 'papers' / 'fujii2018.md').read_text()


def test_the_page_in_docs_names_every_paper_and_what_differs() -> None:
    overview = (ROOT / 'docs' / 'papers.md').read_text()
    text = ''
    for paper, title in PAPERS.items():
        assert f'(papers/{paper_page(paper)}) | {title} |' in overview
        text += (ROOT / 'docs' / 'papers' / paper_page(paper)).read_text()
        assert f'# {paper}: {title}' in text
    assert text.count('- Paper: ') == text.count('- Here: ') >= 60
    for picture in re.findall(r'\]\((../pictures/papers/[^)]+)\)', text):
        assert (ROOT / 'docs' / 'papers' / picture).is_file()


def test_one_figure_by_the_script(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ['--figure', '6', '--out', str(tmp_path)]
    assert main('Fujii 2018', fujii2018.BUILDERS, words) == 0
    assert 'Fujii 2018 Figure 6: 1 Hz: 3rd' in capsys.readouterr().out
    assert (tmp_path / 'fujii2018_figure_6.png').is_file()
    assert 'Figure 5' not in (tmp_path / 'fujii2018.md').read_text()
    written = json.loads((tmp_path / 'summary.json').read_text())
    assert list(written) == ['Fujii 2018 Figure 6']


def test_a_figure_that_is_not_made_is_refused_with_the_reason(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit, match='2'):
        main('Zhou 2021', zhou2021.BUILDERS, ['--figure', '5'])
    message = capsys.readouterr().err
    assert 'there are figure 3' in message
    assert 'flow chart' in message


def test_every_builder_makes_the_figures_that_it_names() -> None:
    for paper in (fujii2018, tatebatake2017, zhou2021, xiao2014, fang2019):
        for group, build in paper.BUILDERS:
            if group in (('Figure 5',), ('Figure 7',), ('Figure 3',)):
                assert tuple(each.name for each in build(True)) == group
