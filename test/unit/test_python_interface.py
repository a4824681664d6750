"""The Python interface: one record or many, a name or an object, results that show themselves."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

import piezo_hysteresis as ph

mpl.use('Agg')

DT = 1e-3
_ANGLE = 2 * np.pi * DT * np.arange(1000)
VOLTAGE = 0.8 * np.sin(5.0 * _ANGLE) + 0.2 * np.sin(60.0 * _ANGLE)
TRUE = {'A1': 1e-4, 'A': 2e-5, 'beta': 1.0, 'gamma': 0.2}


def record(name: str = 'a', gain: float = 1e-4, amplitude: float = 1.0) -> ph.Record:
    """Return an actuator without hysteresis."""
    voltage = amplitude * VOLTAGE
    noise = 1e-8 * np.random.default_rng(0).standard_normal(voltage.size)
    return ph.Record(name, DT, voltage, gain * voltage + noise)


@pytest.fixture(scope='module')
def found() -> ph.Identification:
    return ph.identify(record(), 'linear_mode')


# --- the names --------------------------------------------------------------------------------


@pytest.mark.component
def test_every_name_is_there_and_is_listed() -> None:
    assert set(ph.__all__) < set(dir(ph))
    for name in ph.__all__:
        assert getattr(ph, name).__doc__, name
    with pytest.raises(AttributeError, match=r"no attribute 'identfy' \(did you mean identify"):
        ph.identfy  # noqa: B018


def test_the_import_stays_fast_and_knows_no_library() -> None:
    code = (
        'import sys, piezo_hysteresis; '
        'print([m for m in ("numpy", "scipy", "numba", "rclpy") if m in sys.modules])'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == '[]'


@pytest.mark.component
def test_reading_and_fitting_import_no_drawing_library() -> None:
    code = (
        'import sys, piezo_hysteresis as ph; ph.load, ph.identify, ph.Model; '
        'print([m for m in ("matplotlib", "bokeh", "pandas", "rclpy") if m in sys.modules])'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == '[]'


# --- records ----------------------------------------------------------------------------------


def test_one_path_need_not_be_a_list(tmp_path: Path) -> None:
    file = tmp_path / 'r.csv'
    rows = '\n'.join(f'{k / 1000},{k % 7},{k % 7}' for k in range(200))
    file.write_text(f'time_s,voltage_V,displacement_um\n{rows}\n')
    for given in (file, str(file), [file]):
        (loaded,) = ph.load(given)
        assert len(loaded) == 200


def test_arrays_are_a_record_in_si_units_or_in_those_they_name() -> None:
    (plain,) = ph.load({'voltage': VOLTAGE, 'displacement': 1e-4 * VOLTAGE}, dt=DT)
    assert plain.dt == DT
    np.testing.assert_array_equal(plain.displacement, 1e-4 * VOLTAGE)
    time = (DT * np.arange(VOLTAGE.size)).tolist()
    columns = {'time_s': time, 'voltage_V': VOLTAGE, 'displacement_um': 100 * VOLTAGE}
    (named,) = ph.load({**columns, 'comment': ['x'] * VOLTAGE.size})
    assert named.dt == pytest.approx(DT)
    np.testing.assert_allclose(named.displacement, plain.displacement)
    (forced,) = ph.load({'force': VOLTAGE, 'displacement': 1e-4 * VOLTAGE}, dt=DT)
    assert forced.info.input_unit == 'N'


class Index(list[float]):
    """An index with a name, as pandas has it."""

    name = 'time_s'


class Frame(SimpleNamespace):
    """The part of a data frame that is needed."""

    def __getitem__(self, name: str) -> Any:
        return self.cells[name]


def test_a_data_frame_is_a_record_with_its_index_as_time() -> None:
    cells = {'voltage_V': VOLTAGE, 'displacement_m': 1e-4 * VOLTAGE}
    frame = Frame(columns=list(cells), cells=cells)
    (loaded,) = ph.load(frame, dt=DT)
    assert len(loaded) == VOLTAGE.size
    frame.index = Index(DT * np.arange(VOLTAGE.size))
    (loaded,) = ph.load(frame)
    assert loaded.dt == pytest.approx(DT)


def test_arrow_tables_are_records() -> None:
    arrow = pytest.importorskip('pyarrow', reason='pyarrow is missing: run "make dev"')
    table = arrow.table({'voltage': VOLTAGE, 'displacement': 1e-4 * VOLTAGE})
    (loaded,) = ph.load(table, dt=DT)
    np.testing.assert_array_equal(loaded.voltage, VOLTAGE)


def test_several_sources_get_names_of_their_own() -> None:
    columns = {'voltage': VOLTAGE, 'displacement': 1e-4 * VOLTAGE}
    loaded = ph.load([record('a'), record('a'), columns, columns], dt=DT)
    assert [each.name for each in loaded] == ['a', 'a-2', 'record', 'record-2']


# --- models -----------------------------------------------------------------------------------


def test_a_named_model_simulates_arrays_and_is_saved(tmp_path: Path) -> None:
    model = ph.Model.from_name('bouc_wen_mode', A1=1.5e-4)
    moved = model.simulate(VOLTAGE.tolist(), DT)
    assert moved.shape == VOLTAGE.shape
    model.save(tmp_path / 'model.yaml')
    np.testing.assert_array_equal(
        ph.Model.load(tmp_path / 'model.yaml').simulate(VOLTAGE, DT), moved
    )
    assert set(ph.MODELS) >= {'classical', 'bouc_wen_mode'}


@pytest.mark.parametrize('name', ['classical', 'bouc_wen_mode', 'bouc_wen_mode+creep'])
def test_an_array_and_a_record_are_simulated_alike(name: str) -> None:
    """Sample k is measured before voltage k acts, whether or not the chain has inertia."""
    model = ph.Model.from_name(name)
    moved = model.simulate(VOLTAGE, DT)
    info = ph.RecordInfo(start='rest')
    run = ph.simulate(model, ph.Record('a', DT, VOLTAGE, moved, info=info))
    np.testing.assert_allclose(run, moved, atol=1e-9)


# --- results ----------------------------------------------------------------------------------


@pytest.mark.component
def test_one_record_and_several_are_taken_everywhere(
    found: ph.Identification, tmp_path: Path
) -> None:
    assert found.chain.name == 'gain'  # the record shows no mode
    one, several = ph.simulate(found, record()), ph.simulate(found, [record(), record('b')])
    assert np.std(one - record().displacement) < 1e-6
    np.testing.assert_array_equal(several[0], one)
    assert len(several) == 2
    assert len(ph.validate(record(), found).records) == 1
    assert len(ph.validate([record(), record('b')], found).records) == 2
    found.save(tmp_path / 'model.yaml')
    saved = ph.Model.load(tmp_path / 'model.yaml')
    assert saved.provenance.rate == 1000.0
    np.testing.assert_allclose(ph.simulate(saved, record()), one, atol=1e-9)
    for start in (tmp_path / 'model.yaml', saved, found):
        again = ph.identify([record()], start)
        assert again.values['A1'] == pytest.approx(found.values['A1'], rel=1e-3)


def test_parameters_are_held_at_values() -> None:
    held = ph.identify(record(), 'linear_mode', hold={'A1': 1.01e-4})
    assert held.values['A1'] == 1.01e-4
    assert dict(zip(held.columns()['parameter'], held.columns()['held'], strict=True))['A1']


def test_a_result_is_shown_in_a_few_lines(found: ph.Identification) -> None:
    lines = repr(found).splitlines()
    assert lines[0] == 'Identification of gain by output_error, converged'
    assert any(line.startswith('  A1 = ') and line.endswith(' m/V') for line in lines)
    assert len(lines) == 2 + len(found.chain.parameters)
    checked = ph.validate(record('b', 1.1e-4), found)
    shown: tuple[Any, ...] = (found, checked, found.model, record())
    for result in shown:
        lines = repr(result).splitlines()
        assert len(lines) < 9
        assert all(len(line) < 160 for line in lines)
        page = result._repr_html_()
        assert page.startswith(f'<p><b>{lines[0]}')
        assert page.count('<tr>') == 1 + min(30, len(next(iter(result.columns().values()))))


@pytest.mark.component
def test_results_are_drawn_on_axes_and_written_as_a_report(
    found: ph.Identification, tmp_path: Path
) -> None:
    import matplotlib.pyplot as plt

    checked = ph.validate([record('a'), record('b', 1.1e-4)], found)
    _, own = plt.subplots()
    assert found.plot(own) is own
    assert checked.plot().get_title() == 'b'  # the worst
    assert checked.plot(record='a').get_title() == 'a'
    assert record().plot().get_ylabel() == 'displacement [µm]'
    loop = found.model.plot()
    assert loop.get_title() == 'gain, simulated'
    (line,) = loop.lines
    assert np.ptp(line.get_ydata()) == pytest.approx(1e6 * np.ptp(record().displacement), rel=0.02)
    with pytest.raises(ph.PiezoError, match=r'no record c.*there are a, b'):
        checked.plot(record='c')
    plt.close('all')
    assert checked.report(tmp_path / 'check') == tmp_path / 'check' / 'report.html'
    assert {'report.html', 'summary.json', 'model.yaml'} <= {
        each.name for each in (tmp_path / 'check').iterdir()
    }
    with pytest.raises(ph.PiezoError, match='holds the results of validate'):
        found.report(tmp_path / 'check')
    assert found.report(tmp_path / 'check', overwrite=True).is_file()


def test_a_frame_without_pandas_is_a_sentence(
    found: ph.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, 'pandas', None)
    with pytest.raises(ph.PiezoError, match='pip install pandas'):
        found.to_frame()


def test_a_frame_holds_the_columns(
    found: ph.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, 'pandas', SimpleNamespace(DataFrame=dict))
    assert found.to_frame() == found.columns()


@pytest.mark.component
def test_the_identified_model_compensates(tmp_path: Path) -> None:
    import matplotlib.pyplot as plt

    model = ph.Model.from_name('classical', **TRUE)
    reference = 'sine:frequency=5,amplitude=50e-6,duration=2'
    study = ph.compensate(model, reference, pid=(10.0, 1e3, 0.0))
    assert [run.name for run in study.runs[:2]] == ['no compensation', 'feedforward']
    assert study.best.metrics.rms < 1e-9
    assert study.voltage.shape == (2000,)
    assert repr(study).splitlines()[0] == f'Compensation of {reference} with classical'
    assert study.columns()['run'] == [run.name for run in study.runs]
    assert study.plot().get_ylabel() == 'tracking error, envelope [µm]'
    plt.close('all')
    assert study.report(tmp_path / 'study').is_file()
    other = ph.Model.from_name('classical', **{**TRUE, 'A': 3e-5})
    bare = ph.compensate(model, reference, other, attenuation='none')
    assert [run.name for run in bare.runs] == ['no compensation', 'feedforward']
    assert bare.best.metrics.rms > 1e-7


@pytest.mark.component
@pytest.mark.parametrize('seconds', [1.0, 4.0])
def test_attenuation_does_not_learn_from_the_start(seconds: float) -> None:
    values = {**TRUE, 'natural_frequency': 68.0, 'damping_ratio': 0.03}
    model = ph.Model.from_name('bouc_wen_mode', **values)
    reference = f'sine:frequency=23,amplitude=40e-6,duration={seconds}'
    study = ph.compensate(model, reference)
    _, feedforward, attenuated = (run.metrics.rms for run in study.runs)
    assert attenuated < 1.05 * feedforward


@pytest.mark.slow
def test_a_discovery_by_name_shows_what_is_missing(tmp_path: Path) -> None:
    import matplotlib.pyplot as plt

    missing = ph.discover([record('a'), record('b', 1.01e-4)], 'linear_mode', workers=1)
    assert missing.verdict.baseline == 'linear_mode'
    lines = repr(missing).splitlines()
    assert lines[0] == f'Discovery: {missing.verdict.summary}'
    assert len(lines) == 1 + len(missing.verdict.effects)
    assert len(missing.columns()['effect']) == len(missing.verdict.effects)
    assert missing.simulate(VOLTAGE, DT).shape == VOLTAGE.shape
    assert missing.plot().get_yscale() == 'log'
    plt.close('all')
    assert missing.report(tmp_path / 'found').is_file()


# --- what is wrong is one sentence ------------------------------------------------------------

WRONGLY: Any = ph  # what mypy would refuse
COLUMNS = {'voltage': VOLTAGE, 'displacement': VOLTAGE}


@pytest.mark.parametrize(
    ('call', 'says'),
    [
        (lambda: WRONGLY.load(3), 'not of type int'),
        (lambda: WRONGLY.load([3.0]), 'not of type float'),
        (lambda: WRONGLY.load([]), 'no data were given'),
        (lambda: WRONGLY.load(COLUMNS), 'no time; name one time_s, or give dt'),
        (lambda: WRONGLY.load(COLUMNS, dt='1 ms'), "positive number .s., got '1 ms'"),
        (lambda: WRONGLY.load({'time': VOLTAGE, **COLUMNS}, dt=DT), 'leave dt out'),
        (lambda: WRONGLY.load({'voltage': VOLTAGE}, dt=DT), 'no column of displacement'),
        (lambda: WRONGLY.load({**COLUMNS, 'time': [0.0]}), 'equal length'),
        (lambda: WRONGLY.load({**COLUMNS, 'time': ['a'] * 1000}), 'not numbers'),
        (lambda: WRONGLY.identify([record()], 'clasical'), 'did you mean classical'),
        (lambda: WRONGLY.identify('a.csv', 'classical'), 'a.csv does not exist'),
        (lambda: WRONGLY.identify([1.0], 'classical'), 'not of type float'),
        (lambda: WRONGLY.identify(None, 'classical'), 'not of type NoneType'),
        (lambda: WRONGLY.identify(record(), 3), 'a model is its name'),
        (lambda: WRONGLY.identify(record(), 'classical', method='pos'), 'did you mean pso'),
        (lambda: WRONGLY.identify(record(), 'classical', method=3), 'not of type int'),
        (
            lambda: WRONGLY.identify(record(), 'classical', weight='equal'),
            'output_error has no option weight .did you mean weights',
        ),
        (
            lambda: WRONGLY.identify(record(), 'classical', hold={'AI': 1.0}),
            'no parameter AI to hold .did you mean A',
        ),
        (lambda: WRONGLY.identify(record(), 'classical', hold=3), 'values to hold .*of type int'),
        (lambda: WRONGLY.identify(record(), 'classical', start={'A1': 'x'}), 'A1 = x is not a'),
        (lambda: WRONGLY.identify(record(), 'classical', seed='a'), "whole number, got 'a'"),
        (lambda: WRONGLY.identify([], 'classical'), 'there is no record'),
        (lambda: WRONGLY.validate([], ph.Model.from_name('classical')), 'there is no record'),
        (lambda: WRONGLY.Record('a', '1 ms', VOLTAGE, VOLTAGE), "number .s., got '1 ms'"),
        (lambda: WRONGLY.Record('a', DT, 'sweep', VOLTAGE), 'voltage must be an array'),
        (lambda: WRONGLY.Model.from_name(3), 'not of type int'),
        (lambda: WRONGLY.Model.from_name('classical', A1='x'), "must be a number, got 'x'"),
        (lambda: WRONGLY.Model.load(3), 'given by its path'),
        (lambda: record().plot(3), 'axes of matplotlib'),  # type: ignore[arg-type]
        (lambda: WRONGLY.validate(record(), 'classical'), 'model classical has no values'),
        (lambda: WRONGLY.validate(record(), 'clasical'), 'did you mean classical'),
        (lambda: WRONGLY.validate(3, ph.Model.from_name('classical')), 'not of type int'),
        (lambda: WRONGLY.discover(record(), 'clasical'), 'did you mean classical'),
        (lambda: WRONGLY.discover(record(), None), 'not of type NoneType'),
        (lambda: WRONGLY.discover({}, 'classical'), 'no time; name one time_s'),
        (lambda: WRONGLY.discover(record(), 'classical', zero='x'), "zero 'x' is unknown"),
        (lambda: WRONGLY.simulate('classical', record()), 'model classical has no values'),
        (lambda: WRONGLY.simulate(3, record()), 'not of type int'),
        (lambda: WRONGLY.Model.from_name('classical', A11=1.0), 'did you mean A1'),
        (lambda: ph.Model.from_name('classical').simulate('a', DT), 'not of type str'),
        (lambda: ph.Model.from_name('classical').simulate([[1.0]], DT), 'shape .1, 1.'),
        (lambda: ph.Model.from_name('classical').simulate([1.0], 0.0), 'sampling interval'),
        (lambda: WRONGLY.compensate('clasical', 'sine'), 'did you mean classical'),
        (
            lambda: WRONGLY.compensate(ph.Model.from_name('classical'), 'sin:frequency=1'),
            'did you mean sine',
        ),
        (lambda: WRONGLY.compensate(ph.Model.from_name('classical'), 3), 'not of type int'),
        (
            lambda: WRONGLY.compensate(ph.Model.from_name('classical'), 'sine', law='exakt'),
            'did you mean exact',
        ),
        (
            lambda: WRONGLY.compensate(ph.Model.from_name('classical'), 'sine', attenuation=3),
            'attenuation 3 is unknown',
        ),
        (
            lambda: WRONGLY.compensate(ph.Model.from_name('classical'), 'sine', pid=3),
            'pid is three gains',
        ),
        (
            lambda: WRONGLY.compensate(ph.Model.from_name('classical'), 'sine', noise=-1.0),
            'noise must be a number of 0 or more',
        ),
    ],
)
def test_errors_are_reported_in_a_sentence(call: Callable[[], Any], says: str) -> None:
    with pytest.raises(ph.PiezoError, match=says) as caught:
        call()
    assert '\n' not in str(caught.value)
