"""The flexure guide of Fang et al.: from dimensions to stiffness, verb and preset."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from piezo_sim import load_preset
from piezo_sim.cli import main
from piezo_sim.flexure import Flexure, FlexureError
from piezo_sim.presets import read_preset
from piezo_sim.simulation_errors import PresetError

STAGE = Flexure(72e9, 14e-3, 3e-3, 3.5e-3, 10e-3)


def test_the_printed_stiffness_is_that_of_the_printed_dimensions() -> None:
    """47.52 N/um is printed; the modulus that the text gives makes 1.4 % less of it."""
    assert STAGE.stiffness == pytest.approx(47.52e6, rel=3e-4)
    assert STAGE.hinge_stiffness == pytest.approx(594.0, rel=3e-4)
    assert Flexure(71e9, 14e-3, 3e-3, 3.5e-3, 10e-3).stiffness == pytest.approx(46.87e6, rel=1e-4)


def test_the_work_of_the_force_is_the_energy_of_the_hinges() -> None:
    moved = 6e-6
    assert STAGE.angle(moved) == pytest.approx(6e-4)
    assert STAGE.energy(moved) == pytest.approx(0.5 * STAGE.stiffness * moved**2)
    assert STAGE.left(STAGE.stiffness) == pytest.approx(0.5)
    mass = (1e8 + STAGE.stiffness) / (2 * math.pi * 100.0) ** 2
    assert STAGE.natural_frequency(1e8, mass) == pytest.approx(100.0)


@pytest.mark.parametrize('thickness', [3e-3, 0.5e-3, 1e-4])
def test_exact_bending_is_the_integral_over_the_hinge(thickness: float) -> None:
    hinge = Flexure(72e9, 14e-3, thickness, 3.5e-3, 10e-3)
    x = np.linspace(-3.5e-3, 3.5e-3, 400_001)
    height = thickness + 2 * 3.5e-3 - 2 * np.sqrt(3.5e-3**2 - x**2)
    turned = np.trapezoid(12 / (72e9 * 14e-3 * height**3), x)
    assert hinge.exact_hinge_stiffness == pytest.approx(1 / turned, rel=1e-6)


def test_the_printed_formula_is_that_of_thin_hinges() -> None:
    ratios = []
    for thickness in (3e-3, 0.5e-3, 5e-5):
        hinge = Flexure(72e9, 14e-3, thickness, 3.5e-3, 10e-3)
        ratios.append(hinge.exact_hinge_stiffness / hinge.hinge_stiffness)
    assert ratios[0] > ratios[1] > ratios[2] > 1.0
    assert ratios[2] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    'wrong', [{'thickness': 0.0}, {'radius': -1.0}, {'modulus': math.nan}, {'hinges': 0}]
)
def test_impossible_dimensions_are_named(wrong: dict[str, Any]) -> None:
    given = {
        'modulus': 72e9, 'depth': 0.01, 'thickness': 1e-3, 'radius': 3e-3, 'link': 0.01, **wrong,
    }  # fmt: skip
    with pytest.raises(FlexureError, match=next(iter(wrong)).removesuffix('s')):
        Flexure(**given)


# --- preset and verb ----------------------------------------------------------------------------


def test_the_preset_is_made_by_it() -> None:
    preset = load_preset('fang_p845_stage')
    assert preset.flexure == STAGE
    values = preset.values()
    assert values['structure.load_stiffness'] == STAGE.stiffness
    free, loaded = values['actuator.gain'], 1.86e-6
    assert free * STAGE.left(values['structure.stiffness']) == pytest.approx(loaded)


def preset_with(tmp_path: Path, **change: dict[Any, Any]) -> Path:
    content = {
        'flexure': {
            'modulus': 72e9, 'depth': 14e-3, 'thickness': 3e-3, 'radius': 3.5e-3, 'link': 0.01,
            'loaded_gain': 1e-6,
        },
        'parameters': {'structure.stiffness': 1e8},
    }  # fmt: skip
    for key, value in change.items():
        if isinstance(value, dict):
            content[key] = {**content[key], **value}
        else:
            content[key] = value
    (tmp_path / 'mine.yaml').write_text(yaml.safe_dump(content))
    return tmp_path / 'mine.yaml'


def test_a_preset_takes_its_own_dimensions(tmp_path: Path) -> None:
    found = read_preset(preset_with(tmp_path, flexure={'hinges': 4}))
    assert found.parameters['structure.load_stiffness'] == pytest.approx(STAGE.stiffness / 2)


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        ({'flexure': 3}, 'flexure is a mapping'),
        ({'flexure': {'colour': 1}}, 'does not know colour'),
        ({'flexure': {'depth': 'x'}}, 'flexure depth is not a number'),
        ({'flexure': {'depth': -1}}, 'depth of the flexure must be positive'),
        ({'parameters': {'actuator.gain': 1e-6}}, 'actuator.gain follows from the flexure'),
        ({'parameters': {}}, None),
    ],
)
def test_errors_in_a_preset_are_reported(
    change: dict[str, Any], says: str | None, tmp_path: Path
) -> None:
    path = preset_with(tmp_path, **change)
    if says is None:
        content = yaml.safe_load(path.read_text())
        content['parameters'] = {}
        path.write_text(yaml.safe_dump(content))
        says = 'loaded_gain takes structure.stiffness'
    with pytest.raises(PresetError, match=says):
        read_preset(path)


def test_the_verb_prints_the_design_and_the_lines_of_a_preset(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(['stage', '--preset', 'fang_p845_stage', '--stroke', '6e-6']) == 0
    printed = capsys.readouterr().out
    assert '47.529 N/um' in printed
    assert '594.11 N m/rad' in printed
    assert 'rotation of a link                    0.6 mrad' in printed
    block = yaml.safe_load(printed[printed.index('flexure:') :])
    (tmp_path / 'mine.yaml').write_text(yaml.safe_dump(block))
    assert read_preset(tmp_path / 'mine.yaml').flexure == STAGE
    assert main(['stage', '--preset', 'fang_p845_stage', '--modulus', '71e9']) == 0
    assert '46.869 N/um' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('words', 'says'),
    [
        ('--modulus 72e9 --depth 0.014', 'give --thickness --radius --link'),
        ('--preset generic_bouc_wen', 'has no flexure'),
        ('--preset fang_p845_stage --mass 0', '--mass must be positive'),
        ('--preset fang_p845_stage --hinges 0', '1 or more hinges'),
        ('--preset nobody', 'no preset'),
    ],
)
def test_the_verb_reports_missing_values(
    words: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['stage', *words.split()]) == 2
    printed = capsys.readouterr().err
    assert printed.startswith('error: ')
    assert says in printed
