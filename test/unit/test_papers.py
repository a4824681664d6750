"""A short part of `studies/papers.py`: what the papers say of their figures holds here too."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from studies import (  # noqa: E402
    closed_loops,
    compensation_plants,
    papers_fujii,
    papers_loops,
    papers_stacks,
    papers_tatebatake,
    papers_xiao,
)
from studies.papers_bimorph import QUICK, Length  # noqa: E402
from studies.papers_page import PAPERS, Entry, page, save  # noqa: E402

pytestmark = pytest.mark.slow

SHORT = Length(20.0, 8.0, 5.0, (1.0, 10.0, 14.0, 22.0, 23.0))


def numbers(entry: Entry) -> dict[str, float]:
    return entry.numbers


def test_odd_harmonics_stand_out_at_14_and_23_hz_only() -> None:
    shares = numbers(papers_fujii.figure_6())
    assert shares['23'] > 0.3
    assert shares['14'] > 0.05
    assert max(shares['1'], shares['15']) < 0.04


def test_resonance_and_the_turn_of_the_polarity() -> None:
    assert 67 <= numbers(papers_fujii.figure_7())['peak'] <= 71
    phases = numbers(papers_fujii.figure_15())
    assert phases['66'] > -90 > phases['69']


def test_the_enhanced_model_mends_what_the_extended_one_misses() -> None:
    errors = numbers(papers_fujii.figure_10(SHORT))
    assert errors['extended 23'] > 10 * errors['enhanced 23']
    assert errors['extended 14'] > 1.8 * errors['enhanced 14']


def test_the_tracking_error_at_23_hz_is_the_third_harmonic_and_is_attenuated() -> None:
    spectrum, time = papers_fujii.figure_13_17(SHORT)
    assert numbers(spectrum)['third'] > 2 * numbers(spectrum)['rest']
    errors = numbers(time)
    assert errors['proposed'] < 0.2 * errors['extended']


def test_extended_model_beats_the_basic_one() -> None:
    error, *_ = papers_tatebatake.figures_11_12_13(SHORT)
    assert numbers(error)['better'] >= 0.8


def test_figures_17_and_18_of_tatebatake_are_open_loop_and_show_the_hysteresis() -> None:
    figures = {entry.name: entry for entry in papers_tatebatake.figures_17_22(SHORT)}
    assert all('open loop' in figures[name].shows for name in ('Figure 17', 'Figure 18'))
    opened, closed = figures['Figure 17'].numbers, figures['Figure 20'].numbers
    assert opened['phase'] < -5.0
    assert opened['error'] > 2.0 * closed['error']
    assert figures['Figure 18'].numbers['third'] > 20.0


def test_table_1_of_xiao_is_beaten_with_its_mean_and_its_largest_error() -> None:
    ratios = numbers(papers_xiao.stack_table((10.0, 100.0))[0])
    assert ratios['worst selector'] < 0.8
    assert ratios['worst largest'] < 0.8
    assert ratios['worst inverse'] < 0.5


def test_the_controller_of_xiao_meets_its_weights_on_the_identified_plant() -> None:
    assert numbers(papers_xiao.step_figure())['gamma'] <= 1.0
    assert compensation_plants.stack_plant().nrmse_percent < 5.0


def test_table_2_of_zhou_comes_out_of_its_two_steps() -> None:
    shares = numbers(papers_stacks.flap_table())
    for name in ('alpha', 'beta', 'b'):
        assert shares[name] == pytest.approx(1.0, abs=0.05)


def test_equation_8_and_pid_stay_below_the_errors_of_zhou() -> None:
    nine, _, twelve = papers_stacks.flap_control((10.0,), 1.0)
    assert numbers(nine)['inverse'] < 14.0
    assert numbers(twelve)['compound'] < 9.0


def test_the_printed_rule_of_the_sign_fails_at_22_hz() -> None:
    _, time = papers_fujii.figure_13_17(SHORT)
    assert numbers(time)['printed 22'] > 20.0


def test_loops_of_zhou_widen_with_the_frequency() -> None:
    (entry,) = papers_loops.flap_loops()
    assert numbers(entry)['60'] > 1.8 * numbers(entry)['1']


def test_fang_is_beaten_at_5_hz() -> None:
    (entry,) = papers_stacks.stage_figures(('4 um, 5 Hz',))
    assert numbers(entry)['compound'] < numbers(entry)['paper']
    assert numbers(entry)['PID'] > 5 * numbers(entry)['compound']


def test_models_are_found_from_sweeps() -> None:
    _, values = closed_loops.flap_model()
    assert values['A1'] == pytest.approx(5.5e-6, rel=0.01)
    assert values['damping_ratio'] == pytest.approx(1.265, rel=0.02)


def test_page_and_picture_of_an_entry(tmp_path: Path) -> None:
    entry = papers_fujii.figure_5()
    save(entry, tmp_path)
    assert (tmp_path / 'fujii2018_figure_5.png').read_bytes().startswith(b'\x89PNG')
    text = page([entry], 'pictures')
    assert '### Figure 5' in text
    assert 'pictures/fujii2018_figure_5.png' in text
    assert entry.said in text


def test_the_page_in_docs_names_every_paper_and_what_differs() -> None:
    text = (ROOT / 'docs' / 'papers.md').read_text()
    for paper, title in PAPERS.items():
        assert f'## {paper}: {title}' in text
    assert text.count('- Paper: ') == text.count('- Here: ') >= 60
    for picture in re.findall(r'\]\((pictures/papers/[^)]+)\)', text):
        assert (ROOT / 'docs' / picture).is_file()


def test_the_script_explains_itself() -> None:
    answer = subprocess.run(
        [sys.executable, str(ROOT / 'studies' / 'papers.py'), '--help'],
        capture_output=True,
        text=True,
        check=False,
    )
    assert answer.returncode == 0
    assert '--quick' in answer.stdout
    assert QUICK.track < 20
