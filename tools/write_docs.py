"""Write the pages that come from the code.

docs/nodes.md from the parameter tables, docs/reference/ from docstrings and programs, the tables
of docs/models.md and pages of new effects from what the blocks say, docs/equations.md from tags.

    python tools/write_docs.py [--check]

With --check nothing is written; the exit code is 1 where a page is out of date.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from write_equations import equation_pages
from write_models import model_pages
from write_reference import FOLDER as REFERENCE
from write_reference import reference_pages

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.registry import package_of
from piezo_hysteresis.common.sheet import NodeSheet
from piezo_hysteresis.common.table import ParameterSpec, ParameterTable
from piezo_hysteresis.parameters.sheets import SHEETS
from piezo_sim.nodes.sheets import SHEETS as SIMULATOR_SHEETS

PAGE = Path(__file__).resolve().parents[1] / 'docs' / 'nodes.md'

# Types of the words the nodes exchange; the rest is std_srvs and diagnostic_msgs.
TYPES = {
    topics.STATE: 'piezo_interfaces/msg/ActuatorState',
    topics.REFERENCE: 'piezo_interfaces/msg/Reference',
    topics.VOLTAGE_FEEDFORWARD: 'piezo_interfaces/msg/VoltageCommand',
    topics.VOLTAGE_ATTENUATED: 'piezo_interfaces/msg/VoltageCommand',
    topics.VOLTAGE_COMMAND: 'piezo_interfaces/msg/VoltageCommand',
    topics.slew_of(topics.VOLTAGE_FEEDFORWARD): 'std_msgs/msg/Float64',
    topics.slew_of(topics.VOLTAGE_ATTENUATED): 'std_msgs/msg/Float64',
    topics.slew_of(topics.VOLTAGE_COMMAND): 'std_msgs/msg/Float64',
    topics.ESTIMATE: 'piezo_interfaces/msg/ModelEstimate',
    topics.HARMONICS: 'piezo_interfaces/msg/HarmonicState',
    topics.GAP: 'piezo_interfaces/msg/Gap',
    topics.MARKER: 'piezo_interfaces/msg/RecordMarker',
    topics.LOOP_STATUS: 'piezo_interfaces/msg/LoopStatus',
    '~/status': 'piezo_interfaces/msg/LoopStatus',
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
    '/clock': 'rosgraph_msgs/msg/Clock',
}


NODES = (*SIMULATOR_SHEETS.values(), *SHEETS.values())

HEAD = """# Nodes: topics and parameters

This page is written by `python tools/write_docs.py` from the tables that the nodes themselves
declare and check their parameters with; a test holds it to them. `--help` of an executable tells
the same: `ros2 run piezo_hysteresis feedforward --help`.

All names are relative: put the nodes into a namespace or remap them as usual. `~/` stands for the
name of the node. Units are SI throughout. A value outside its range is refused with the reason;
an integer is taken for a float. The loop runs at the pace of `actuator/state`: nothing is computed
from the wall clock.

Every link keeps to `limits.low`, `limits.high`, `limits.slew` and, where it is set, to
`energy_limit`: the running mean over `energy_window` of P = C U |dV/dt| / 2, with `capacitance` C
and U = `limits.high` - `limits.low`, which for a periodic voltage is the C f U Vpp of data sheets.
A voltage that would take more is slowed down, in the mean to 2 P / (C U) volts per second, the
`EnergyLimits.sustained_slew` of the Python interface; bursts up to eleven times as fast pass.
After `watchdog` seconds of the actuator's time without input a link ramps to `safe_voltage` at
`safe_ramp` and falls silent there. In lock-step the actuator waits, and so does the watchdog.

`/diagnostics` says every second, and when the level changes, how each node is: OK, WARN or ERROR
with a sentence, and its counters. What has happened counts for five seconds. The value `state` is
`starting` from the first moment on, `ready` once the node answers, and `compiling` where a kernel
is compiled later; a node that compiles says so every second, though it can do nothing else.
Whoever waits for a node of its namespace names it and counts no time while it says that it works.

The number of a sample says which tick it belongs to. A single number that is more than 1000 ticks
ahead or 64 back is left out and counted (`strays`); a second one like it is believed, and 0 is the
start of another run. Time stamps only tell records and markers where they belong: one that does
not follow from the numbers by half a second or more, or goes back, is counted (`stamp_jumps`) and
replaced by what the number says; a clock that was set is believed from the second sample on. The
excitation stamps its markers by the clock that the states show, whichever that is.
"""

MODEL = """
The loaded model appears as `model.name`, `model.chain`, `model.held`, `model.noise_floor` and one
parameter `model.NAME` for each of its own ([models.md](models.md)). All can be set while the node
runs, and `params.yaml` of `identify` and `discover` loads with `ros2 param load`.
"""


def page() -> str:
    """Return the text of docs/nodes.md."""
    return '\n'.join([HEAD, *(_node(node) for node in NODES)])


def _node(node: NodeSheet) -> str:
    lines = [f'## {node.executable}', '', node.does, '']
    lines += [f'`ros2 run {package_of(node.executable)} {node.executable}`', '']
    for words, names in (
        ('subscribes to', node.subscribes),
        ('publishes', node.publishes),
        ('services', node.services),
        ('actions', node.actions),
    ):
        if names:
            lines.append(f'- {words} ' + ', '.join(_name(name) for name in names))
    if node.managed:
        lines.append('- managed (lifecycle) node: while inactive its share is zero')
    if node.model:
        lines.append(MODEL.rstrip())
    return '\n'.join([*lines, '', *_parameters(node.table), ''])


def _parameters(table: ParameterTable) -> list[str]:
    if not table.specs:
        return ['It has no parameters of its own.']
    head = '| parameter | default | range | unit | tunable | what it is |'
    lines = [head, '|---|---|---|---|---|---|']
    for spec in table.specs:
        unit = '' if spec.unit == '1' else spec.unit
        cells = (
            f'`{spec.name}`',
            _default(spec.default),
            _range(spec),
            unit,
            'no' if spec.read_only else 'yes',
            spec.description,
        )
        lines.append(f'| {" | ".join(cells)} |')
    return lines


def _default(value: object) -> str:
    if isinstance(value, bool):
        return f'`{str(value).lower()}`'
    return '' if value in ('', ['']) else f'`{value}`'


def _range(spec: ParameterSpec) -> str:
    if isinstance(spec.default, bool):
        return 'true, false'
    if spec.choices:
        return ', '.join(spec.choices)
    if isinstance(spec.default, str) or spec.default == ['']:
        return ''
    return spec.range_text().removesuffix(spec.unit).strip()


def _name(name: str) -> str:
    return f'`{name}` ({TYPES[name].split("/")[-1]})' if name in TYPES else f'`{name}`'


def main() -> int:
    """Write or check the pages."""
    pages = {PAGE: page(), **equation_pages(), **model_pages(), **reference_pages()}
    stray = set(REFERENCE.glob('*.md')) - pages.keys()
    if '--check' in sys.argv[1:]:
        old = {path.name for path, text in pages.items() if not _holds(path, text)}
        for name in sorted(old | {path.name for path in stray}):
            print(f'{name} is out of date: run python tools/write_docs.py', file=sys.stderr)
        return 1 if old or stray else 0
    for path in stray:
        path.unlink()
    for path, text in pages.items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding='utf-8')
    return 0


def _holds(path: Path, text: str) -> bool:
    return path.is_file() and path.read_text(encoding='utf-8') == text


if __name__ == '__main__':
    sys.exit(main())
