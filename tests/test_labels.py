"""One set of labels, and one grammar for what regions get."""

import pytest

from lfportrait.errors import UserError
from lfportrait.labels import (
    GROUPS,
    LABELS,
    MATERIALS,
    PICTURE_LABELS,
    SURFACE_LABELS,
    members,
    read_regions,
    read_value,
)


def test_coarser_sets_are_groupings_of_the_one():
    for known in (PICTURE_LABELS, SURFACE_LABELS, MATERIALS):
        parts = [part for name in known for part in GROUPS.get(name, (name,))]
        assert len(parts) == len({*parts}) and {*parts} <= {*LABELS}
    assert {*SURFACE_LABELS} == {*LABELS} - {"background"}


@pytest.mark.parametrize(("name", "known", "wanted"), [
    ("hair", SURFACE_LABELS, ("hair",)), ("body", SURFACE_LABELS, ("neck", "clothes")),
    ("body", PICTURE_LABELS, ("body",)), ("features", PICTURE_LABELS, LABELS[:4]),
    ("features", MATERIALS, ("features",))])
def test_groups_are_their_parts(name, known, wanted):
    assert members(name, known) == wanted


@pytest.mark.parametrize(("name", "known"), [("neck", PICTURE_LABELS), ("beard", LABELS),
                                             ("body", ("hair", "neck"))])
def test_what_is_not_there_is_one_line_with_what_is(name, known):
    with pytest.raises(UserError, match=f"no region '{name}' here; there are .*hair"):
        members(name, known)


@pytest.mark.parametrize(("text", "wanted"), [
    ("hair=other.png:0.5", ("hair", "other.png", 0.5)), ("lips=0.3", ("lips", "", 0.3)),
    ("body=off", ("body", "", 0.0)), ("skin=a:b.png", ("skin", "a:b.png", 1.0)),
    ("eyes=other.png", ("eyes", "other.png", 1.0)), ("hair=2.5", ("hair", "", 2.5))])
def test_values_are_read(text, wanted):
    (name, value), = read_regions([[text]]).items()
    choice = read_value(name, value)
    assert (choice.region, choice.style, choice.strength) == wanted


def test_the_last_word_on_a_region_counts_and_comes_last():
    found = read_regions([["hair=1", "lips=2"], ["hair=3"]])
    assert list(found.items()) == [("lips", "2"), ("hair", "3")]


@pytest.mark.parametrize(("name", "value", "styles"), [
    ("hair", "5", None), ("hair", "-1", None), ("hair", "ink:9", ("ink",)),
    ("hair", "oil", ("ink",)), ("hair", ("ink", 1, 2), ("ink",)), ("hair", "nan", None)])
def test_bad_values_are_one_line(name, value, styles):
    with pytest.raises(UserError):
        read_value(name, value, styles)
    with pytest.raises(UserError, match="write REGION="):
        read_regions([["hair"]])
