"""Reproducible figures and tables of each paper, and the functions that make them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.papers import fang, fujii, tatebatake, xiao, zhou
from piezo_hysteresis.papers.paper_page import MISSING, Builders, Exhibit

PAPERS: dict[str, tuple[str, Builders]] = {
    'fujii2018': ('Fujii 2018', fujii.BUILDERS),
    'tatebatake2017': ('Tatebatake 2017', tatebatake.BUILDERS),
    'zhou2021': ('Zhou 2021', zhou.BUILDERS),
    'xiao2014': ('Xiao 2014', xiao.BUILDERS),
    'fang2019': ('Fang 2019', fang.BUILDERS),
}


def names(paper: str) -> list[str]:
    """Return the names of the figures and tables of `paper`, in order."""
    return sorted((each for group, _ in PAPERS[paper][1] for each in group), key=_order)


def entries(paper: str, wanted: Sequence[str] = (), quick: bool = False) -> Iterator[Exhibit]:
    """Yield figures and tables, in order; those that are made together are made once.

    Parameters
    ----------
    paper : str
        One of `PAPERS`.
    wanted : sequence of str
        ``Figure 16``, ``Table 1``; all if empty.
    quick : bool
        Short runs, one seed, few frequencies; some figures are omitted.

    Raises
    ------
    PiezoError
        If the figure is not reproduced; the message lists the available ones and the reason.
    """
    for name in wanted:
        if name not in names(paper):
            missing = ' '.join(MISSING.get(PAPERS[paper][0], ()))
            raise PiezoError(
                f'{name.lower()} of {paper} is not made here; there are '
                f'{", ".join(each.lower() for each in names(paper))}. {missing}'
            )
    found: list[Exhibit] = []
    for group, build in PAPERS[paper][1]:
        if not wanted or set(group) & set(wanted):
            found += [each for each in build(quick) if not wanted or each.name in wanted]
    yield from sorted(found, key=lambda each: _order(each.name))


def _order(name: str) -> tuple[bool, int]:
    return name.startswith('Table'), int(re.sub(r'\D', '', name))
