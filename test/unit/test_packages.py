"""package.xml names what a package imports, by the keys of rosdep."""

import ast
import re
import sys
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[2] / 'src'
PACKAGES = [
    p.parent.name for p in SOURCES.glob('*/package.xml') if (p.parent / 'setup.py').exists()
]
KEYS = {'yaml': 'python3-yaml', 'bokeh': 'python3-bokeh-pip', 'llvmlite': 'python3-numba'}
# By pip where there is no key, or what comes with another that is named.
ELSEWHERE = {
    *('rosbags', 'pyarrow', 'shtab'),  # requirements.txt
    *('apsw', 'lz4', 'backports'),  # of rosbags
    *('jinja2',),  # of bokeh
    *('distributed',),  # where a user brings a cluster
}


def imported(folder):
    for path in folder.rglob('*.py'):
        if path.name == 'setup.py':
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                yield from (alias.name.split('.')[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                yield str(node.module).split('.')[0]


@pytest.mark.parametrize('package', sorted(PACKAGES))
def test_every_import_is_a_named_dependency(package):
    text = (SOURCES / package / 'package.xml').read_text()
    named = set(re.findall(r'<(?:exec_)?depend>([^<]+)<', text))
    foreign = {
        name
        for name in imported(SOURCES / package)
        if name not in sys.stdlib_module_names and name not in {package, *ELSEWHERE}
    }
    if package == 'piezo_common':
        foreign -= {'builtin_interfaces'}  # for checkers of types only
    known = {name: KEYS.get(name, name) for name in foreign}
    missing = [n for n, key in known.items() if key not in named and f'python3-{n}' not in named]
    assert sorted(missing) == []
