"""Print how hard the pages are to read: words, words per sentence, Flesch-Kincaid grade.

    python tools/readability.py [PAGE ...]

Code, tables, comments and the targets of links are left out. The grade is that of Kincaid et al.
(1975), 0.39 words per sentence + 11.8 syllables per word - 15.59; a group of vowels is a syllable.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NOT_PROSE = re.compile(
    r'<!--.*?-->|^```.*?^```|^ {4}.*?$|^\|.*?$|^#.*?$|!\[[^]]*\]\([^)]*\)',
    re.DOTALL | re.MULTILINE,
)
WORD = re.compile(r"[A-Za-z][A-Za-z'-]*")


def prose(markdown: str) -> str:
    """Return the running text of a page; an entry of a list is a sentence."""
    text = NOT_PROSE.sub('\n\n', markdown)
    text = re.sub(r'\]\([^)]*\)', '', text)  # the target of a link
    text = re.sub(r'`[^`]*`', 'code', text)  # one word, however long
    return re.sub(r'\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )', '. ', text)


def syllables(word: str) -> int:
    """Return how many groups of vowels a word has, without a final silent e."""
    return max(1, len(re.findall(r'[aeiouy]+', re.sub(r'e$', '', word.lower()))))


def readability(markdown: str) -> tuple[int, float, float]:
    """Return the words of prose, the words per sentence and the grade."""
    sentences = [WORD.findall(each) for each in re.split(r'[.!?]+(?:\s|$)', prose(markdown))]
    words = [word for each in sentences for word in each]
    if not words:
        return 0, 0.0, 0.0
    length = len(words) / sum(map(bool, sentences))
    share = sum(map(syllables, words)) / len(words)
    return len(words), length, 0.39 * length + 11.8 * share - 15.59


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('pages', nargs='*', type=Path)
    pages = parser.parse_args().pages or sorted([*ROOT.glob('*.md'), *ROOT.glob('docs/**/*.md')])
    print(f'{"page":42} {"all words":>9} {"prose":>6} {"words/sentence":>14} {"grade":>6}')
    for page in pages:
        text = page.read_text(encoding='utf-8')
        count, length, grade = readability(text)
        name = page.resolve().relative_to(ROOT).as_posix()
        print(f'{name:42} {len(text.split()):9} {count:6} {length:14.1f} {grade:6.1f}')


if __name__ == '__main__':
    main()
