"""Natural calls of the Python interface: each works, or a sentence names the right one."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import piezo_hysteresis
from piezo_hysteresis.discovery.verdict.verdict import Verdict
from piezo_hysteresis.investigation.runner import Result as InvestigationResult

ph: Any = piezo_hysteresis  # what mypy would refuse is tried too

DT = 1e-3
T = DT * np.arange(1500)
U = np.sin(2 * np.pi * 4 * T) * (1 + 0.3 * np.sin(2 * np.pi * 61 * T))
VALUES = {'A1': 1e-4, 'A': 2e-5, 'beta': 1.0, 'gamma': 0.2}
MODEL = ph.Model.from_name('bouc_wen_mode', **VALUES, natural_frequency=80.0, damping_ratio=0.03)
PLAIN = ph.Model.from_name('classical', **VALUES)
Y = 1e-4 * U + 1e-8 * np.random.default_rng(0).standard_normal(U.size)
RECORD = ph.Record(U, Y, DT)
WISH = 40e-6 * np.sin(2 * np.pi * 5 * T)
SINE = 'sine:frequency=5,amplitude=40e-6,duration=0.6'


@pytest.fixture(scope='module')
def found() -> Any:
    return ph.identify(RECORD, 'linear_mode')


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with two records and a remark, and a reference beside it."""
    place = tmp_path_factory.mktemp('calls')
    (place / 'train').mkdir()
    for name in ('a', 'b'):
        table = np.column_stack([T, U, 1e6 * Y])
        head = 'time_s,voltage_V,displacement_um'
        np.savetxt(place / 'train' / f'{name}.csv', table, '%.9g', ',', header=head, comments='')
    (place / 'train' / 'remarks.md').write_text('new glue')
    head = 'time_s,reference_um'
    table = np.column_stack([T, 1e6 * WISH])
    np.savetxt(place / 'wish.csv', table, '%.9g', ',', header=head, comments='')
    return place


Call = Callable[[Path, Any], Any]
WORKS: dict[str, tuple[Call, Callable[[Any], bool]]] = {
    'folder': (lambda p, f: ph.load(p / 'train'), lambda r: len(r) == 2),
    'pattern': (lambda p, f: ph.load(str(p / 'train' / '*.csv')), lambda r: len(r) == 2),
    'two files': (
        lambda p, f: ph.load(p / 'train' / 'a.csv', p / 'train' / 'b.csv'), lambda r: len(r) == 2
    ),
    'one file is used': (
        lambda p, f: ph.load(p / 'train' / 'a.csv').voltage, lambda u: u.size == U.size
    ),
    'one file in seconds': (
        lambda p, f: ph.load(p / 'train' / 'a.csv')[0][0.5:1.0], lambda r: len(r) == 500
    ),
    'arrays, dt': (lambda p, f: ph.load(U, Y, dt=DT), lambda r: r.rate == 1000),
    'arrays, fs': (lambda p, f: ph.load((U, Y), fs=1000), lambda r: r.dt == DT),
    'time, arrays': (lambda p, f: ph.load((T, U, Y)), lambda r: r.rate == pytest.approx(1000)),
    'table': (lambda p, f: ph.load(np.column_stack([T, U, Y])), lambda r: len(r[0]) == U.size),
    'lists': (lambda p, f: ph.load((list(U), list(Y)), dt=DT), lambda r: len(r[0]) == U.size),
    'dictionary': (
        lambda p, f: ph.load({'voltage': U, 'displacement': Y}, fs=1000), lambda r: len(r) == 1
    ),
    'record': (lambda p, f: ph.Record(U, Y, DT), lambda r: r.name == 'record'),
    'record, fs': (lambda p, f: ph.Record(U, Y, fs=1000), lambda r: r.dt == DT),
    'record by name': (
        lambda p, f: ph.Record(voltage=U, displacement=Y, dt=DT), lambda r: len(r) == U.size
    ),
    'record as before': (lambda p, f: ph.Record('a', DT, U, Y), lambda r: r.name == 'a'),
    'record with a name': (lambda p, f: ph.Record(U, Y, DT, 'run 3'), lambda r: r.name == 'run 3'),
    'samples': (
        lambda p, f: RECORD[100:200], lambda r: np.array_equal(r.voltage, U[100:200])
        and r.start == pytest.approx(0.1)
    ),
    'seconds': (
        lambda p, f: RECORD[0.1:0.2], lambda r: np.array_equal(r.voltage, U[100:200])
    ),
    'seconds of a part': (
        lambda p, f: RECORD[0.5:][0.6:0.7], lambda r: np.array_equal(r.voltage, U[600:700])
    ),
    'the end': (lambda p, f: RECORD[-100:], lambda r: np.array_equal(r.voltage, U[-100:])),
    'resample': (lambda p, f: RECORD.resample(500), lambda r: r.rate == 500),
    'part of records': (lambda p, f: ph.load(p / 'train')[:1], lambda r: r.rate == 1000),
    'identify a file': (
        lambda p, f: ph.identify(p / 'train' / 'a.csv', 'linear_mode'), lambda i: i.converged
    ),
    'identify arrays': (
        lambda p, f: ph.identify((U, Y), 'linear_mode', dt=DT), lambda i: i.converged
    ),
    'validate a file': (
        lambda p, f: ph.validate(p / 'train' / 'a.csv', f), lambda v: len(v.records) == 1
    ),
    'validate lists of load': (
        lambda p, f: ph.validate([ph.load(p / 'train' / f'{n}.csv') for n in 'ab'], f),
        lambda v: len(v.records) == 2,
    ),
    'simulate a file': (
        lambda p, f: ph.simulate(f, p / 'train' / 'a.csv'), lambda s: len(s) == 1
    ),
    'name with spaces': (
        lambda p, f: ph.Model.from_name('Bouc-Wen mode'), lambda m: m.model.name == 'bouc_wen_mode'
    ),
    'parameters': (lambda p, f: MODEL.parameters, lambda v: v['A1'] == 1e-4),
    'parameters of a result': (lambda p, f: f.parameters['A1'], lambda v: v > 0),
    'a parameter': (lambda p, f: MODEL['natural_frequency'], lambda v: v == 80.0),
    'a usual name': (lambda p, f: MODEL['mode_frequency'], lambda v: v == 80.0),
    'a parameter of a result': (lambda p, f: f['A1'], lambda v: v > 0),
    'response': (
        lambda p, f: np.abs(MODEL.frequency_response([1.0, 80.0], amplitude=1)),
        lambda g: g[1] / g[0] == pytest.approx(1 / 0.06, rel=0.03),
    ),
    'response at one': (
        lambda p, f: MODEL.frequency_response(1.0, amplitude=1), lambda g: g.shape == ()
    ),
    'inverse': (
        lambda p, f: PLAIN.inverse(WISH, DT),
        lambda i: float(np.std(i.displacement - WISH)) < 1e-9 and not i.limited,
    ),
    'inverse is an array': (
        lambda p, f: np.asarray(MODEL.inverse(WISH, DT)), lambda u: u.ndim == 1
    ),
    'inverse of a result': (lambda p, f: f.inverse(WISH, DT).voltage, lambda u: u.size == T.size),
    'inverse says what was limited': (
        lambda p, f: PLAIN.inverse(WISH, DT, low=-0.2, high=0.2),
        lambda i: np.ptp(i.voltage) == pytest.approx(0.4) and '0.2 V' in i.limited[0],
    ),
    'inverse as a file': (
        lambda p, f: (PLAIN.inverse(WISH, DT).save(p / 'u.csv'), np.loadtxt(
            p / 'u.csv', delimiter=',', skiprows=1))[1],
        lambda table: table.shape == (T.size, 4),
    ),
    'compensate an array': (
        lambda p, f: ph.compensate(PLAIN, WISH, dt=DT), lambda c: c.best.metrics.rms < 1e-8
    ),
    'compensate a file': (
        lambda p, f: ph.compensate(PLAIN, p / 'wish.csv'), lambda c: c.best.metrics.rms < 1e-8
    ),
    'compensate a file by its name': (
        lambda p, f: ph.compensate(PLAIN, str(p / 'wish.csv')), lambda c: c.voltage.size == T.size
    ),
    'columns': (lambda p, f: RECORD.columns(), lambda c: next(iter(c)) == 'time_s'),
    'batch': (
        lambda p, f: ph.batch('identify', p / 'train', p / 'out', model='linear_mode'),
        lambda b: b.rows[0]['records'] == 2,
    ),
}  # fmt: skip


@pytest.mark.filterwarnings('ignore::piezo_hysteresis.errors.DataNote')
@pytest.mark.component
@pytest.mark.parametrize('name', WORKS)
def test_natural_calls_work(name: str, folder: Path, found: Any) -> None:
    call, right = WORKS[name]
    assert right(call(folder, found))


SAYS: dict[str, tuple[Call, str]] = {
    'short name': (lambda p, f: ph.identify(RECORD, 'PI'), 'did you mean prandtl_ishlinskii'),
    'Bouc-Wen': (lambda p, f: ph.identify(RECORD, 'Bouc-Wen'), 'classical or bouc_wen_mode'),
    'arrays apart': (lambda p, f: ph.identify(U, Y), r'identify\(\(voltage, displacement\), dt='),
    'no dt': (lambda p, f: ph.load(U, Y), 'no time; name one time_s, or give dt'),
    'dt and fs': (lambda p, f: ph.load(U, Y, dt=DT, fs=1000), 'give one of them'),
    'fs = 0': (lambda p, f: ph.load(U, Y, fs=0), 'positive number .Hz.'),
    'no file': (lambda p, f: ph.load(str(p / '*.mat')), 'no file matches'),
    'no such file': (lambda p, f: ph.identify('no.csv'), 'no.csv does not exist'),
    'record without dt': (lambda p, f: ph.Record(U, Y), r'Record\(voltage, displacement, dt\)'),
    'one sample': (lambda p, f: RECORD[5], 'record.voltage.5.'),
    'every second sample': (lambda p, f: RECORD[::2], 'resample'),
    'samples of records': (
        lambda p, f: ph.load(p / 'train' / 'a.csv')[100:200], 'records.0..100:200.'
    ),
    'unknown parameter': (lambda p, f: MODEL['w0'], 'choose one of A1'),
    'misspelt parameter': (lambda p, f: MODEL['natural_freqency'], 'did you mean natural_freq'),
    'above Nyquist': (lambda p, f: MODEL.frequency_response(800.0), 'half the rate'),
    'response without a range': (lambda p, f: MODEL.frequency_response(1.0), 'give amplitude='),
    'words to inverse': (lambda p, f: MODEL.inverse(SINE, DT), 'goes to ph.compensate'),
    'inverse of a table': (lambda p, f: MODEL.inverse([[1.0]], DT), 'series of finite numbers'),
    'inverse without a step': (lambda p, f: MODEL.inverse(WISH, 0.0), 'dt must be a positive'),
    'batch of another verb': (
        lambda p, f: ph.batch('validate', p, p / 'o'), 'identify or discover'
    ),
    'export of a name': (lambda p, f: ph.export('classical', p / 'lib'), 'has no values'),
    'search without a model': (lambda p, f: ph.identify(RECORD, method='pso'), 'needs a model'),
    'no discrepancy': (
        lambda p, f: ph.investigate(PLAIN, PLAIN, p / 'inv', low=-1, high=1, slew=500),
        'identify it again, on records',
    ),
}  # fmt: skip


@pytest.mark.filterwarnings('ignore::piezo_hysteresis.errors.DataNote')
@pytest.mark.component
@pytest.mark.parametrize('name', SAYS)
def test_wrong_calls_get_a_sentence(name: str, folder: Path, found: Any) -> None:
    call, says = SAYS[name]
    with pytest.raises(ph.PiezoError, match=says) as caught:
        call(folder, found)
    assert '\n' not in str(caught.value)


def test_an_attribute_of_several_records_names_the_first_one(folder: Path) -> None:
    with pytest.warns(ph.records.LeftOutWarning, match='remarks.md left out'):
        records = ph.load(folder / 'train')
    with pytest.raises(AttributeError, match=r'records\[0\]\.voltage'):
        _ = records.voltage
    with pytest.raises(AttributeError, match='did you mean voltage'):
        _ = records.voltag
    assert not hasattr(records, 'voltag')


@pytest.mark.parametrize(
    ('where', 'name', 'call'),
    [
        (MODEL, 'feedforward', r'use model.inverse\(reference, dt\)'),
        (MODEL, 'predict', r'use ph.simulate\(model, records\)'),
        (MODEL, 'to_dataframe', r'use to_frame\(\)'),
        (MODEL, 'parameter', 'did you mean parameters'),
        (ph, 'feedforward', r'use model.inverse\(reference, dt\)'),
        (ph, 'to_frame', r'use to_frame\(\) of records'),
        (ph, 'identfy', 'did you mean identify'),
    ],
)
def test_a_name_that_does_not_exist_names_the_call(where: Any, name: str, call: str) -> None:
    with pytest.raises(AttributeError, match=call):
        getattr(where, name)
    assert not hasattr(where, name)
    assert copy.deepcopy(MODEL).values == MODEL.values


# Names as other libraries have them, by result.
INSTEAD: dict[str, dict[str, str]] = {
    'record': {
        'u': 'voltage', 'y': 'displacement', 't': 'time', 'fs': 'rate', 'Ts': 'dt', 'n': 'len',
        'trim': r'record\[0', 'decimate': 'resample', 'save': 'write_bag', 'fit': 'ph.identify',
        'displacment': 'did you mean displacement', 'to_pandas': 'to_frame',
    },
    'records': {'u': 'voltage', 'fs': 'rate', 'to_csv': 'to_frame', 'identify': 'ph.identify'},
    'identified': {
        'rmse': 'nrmse_percent', 'params': 'parameters', 'stderr': 'std', 'residuals': 'runs',
        'predict': 'ph.simulate', 'score': 'nrmse', 'bode': 'frequency_resp', 'show': 'plot',
        'covariance': 'model.covariance', 'noise': 'noise_floor',
    },
    'errors': {'rmse': 'free_run_rms', 'nrmse': 'nrmse_percent', 'noise': 'noise_rms'},
    'validation': {'rmse': 'nrmse_percent', 'r2': 'nrmse', 'residuals': 'simulated'},
    'compensation': {
        'u': 'voltage', 'y': 'best.result.displacement', 'rms': 'best.metrics', 't': 'time',
        'metrics': 'best.metrics', 'error': 'best.result.error',
    },
    'run': {'voltage': 'result.voltage', 'rms': 'metrics.rms'},
    'samples': {'u': 'voltage', 'displacment': 'did you mean displacement'},
    'metrics': {'rmse': 'rms', 'peak': 'largest'},
    'inverse': {'u': 'voltage', 'error': 'displacement - reference', 'to_csv': 'to_frame'},
    'discovery': {
        'effects': 'verdict.effects', 'summary': 'verdict.summary', 'names': 'verdict.effects',
        'noise_floor': 'floor', 'limits': 'verdict.detection_limits',
    },
    'verdict': {'text': 'summary', 'probability': r'effects\[0\]'},
    'investigation': {'summary': 'words', 'names': 'effects'},
}  # fmt: skip


def _bare(kind: type) -> Any:
    """Return an object without its values: a wrong name is wrong of any."""
    return object.__new__(kind)


@pytest.fixture(scope='module')
def results(found: Any) -> dict[str, Any]:
    compared = ph.compensate(PLAIN, WISH, dt=DT)
    return {
        'record': RECORD, 'records': ph.load(U, Y, dt=DT), 'identified': found,
        'errors': found.records[0], 'validation': ph.validate(RECORD, found),
        'compensation': compared, 'run': compared.best, 'samples': compared.best.result,
        'metrics': compared.best.metrics, 'inverse': PLAIN.inverse(WISH, DT),
        'discovery': _bare(ph.Discovery), 'verdict': _bare(Verdict),
        'investigation': _bare(InvestigationResult),
    }  # fmt: skip


@pytest.mark.component
@pytest.mark.parametrize('kind', INSTEAD)
def test_a_wrong_name_of_a_result_names_the_right_one(kind: str, results: dict[str, Any]) -> None:
    for name, right in INSTEAD[kind].items():
        with pytest.raises(AttributeError, match=right) as caught:
            getattr(results[kind], name)
        sentence = str(caught.value)
        assert '; use ' in sentence or 'did you mean' in sentence
    with pytest.raises(AttributeError, match='__nothing__'):
        _ = results[kind].__nothing__
    copy.copy(results[kind])


@pytest.mark.component
def test_no_table_of_wrong_names_holds_a_right_one(results: dict[str, Any]) -> None:
    for result in results.values():
        kind = type(result)
        wrong = ' '.join(vars(kind).get('_INSTEAD', {}).values()).split()
        assert len(set(wrong)) == len(wrong)
        for name in wrong:
            assert not hasattr(result, name), f'{kind.__name__}.{name}'
            with pytest.raises(AttributeError, match='; use '):
                getattr(result, name)


def test_records_come_first() -> None:
    with pytest.raises(ph.PiezoError, match=r'validate\(records, model\)'):
        ph.validate(MODEL, RECORD)


@pytest.mark.slow
def test_a_function_is_investigated(tmp_path: Path) -> None:
    def measure(voltage: Any) -> Any:
        noise = 1e-8 * np.random.default_rng(voltage.size).standard_normal(voltage.size)
        return PLAIN.simulate(voltage, DT) + noise

    record = ph.Record(U, measure(U), DT)
    model = ph.identify(record, 'classical')
    done = ph.investigate(
        model, measure, tmp_path / 'inv', low=-1.0, high=1.0, budget=20.0, max_frequency=20.0
    )
    assert done.verdict == 'none'
    assert (tmp_path / 'inv' / 'found' / 'report.html').is_file()


def test_a_room_does_not_hide_the_function_of_its_name() -> None:
    import piezo_hysteresis.batch.run
    import piezo_hysteresis.export.library  # noqa: F401

    assert callable(ph.export)
    assert callable(ph.batch)
