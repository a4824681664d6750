"""Hooks of mkdocs.yml: wildcards in the navigation, the notebook, pages from outside of docs/."""

from __future__ import annotations

import json
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / 'docs'
NOTEBOOK = 'tutorials/python.ipynb'
REST = '*.md'  # in the navigation: what nothing else lists
# Pages of the repository that the site shows, by their path there.
OUTSIDE = {'CONTRIBUTING.md': 'contributing.md', 'CHANGELOG.md': 'changelog.md'}
# The page of the verbs, by the file that `make site` has `write_reference.py` write.
VERBS, VERBS_FILE = 'reference/cli.md', ROOT / 'out' / 'cli.md'
# A browser starts no worker for a page that is opened as a file, and the theme would then load a
# substitute from the network. This one runs the search in a hidden frame.
SUBSTITUTE = re.compile(r'<script src="https://unpkg.com/iframe-worker/shim"></script>')
FRAME = """<script>
if (location.protocol === 'file:') window.Worker = class extends EventTarget {
  constructor(url) {
    super();
    const frame = document.body.appendChild(document.createElement('iframe'));
    frame.hidden = true;
    this.inside = frame.contentWindow;
    this.inside.postMessage = data => this.dispatchEvent(new MessageEvent('message', {data}));
    const script = this.inside.document.createElement('script');
    this.ready = new Promise(loaded => { script.onload = loaded; });
    script.src = url;
    this.inside.document.body.appendChild(script);
  }
  async postMessage(data) {
    await this.ready;
    this.inside.dispatchEvent(new MessageEvent('message', {data}));
  }
  terminate() {}
};
</script>"""
# The theme makes each column at least 5 rem wide, so that tables of numbers leave the page.
STYLE = """<style>
.md-typeset table:not([class]) :is(th, td) { min-width: 0; padding: .6em .7em }
</style>"""
LINK = re.compile(r'(!?)\[([^\]]*)\]\(([^)\s]+)\)')


def on_config(config: Any) -> Any:
    """Replace each wildcard of the navigation by the pages that it matches."""
    listed = set(_pages(config['nav']))
    config['nav'] = _expanded(config['nav'], listed)
    return config


def _pages(nav: Any) -> Iterator[str]:
    """Yield the pages of the navigation and those that its narrower wildcards match."""
    if isinstance(nav, str):
        yield from (_matching(nav) if '*' in nav and nav != REST else (nav,))
    else:
        for inner in nav.values() if isinstance(nav, dict) else nav:
            yield from _pages(inner)


def _matching(pattern: str) -> list[str]:
    return sorted(page.relative_to(DOCS).as_posix() for page in DOCS.glob(pattern))


def _expanded(nav: Any, listed: set[str]) -> Any:
    if isinstance(nav, dict):
        return {title: _expanded(inner, listed) for title, inner in nav.items()}
    if not isinstance(nav, list):
        return nav
    out: list[Any] = []
    for entry in nav:
        if entry == REST:
            out += [page for page in _matching(entry) if page not in listed]
        elif isinstance(entry, str) and '*' in entry:
            out += [page for page in _matching(entry) if not page.endswith('README.md')]
        else:
            out.append(_expanded(entry, listed))
    return out


def on_files(files: Any, config: Any) -> Any:
    """Add the notebook, the page of the verbs and the pages of the repository."""
    from mkdocs.structure.files import File

    for path, name in OUTSIDE.items():
        text = (ROOT / path).read_text(encoding='utf-8')
        files.append(File.generated(config, name, content=relinked(text, '.', '')))
    files.append(File.generated(config, VERBS, content=VERBS_FILE.read_text(encoding='utf-8')))
    if notebook := files.get_file_from_path(NOTEBOOK):
        files.remove(notebook)
    page = NOTEBOOK.replace('.ipynb', '.md')
    files.append(File.generated(config, page, content=notebook_page(DOCS / NOTEBOOK)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Let links to the notebook and out of docs/ lead to pages of the site."""
    if page.file.src_uri in OUTSIDE.values():
        return markdown
    return relinked(markdown, posixpath.dirname(page.file.src_uri), 'docs')


def on_post_page(output: str, page: Any, config: Any) -> str:
    """Let the search work without a network, and tables fit the page."""
    return SUBSTITUTE.sub(lambda _: FRAME, output).replace('</head>', f'{STYLE}\n</head>', 1)


def relinked(markdown: str, folder: str, root: str) -> str:
    """Return a page of the folder with its links as the site has them.

    A link to a file of the repository that is no page of the site becomes its text.
    """

    def target(found: re.Match[str]) -> str:
        image, text, link = found.groups()
        if re.match(r'[a-z]+:|#', link):
            return found[0]
        path, mark, anchor = link.partition('#')
        whole = posixpath.normpath(posixpath.join(root, folder, path))
        if whole in OUTSIDE:
            inside = OUTSIDE[whole]
        elif whole.startswith('docs/'):
            inside = whole.removeprefix('docs/').replace(NOTEBOOK, NOTEBOOK[:-5] + 'md')
        else:
            return text
        here = '' if root == '' else folder
        return f'{image}[{text}]({posixpath.relpath(inside, here or ".")}{mark}{anchor})'

    return LINK.sub(target, markdown)


def notebook_page(path: Path) -> str:
    """Return a notebook as Markdown with its outputs."""
    parts = []
    for cell in json.loads(path.read_text(encoding='utf-8'))['cells']:
        source = ''.join(cell['source'])
        if cell['cell_type'] == 'markdown':
            parts.append(source)
            continue
        parts.append(f'```python\n{source}\n```')
        for output in cell['outputs']:
            data = output.get('data', {})
            if 'image/png' in data:
                picture = ''.join(data['image/png']).replace('\n', '')
                parts.append(
                    f'<img alt="Output of the cell" src="data:image/png;base64,{picture}">'
                )
            elif text := ''.join(output.get('text', data.get('text/plain', ''))):
                parts.append(f'```text\n{text.rstrip()}\n```')
    return '\n\n'.join(parts) + '\n'
