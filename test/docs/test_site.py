"""The site of the pages: its navigation, its links and its pinned tools; .ci/run builds it."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
import yaml
from pages import ROOT

from piezo_hysteresis.cli.main import VERBS

sys.path.insert(0, str(ROOT / 'tools'))
import site_hooks
import write_reference

CONFIG = yaml.safe_load((ROOT / 'mkdocs.yml').read_text(encoding='utf-8'))


def entries(nav: object) -> list[str]:
    if isinstance(nav, dict):
        return [each for inner in nav.values() for each in entries(inner)]
    if isinstance(nav, list):
        return [each for inner in nav for each in entries(inner)]
    return [str(nav)]


def test_every_page_is_in_the_navigation_once() -> None:
    listed = entries(site_hooks.on_config({'nav': CONFIG['nav']})['nav'])
    pages = {path.relative_to(ROOT / 'docs').as_posix() for path in ROOT.glob('docs/**/*.md')}
    generated = {*site_hooks.OUTSIDE.values(), site_hooks.VERBS, 'tutorials/python.md'}
    assert sorted(listed) == sorted(pages | generated)


@pytest.mark.parametrize(
    ('link', 'folder', 'shown'),
    [
        ('[a](../CONTRIBUTING.md#x)', 'docs', '[a](contributing.md#x)'),
        ('[a](../../CHANGELOG.md)', 'docs/tutorials', '[a](../changelog.md)'),
        ('[a](../CITATION.cff)', 'docs', 'a'),
        ('[a](python.ipynb)', 'docs/tutorials', '[a](python.md)'),
        ('![a](pictures/a.png)', 'docs', '![a](pictures/a.png)'),
        ('[a](https://a.b/c) [b](#c)', 'docs', '[a](https://a.b/c) [b](#c)'),
    ],
)
def test_links_lead_to_pages_of_the_site(link: str, folder: str, shown: str) -> None:
    inside = folder.removeprefix('docs').strip('/')
    assert site_hooks.relinked(link, inside, 'docs') == shown


def test_the_changelog_links_into_the_pages() -> None:
    assert site_hooks.relinked('[a](docs/nodes.md)', '.', '') == '[a](nodes.md)'


def test_the_notebook_becomes_a_page_with_its_pictures() -> None:
    page = site_hooks.notebook_page(ROOT / 'docs' / site_hooks.NOTEBOOK)
    assert page.startswith('# ')
    assert '```python' in page
    assert 'src="data:image/png;base64,' in page


def test_columns_of_tables_are_as_wide_as_their_numbers() -> None:
    page = site_hooks.on_post_page('<head></head><p></head>', None, None)
    assert page.index('min-width: 0') < page.index('</head><p>')
    assert page.count('<style>') == 1


@pytest.mark.component
def test_the_page_of_the_verbs_has_every_verb(tmp_path: Path) -> None:
    write_reference.main(tmp_path / 'new' / 'cli.md')
    page = (tmp_path / 'new' / 'cli.md').read_text(encoding='utf-8')
    assert set(VERBS) <= set(re.findall(r'^## (\w+)$', page, re.M))
    assert '--overwrite' in page


def test_tools_are_pinned() -> None:
    lines = (ROOT / 'requirements-docs.txt').read_text(encoding='utf-8').splitlines()
    assert all(re.fullmatch(r'#.*|[\w-]+==[\d.]+', line) for line in lines)


def test_the_public_ci_and_the_container_run_targets_that_there_are() -> None:
    targets = set(re.findall(r'^([a-z]+)\b[a-z ]*:', (ROOT / 'Makefile').read_text(), re.M))
    workflow = yaml.safe_load((ROOT / '.github' / 'workflows' / 'ci.yml').read_text('utf-8'))
    steps = [step for job in workflow['jobs'].values() for step in job['steps']]
    commands = '\n'.join(step.get('run', '') for step in steps)
    container = (ROOT / 'Dockerfile').read_text(encoding='utf-8').replace('", "', ' ')
    asked = re.findall(r'^make ([a-z]+)', commands, re.M)
    assert set(asked) == {'demo', 'test', 'scripts', 'site', 'peers'}
    assert {*asked, *re.findall(r'(?:RUN |")make ([a-z]+)', container)} <= targets
