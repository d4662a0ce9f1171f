"""Design of a study: each person's pairs and their sides.

A study has a number of sheets; a person gets one, by their number. What is random for a person is
the order (the page shuffles the sheet); what has to be even is laid down here, so that it is even
and not only so on average:

- Over all sheets each pair is shown equally often, and as often with its sides swapped: sheets come
  in couples that are mirror images of each other.
- On one sheet the pairs of methods occur equally often, up to one, if every sitter and style has
  every method.
- On one sheet each method stands as often on the left as on the right, up to one. For this, pairs
  are taken as the edges of a graph between methods, each edge is walked along once on closed walks,
  and what one comes from stands on the left: one leaves every place as often as one comes to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, zip_longest

import numpy as np

from lfportrait.errors import UserError

from .entries import Entry

__all__ = ["Pair", "Sheet", "pairs_of", "sheets_of"]


@dataclass(frozen=True)
class Pair:
    """Two portraits that are compared.

    Attributes
    ----------
    first, second
        Numbers of the entries; the first is the left one unless sides are swapped.
    methods
        Their methods.
    """

    first: int
    second: int
    methods: tuple[str, str]


Sheet = tuple[tuple[int, bool], ...]
"""What one person sees: numbers of pairs, and whether their sides are swapped."""


def pairs_of(entries: Sequence[Entry], seed: int = 0) -> list[Pair]:
    """All pairs of methods of each sitter and style, pairs of methods taking turns.

    Parameters
    ----------
    entries
        The portraits.
    seed
        Seed of the order of sitters and styles.

    Returns
    -------
    pairs
        In an order of which any stretch has the pairs of methods equally often, up to one, if each
        sitter and style has all methods.
    """
    generator = np.random.default_rng(seed)
    groups: dict[tuple[str, str], list[int]] = {}
    for number, entry in enumerate(entries):
        groups.setdefault(entry.group, []).append(number)
    by_methods: dict[tuple[str, str], list[Pair]] = {}
    for members in groups.values():
        for first, second in combinations(members, 2):
            methods = (entries[first].method, entries[second].method)
            by_methods.setdefault(methods, []).append(Pair(first, second, methods))
    columns = [[column[place] for place in generator.permutation(len(column))]
               for column in by_methods.values()]
    return [pair for row in zip_longest(*columns) for pair in row if pair is not None]


def _swapped(edges: Sequence[tuple[str, str]]) -> list[bool]:
    """Which edges are turned round so that each node has as many outgoing as incoming, up to one.

    Nodes of odd degree are joined to one more node; then every edge lies on a closed walk
    (Hierholzer).
    """
    ends: list[tuple[str | None, str]] = list(edges)
    degree: dict[str, int] = {}
    for one, two in edges:
        for node in (one, two):
            degree[node] = degree.get(node, 0) + 1
    ends += [(None, node) for node, count in degree.items() if count % 2]
    at: dict[str | None, list[int]] = {}
    for number, pair in enumerate(ends):
        for end in pair:
            at.setdefault(end, []).append(number)
    walked: dict[int, bool] = {}
    for start in at:
        here = start
        while True:
            while at[here] and at[here][-1] in walked:
                at[here].pop()
            if not at[here]:
                break  # only at the start: every other node that is entered can be left
            number = at[here].pop()
            left, right = ends[number]
            walked[number] = here != left
            here = right if here == left else left
    return [walked[number] for number in range(len(edges))]


def sheets_of(pairs: Sequence[Pair], pairs_per_person: int = 0) -> list[Sheet]:
    """The sheets of a study.

    Parameters
    ----------
    pairs
        Those of `pairs_of`.
    pairs_per_person
        Pairs on one sheet; 0 for all.

    Returns
    -------
    sheets
        Sheet ``2 k + 1`` is sheet ``2 k`` with all sides swapped.

    Raises
    ------
    UserError
        If there are fewer pairs than a person should see.
    """
    if not 0 <= pairs_per_person <= len(pairs):
        raise UserError(f"--pairs-per-person must be 1 to {len(pairs)}, the number of pairs, or 0 "
                        f"for all, not {pairs_per_person}")
    size = pairs_per_person or len(pairs)
    sheets: list[Sheet] = []
    for window in range(len(pairs) // math.gcd(size, len(pairs))):
        shown = [(window * size + place) % len(pairs) for place in range(size)]
        sides = _swapped([pairs[number].methods for number in shown])
        for mirrored in (False, True):
            sheets.append(tuple((number, side != mirrored)
                                for number, side in zip(shown, sides)))
    return sheets
