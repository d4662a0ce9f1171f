"""Who sees what is even: over people, over methods, over sides."""

from collections import Counter
from itertools import combinations
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from lfportrait.errors import UserError
from lfportrait_eval.study import Entry, pairs_of, sheets_of


def entries(methods_of_groups):
    return [Entry(f"m{method}", "anna", f"style {number}", Path("x.mp4"))
            for number, methods in enumerate(methods_of_groups) for method in sorted(methods)]


ANY = some.lists(some.sets(some.integers(0, 4), min_size=2, max_size=5), min_size=1, max_size=6)


@settings(max_examples=60, deadline=None)
@given(groups=ANY, share=some.floats(0, 1), seed=some.integers(0, 9))
def test_pairs_and_sides_are_even_over_the_sheets_and_sides_on_each(groups, share, seed):
    pairs = pairs_of(entries(groups), seed)
    shown = {(pair.first, pair.second) for pair in pairs}
    assert len(shown) == len(pairs) == sum(len(list(combinations(group, 2))) for group in groups)
    sheets = sheets_of(pairs, max(1, round(share * len(pairs))))
    sides = Counter(place for sheet in sheets for place in sheet)
    assert len(sides) == 2 * len(pairs) and len(set(sides.values())) == 1
    for sheet in sheets:
        assert len({pair for pair, _ in sheet}) == len(sheet)
        leaning = Counter()
        for number, swapped in sheet:
            left, right = pairs[number].methods[::-1 if swapped else 1]
            leaning[left] += 1
            leaning[right] -= 1
        assert max(map(abs, leaning.values())) <= 1


@settings(max_examples=40, deadline=None)
@given(methods=some.integers(2, 5), groups=some.integers(1, 6), share=some.floats(0, 1))
def test_each_person_sees_the_pairs_of_methods_equally_often(methods, groups, share):
    pairs = pairs_of(entries([range(methods)] * groups))
    for sheet in sheets_of(pairs, max(1, round(share * len(pairs)))):
        seen = Counter({pair.methods: 0 for pair in pairs})
        seen.update(pairs[number].methods for number, _ in sheet)
        assert max(seen.values()) - min(seen.values()) <= 1


def test_sheets_come_in_mirrored_couples():
    sheets = sheets_of(pairs_of(entries([range(3)] * 2)), 4)
    for one, two in zip(sheets[::2], sheets[1::2]):
        assert two == tuple((pair, not swapped) for pair, swapped in one)


@pytest.mark.parametrize("count", [-1, 4])
def test_more_pairs_than_there_are(count):
    with pytest.raises(UserError, match="1 to 3"):
        sheets_of(pairs_of(entries([range(3)])), count)
