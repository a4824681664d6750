"""Model files: what is refused, and that the sentence names what to do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from piezo_hysteresis import models
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models import ModelFile, Provenance


@pytest.fixture
def written() -> ModelFile:
    model = models.named('classical')
    return ModelFile(
        model,
        model.defaults(),
        {'A': 1e-9, 'beta': 0.25},
        Provenance(
            data=('sweep.mcap', 'rest.csv'),
            date='2026-11-30T12:00:00',
            fit='output_error',
            rate=1000.0,
            noise_floor=2.1e-8,
            notes={'seed': 7, 'converged': True},
        ),
    )


def test_a_saved_model_is_loaded_as_it_was(written: ModelFile, tmp_path: Path) -> None:
    written.save(tmp_path / 'model.yaml')
    read = ModelFile.load(tmp_path / 'model.yaml')
    assert read.to_dict() == written.to_dict()
    assert read.provenance == written.provenance
    np.testing.assert_array_equal(read.packed, written.packed)
    assert [path.name for path in tmp_path.iterdir()] == ['model.yaml']


def edited(written: ModelFile, tmp_path: Path, change: Callable[..., Any]) -> Path:
    content = written.to_dict()
    change(content)
    path = tmp_path / 'model.yaml'
    path.write_text(yaml.safe_dump(content), encoding='utf-8')
    return path


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (lambda c: c.update(schema='other'), 'schema'),
        (lambda c: c.pop('chain'), 'chain must be a list'),
        (lambda c: c['chain'].append('flux_capacitor'), 'there is no block flux_capacitor'),
        (lambda c: c['chain'].reverse(), 'out of order'),
        (lambda c: c['chain'].insert(0, 'bouc_wen_exact|bouc_wen'), 'parallel'),
        (lambda c: c['parameters'].pop('beta'), 'lacks a value for beta'),
        (lambda c: c['parameters'].update(zeta={'value': 1.0}), 'unknown zeta'),
        (lambda c: c['parameters']['beta'].update(value=-1.0), 'outside'),
        (lambda c: c['parameters']['beta'].update(value=float('nan')), 'outside'),
        (lambda c: c['parameters']['beta'].update(value='fast'), 'beta must be a number'),
        (lambda c: c['parameters']['beta'].update(value=True), 'beta must be a number'),
        (lambda c: c['parameters']['beta'].update(unit='1/mV'), 'expected 1/V'),
        (lambda c: c['parameters']['beta'].update(limit=3), 'unknown limit'),
        (lambda c: c.update(parameters=[1, 2]), 'parameters must be a mapping'),
        (lambda c: c.update(comment='x'), 'unknown comment'),
        (lambda c: c['provenance'].update(colour='red'), 'unknown colour'),
    ],
)
def test_bad_files_are_refused_in_one_sentence(
    written: ModelFile, tmp_path: Path, change: Callable[..., Any], message: str
) -> None:
    path = edited(written, tmp_path, change)
    with pytest.raises(ModelError, match=message) as caught:
        ModelFile.load(path)
    assert '\n' not in str(caught.value)
    assert str(path) in str(caught.value)


def test_numbers_that_yaml_takes_for_text_are_numbers(written: ModelFile, tmp_path: Path) -> None:
    path = edited(written, tmp_path, lambda c: c['parameters']['A'].update(value='3e-5'))
    assert ModelFile.load(path).values['A'] == 3e-5


@pytest.mark.parametrize('text', ['', '[1, 2', 'just words', '!!python/object:os.system {}'])
def test_what_is_no_model_file_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / 'model.yaml'
    path.write_text(text, encoding='utf-8')
    with pytest.raises(ModelError):
        ModelFile.load(path)
    with pytest.raises(ModelError):
        ModelFile.load(tmp_path / 'absent.yaml')


def test_a_failed_save_leaves_the_old_file(written: ModelFile, tmp_path: Path) -> None:
    target = tmp_path / 'model.yaml'
    target.mkdir()
    with pytest.raises(ModelError, match='cannot write'):
        written.save(target)
    assert [path.name for path in tmp_path.iterdir()] == ['model.yaml']


def test_node_parameters_are_flat_and_typed(written: ModelFile, tmp_path: Path) -> None:
    written.save_ros_parameters(tmp_path / 'params.yaml')
    content = yaml.safe_load((tmp_path / 'params.yaml').read_text(encoding='utf-8'))
    parameters = content['/**']['ros__parameters']
    assert parameters['model.chain'] == ['bouc_wen_exact', 'offset']
    assert all(
        isinstance(parameters[f'model.{name}'], float) for name in written.model.parameter_names
    )
    again = ModelFile.from_ros_parameters(parameters)
    assert again.values == written.values
    assert again.model.held == {'A0': 0.0}


def test_unknown_models_and_parameters_name_the_choices() -> None:
    with pytest.raises(ModelError, match='classical'):
        models.named('quantum')
    model = models.named('classical')
    with pytest.raises(ModelError, match='beta'):
        model.pack({'betta': 1.0})
    with pytest.raises(ModelError, match='holds A0'):
        model.pack({'A0': 1e-6})
    assert model.free('A0').pack({'A0': 1e-6})[2] == 1e-6
    with pytest.raises(ModelError, match='unstable'):
        models.named('extended').pack({'c1': 0.9, 'c2': 0.9})
    assert np.isfinite(models.named('extended').pack({'c1': 9.0}, checked=False)).all()
    with pytest.raises(ModelError, match='moves'):
        models.for_range(model, 0.0, 1e-6)


def test_held_parameters_are_marked_and_not_fitted() -> None:
    model = models.named('prandtl_ishlinskii')
    assert 'pi_range' not in model.free_names
    suited = models.for_range(model, 150.0, 20e-6)
    assert suited.held == {'pi_range': 150.0}
    assert suited.defaults()['w0'] == pytest.approx(1e-4 * 20 / 130 / 150)
    known = model.hold(pi_range=75.0)
    assert models.for_range(known, 150.0, 20e-6).held == {'pi_range': 75.0}
