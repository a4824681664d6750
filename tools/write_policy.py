"""Write config/security/policy.xml from what each node says and hears.

    python tools/write_policy.py [--namespace piezo] [--out FILE] [--check]

The result is an SROS 2 policy: one enclave per node that allows exactly its topics, services and
actions, and two for people: `operator`, who calls services and actions and looks at everything,
and `observer`, who only looks. With --check nothing is written; the exit code is 1 where the file
is out of date.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.etree import ElementTree as Xml

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))


from piezo_hysteresis.common import topics
from piezo_hysteresis.common.sheet import NodeSheet
from tools.write_docs import NODES, TYPES

POLICY = Path(__file__).resolve().parents[1] / 'config' / 'security' / 'policy.xml'
NAMESPACE = 'piezo'

# What ROS itself adds to every node, and to every managed one.
PARAMETER_SERVICES = tuple(
    f'~/{name}'
    for name in (
        'describe_parameters',
        'get_parameter_types',
        'get_parameters',
        'get_type_description',
        'list_parameters',
        'set_parameters',
        'set_parameters_atomically',
    )
)
LIFECYCLE_SERVICES = tuple(
    f'~/{name}'
    for name in (
        'change_state',
        'get_available_states',
        'get_available_transitions',
        'get_state',
        'get_transition_graph',
    )
)
COMMON_PUBLISHED = ('/diagnostics', '/parameter_events', '/rosout')

# The page says of these only that they deal with the topics of others.
EXTRA_PUBLISHED = {'player': (topics.STATE, topics.REFERENCE, topics.MARKER, '/clock')}
# Whoever takes samples in says how far it is.
TAKERS = (
    'dashboard_recorder/status',
    'discovery/status',
    'identification/status',
    'recorder/status',
)
EXTRA_HEARD = {'player': TAKERS, 'excitation': TAKERS, 'simulator': ()}
# An investigation records its experiments.
EXTRA_HEARD['discovery'] = (topics.STATE, topics.MARKER)
# What an investigation asks of others: sweeps, a mode, and to use what was found.
CALLED = {'discovery': ('run_sweep',)}
REQUESTED = {
    'discovery': (
        *(each.replace('~', 'excitation') for each in PARAMETER_SERVICES),
        'feedforward/load_model',
        'gap_monitor/load_model',
    )
}
CLOCK = {'simulator': ('/clock',)}
LOOKED_AT = tuple(name for name in TYPES if not name.startswith(('~', '/')))


def expanded(names: Iterable[str], node: str) -> list[str]:
    """Return names with ``~`` written out, in order and each once."""
    return sorted({name.replace('~', node) for name in names})


def _list(profile: Xml.Element, kind: str, names: Sequence[str], **rules: str) -> None:
    if names:
        group = Xml.SubElement(profile, f'{kind}s', rules)
        for name in names:
            Xml.SubElement(group, kind).text = name


def _enclave(parent: Xml.Element, namespace: str, node: str) -> Xml.Element:
    enclave = Xml.SubElement(parent, 'enclave', {'path': f'/{namespace}/{node}'})
    profiles = Xml.SubElement(enclave, 'profiles')
    return Xml.SubElement(profiles, 'profile', {'ns': f'/{namespace}', 'node': node})


def _node(parent: Xml.Element, namespace: str, page: NodeSheet) -> None:
    name = page.executable
    published = [*page.publishes, *COMMON_PUBLISHED, *CLOCK.get(name, ())]
    published += EXTRA_PUBLISHED.get(name, ())
    services = [*page.services, *PARAMETER_SERVICES]
    if page.managed:
        published.append('~/transition_event')
        services += LIFECYCLE_SERVICES
    heard = [*page.subscribes, '/parameter_events', *EXTRA_HEARD.get(name, ())]
    if name != 'simulator':
        heard.append('/clock')
    profile = _enclave(parent, namespace, name)
    _list(profile, 'topic', expanded(published, name), publish='ALLOW')
    _list(profile, 'topic', expanded(heard, name), subscribe='ALLOW')
    _list(profile, 'service', expanded(services, name), reply='ALLOW')
    _list(profile, 'service', sorted(REQUESTED.get(name, ())), request='ALLOW')
    _list(profile, 'action', expanded(page.actions, name), execute='ALLOW')
    _list(profile, 'action', sorted(CALLED.get(name, ())), call='ALLOW')


def _person(parent: Xml.Element, namespace: str, name: str, acts: bool) -> None:
    profile = _enclave(parent, namespace, name)
    own = [f'{page.executable}/status' for page in NODES if '~/status' in page.publishes]
    heard = [*LOOKED_AT, *own, *COMMON_PUBLISHED, '/clock']
    _list(profile, 'topic', sorted(heard), subscribe='ALLOW')
    shown = ('/diagnostics', 'dashboard_recorder/status') if name == 'dashboard' else ()
    _list(profile, 'topic', [*shown, '/parameter_events', '/rosout'], publish='ALLOW')
    if not acts:
        return
    services: list[str] = []
    for page in NODES:
        more = LIFECYCLE_SERVICES if page.managed else ()
        services += expanded((*page.services, *PARAMETER_SERVICES, *more), page.executable)
    _list(profile, 'service', sorted(services), request='ALLOW')
    _list(profile, 'action', sorted(a for page in NODES for a in page.actions), call='ALLOW')


def policy(namespace: str = NAMESPACE) -> str:
    """Return the text of the policy for the nodes in `namespace`."""
    root = Xml.Element('policy', {'version': '0.2.0'})
    enclaves = Xml.SubElement(root, 'enclaves')
    for page in NODES:
        if page.executable != 'dashboard':
            _node(enclaves, namespace, page)
    # The dashboard calls what an operator calls.
    for name in ('dashboard', 'operator'):
        _person(enclaves, namespace, name, acts=True)
    _person(enclaves, namespace, 'observer', acts=False)
    Xml.indent(root)
    head = '<?xml version="1.0" encoding="UTF-8"?>\n<!-- written by tools/write_policy.py -->\n'
    return head + Xml.tostring(root, encoding='unicode') + '\n'


def main() -> int:
    """Write the policy, or say whether it is up to date."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--namespace', default=NAMESPACE)
    parser.add_argument('--out', type=Path, default=POLICY)
    parser.add_argument('--check', action='store_true')
    words = parser.parse_args()
    text = policy(words.namespace.strip('/'))
    if words.check:
        there = words.out.read_text(encoding='utf-8') if words.out.exists() else ''
        return int(there != text)
    words.out.parent.mkdir(parents=True, exist_ok=True)
    words.out.write_text(text, encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
