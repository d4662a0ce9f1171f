"""Guided patch synthesis: kernels against their plain forms, invariants, what comes of it."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from lfportrait.example import patches
from lfportrait.example.kernels.patches import (
    ACTIVE,
    BAND,
    CELL,
    CHANNELS,
    FIXED,
    FOREIGN,
    MARGIN,
    OUTSIDE,
    count_uses,
    patch_errors,
    search_pass,
    vote_patches,
)
from lfportrait.example.patches import (
    SCALE,
    GuideLevels,
    PatchSearch,
    PatchSource,
    PatchTarget,
    occupancy,
    start_levels,
    synthesise_patches,
)
from tests.example.owners import random_owners
from tests.reference import patches as plain

STATES = (OUTSIDE, FOREIGN, ACTIVE, FIXED)


def _problem(seed, height=26, width=22, rows=40, across=29):
    """Small whole numbers and quarters: their sums are exact in float32, so is the comparison."""
    random = np.random.default_rng(seed)
    source = random.integers(-20, 21, (rows, across, CHANNELS)).astype(np.float32)
    target = random.integers(
        -20, 21, (height + 2 * MARGIN, width + 2 * MARGIN, CHANNELS)).astype(np.float32)
    # Half of the target is a piece of the source, so that propagation has something to find.
    there = target[:rows - 2, :14]
    there[:] = source[2:2 + len(there), 5:19]
    shape = height, width
    state = random.choice(STATES, shape, p=[0.1, 0.1, 0.7, 0.1]).astype(np.uint8)
    trust = random.choice([0.25, 1, 2], (*shape, 2)).astype(np.float32)
    wanted = (random.integers(0, 2 * across, (*shape, 2)) / 2).astype(np.float32)
    weight = random.choice([0, 0.25, 2], shape).astype(np.float32)
    return plain.Problem(target, source, state, trust, wanted, weight, 90.25)


@pytest.mark.parametrize("margin", [0, MARGIN])
def test_colors_and_guides_lie_side_by_side_with_their_border_repeated(margin):
    random = np.random.default_rng(6)
    colors, planes = (random.normal(0, 90, (5, 7, n)).astype(np.float32) for n in (3, 4))
    bits = patches._interleaved((5, 7), margin, colors, planes)
    sides = (margin, margin), (margin, margin), (0, 0)
    whole = np.concatenate([colors, planes, np.zeros((5, 7, CHANNELS - 7))], axis=-1)
    expected = np.pad(whole, sides, mode="edge").astype(np.float32).astype(np.float16)
    np.testing.assert_array_equal(bits.view(np.float16)[:-16], expected.ravel())
    assert not bits[-16:].any()


def _places(problem, seed):
    """Places at which a patch fits, its border among them."""
    random = np.random.default_rng(seed)
    rows, across = problem.source.shape[:2]
    return (random.integers(MARGIN, rows - MARGIN, problem.state.shape) * across
            + random.integers(MARGIN, across - MARGIN, problem.state.shape)).astype(np.int32)


def _words(picture):
    """Float16 bits, with what a vector may read beyond the end."""
    rest = np.full(16, 7, np.float16)
    return np.concatenate([picture.astype(np.float16).ravel(), rest]).view(np.uint16)


def _arguments(problem):
    return (_words(problem.target), _words(problem.source), problem.source.shape[1],
            problem.state, problem.trust, problem.wanted, problem.weight,
            np.float32(problem.limit))


def _errors(problem, field, radius):
    error = np.full(field.shape, np.nan, np.float32)
    patch_errors(radius)(*_arguments(problem), field, error)
    return error


def _searched(problem, field, radius, reach, forward, seed, penalty=None, guided=None):
    """Field and error after one pass."""
    made, error = field.copy(), _errors(problem, field, radius)
    uses = occupancy(field, problem.source.shape[:2], problem.state)
    penalty = np.zeros_like(uses) if penalty is None else penalty
    guided = field if guided is None else guided
    search_pass(radius)(*_arguments(problem), uses, penalty, guided, field, made, error, reach,
                        forward, seed)
    return made, error


def _penalty(problem, seed, most):
    rows, across = (-(-n // CELL) for n in problem.source.shape[:2])
    return np.random.default_rng(seed).integers(0, most, (rows, across)).astype(np.float32)


@pytest.mark.parametrize("radius", [1, 2])
def test_the_error_is_the_weighted_difference_and_the_way_from_the_wanted_place(radius):
    problem = _problem(0)
    field = _places(problem, 1)
    assert np.array_equal(_errors(problem, field, radius), problem.errors(field, radius))
    untrusted = replace(problem, trust=np.zeros_like(problem.trust))
    assert np.allclose(_errors(untrusted, field, radius), untrusted.errors(field, radius), atol=0.1)


# Each radius, direction and height once.
@pytest.mark.parametrize(("radius", "forward", "height"), [
    (1, True, 26), (2, False, 26), (2, True, BAND + 5),
    *(pytest.param(*one, marks=pytest.mark.slow) for one in (
        (1, False, 26), (2, True, 26), (1, True, BAND + 5), (1, False, BAND + 5),
        (2, False, BAND + 5)))])
def test_search_equals_the_plain_form(radius, forward, height):
    problem = _problem(2, height=height)
    field, guided, penalty = _places(problem, 3), _places(problem, 4), _penalty(problem, 5, 300)
    made, error = _searched(problem, field, radius, 6, forward, 7, penalty, guided)
    wanted, errors = plain.search(problem, occupancy(field, problem.source.shape[:2],
                                                     problem.state), penalty, guided, field,
                                  radius, 6, forward, 7)
    assert np.array_equal(made, wanted)
    assert np.array_equal(error, errors)
    assert (made != field).mean() > 0.3


@pytest.mark.parametrize("radius", [1, 2])
def test_a_search_never_makes_matters_worse_and_leaves_what_is_not_its_own(radius):
    problem = _problem(6)
    field, penalty = _places(problem, 7), _penalty(problem, 8, 100)

    def dearness(places):
        # Whoever comes to a cell pays for those who are there: this sum falls with every move.
        uses = occupancy(places, problem.source.shape[:2], problem.state)
        active = problem.state == ACTIVE
        return (problem.errors(places, radius)[active].sum()
                + (penalty * uses * (uses + 1) / 2).sum())

    error = _errors(problem, field, radius)
    for turn in range(4):
        made, found = _searched(problem, field, radius, 16, turn % 2 == 0, turn, penalty)
        assert dearness(made) < dearness(field)
        assert np.array_equal(found, _errors(problem, made, radius))
        others = problem.state != ACTIVE
        assert np.array_equal(made[others], field[others])
        assert np.array_equal(found[others], error[others])
        rows, columns = made // problem.source.shape[1], made % problem.source.shape[1]
        for places, size in ((rows, 40), (columns, 29)):
            assert places.min() >= MARGIN and places.max() < size - MARGIN
        field, error = made, found


def test_without_a_penalty_no_patch_gets_worse():
    problem = _problem(9)
    field = _places(problem, 10)
    made, error = _searched(problem, field, 2, 16, True, 11)
    assert (error <= _errors(problem, field, 2)).all()
    assert (made != field).any()


def test_random_steps_find_better_patches_whatever_the_number_of_threads():
    # Four bands.
    problem = _problem(3, height=120, width=40, rows=130, across=50)
    field, penalty, results = _places(problem, 4), _penalty(problem, 5, 100), []
    problem = replace(problem, weight=np.zeros_like(problem.weight))
    threads = numba.get_num_threads()
    try:
        for count in (1, numba.config.NUMBA_NUM_THREADS):
            numba.set_num_threads(count)
            results.append(_searched(problem, field, 2, 16, True, 7, penalty))
    finally:
        numba.set_num_threads(threads)
    assert np.array_equal(results[0][0], results[1][0])
    assert np.array_equal(results[0][1], results[1][1])
    active = problem.state == ACTIVE
    assert results[0][1][active].mean() < 0.9 * _errors(problem, field, 2)[active].mean()


def test_a_crowd_is_dissolved_by_the_penalty():
    """All patches fit everywhere: with a penalty they spread, without one they stay."""
    shape = 40, 40
    crowd = np.full(shape, 24 * 48 + 24, np.int32)
    problem = plain.Problem(np.zeros((40 + 2 * MARGIN, 40 + 2 * MARGIN, CHANNELS)),
                            np.zeros((48, 48, CHANNELS)), np.full(shape, ACTIVE, np.uint8),
                            np.ones((*shape, 2), np.float32), np.zeros((*shape, 2), np.float32),
                            np.zeros(shape, np.float32), np.inf)
    most = {}
    for penalty in (0, 10):
        field = crowd
        for turn in range(6):
            field, _ = _searched(problem, field, 2, 16, turn % 2 == 0, turn,
                                 np.full((12, 12), penalty, np.float32), crowd)
        uses = occupancy(field, (48, 48))
        assert uses.sum() == 40 * 40 and uses.shape == (48 // CELL, 48 // CELL)
        most[penalty] = uses.max()
    assert most[0] == 40 * 40
    assert most[10] < 40


def test_uses_are_those_of_active_pixels():
    problem = _problem(12)
    field = _places(problem, 13)
    uses = np.full((10, 8), np.nan, np.float32)
    count_uses(field, problem.state, 29, uses)
    assert np.array_equal(uses, plain.uses(field, problem.state, (40, 29)))
    assert np.array_equal(uses, occupancy(field, (40, 29), problem.state))
    assert occupancy(field, (40, 29)).sum() == field.size


@pytest.mark.parametrize("radius", [1, 2])
def test_votes_equal_the_plain_form_and_change_active_pixels_only(radius):
    problem = _problem(14)
    field, random = _places(problem, 15), np.random.default_rng(16)
    picture = random.random((40, 29, 3)).astype(np.float32)
    error = (100 * random.random(field.shape)).astype(np.float32)
    before = random.random((*field.shape, 3)).astype(np.float32)
    out = before.copy()
    vote_patches(field, error, problem.state, picture, radius, np.float32(5), out)
    wanted = plain.vote(field, error, problem.state, picture, radius, 5, before)
    assert np.allclose(out, wanted, atol=1e-5)
    others = problem.state != ACTIVE
    assert np.array_equal(out[others], before[others])


def test_votes_from_beyond_the_exemplar_do_not_count():
    """Places nearer to the border than a patch's radius: their patches hang over."""
    random = np.random.default_rng(17)
    field = random.integers(0, 9 * 7, (6, 8)).astype(np.int32)
    picture = random.random((9, 7, 3)).astype(np.float32)
    state, error = np.full((6, 8), ACTIVE, np.uint8), np.zeros((6, 8), np.float32)
    out = np.empty((6, 8, 3), np.float32)
    vote_patches(field, error, state, picture, 2, np.float32(1), out)
    assert np.allclose(out, plain.vote(field, error, state, picture, 2, 1, out), atol=1e-5)


# -- synthesis ------------------------------------------------------------------------------------

CONFIG = PatchSearch(style_weight=0.3, uniformity=200.0, levels=3, votes=3, passes=2, reach=8)


def _exemplar(seed=0, height=64, width=56):
    """A picture of strokes and guides that tell its places apart."""
    random = np.random.default_rng(seed)
    picture = np.repeat(np.repeat(random.random((height // 4, width // 4, 3)), 4, 0), 4, 1)
    y, x = np.mgrid[:height, :width]
    guides = np.stack([20 * x, 20 * y, 60 * np.sin(x / 5), 60 * np.sin(y / 5)], axis=-1)
    return PatchSource.of(picture.astype(np.float32), (SCALE * guides).astype(np.float32))


def _shifted(source, top=8, left=6, height=46, width=40, seed=1):
    """A target that shows a part of the exemplar; the search begins anywhere."""
    random = np.random.default_rng(seed)
    guides = np.ascontiguousarray(source.guides[0][top:top + height, left:left + width])
    start = random.uniform(0, 1, (height, width, 2)) * source.guides[0].shape[1::-1]
    wanted = source.pictures[0][top:top + height, left:left + width]
    return PatchTarget(guides, start.astype(np.float32), start.astype(np.float32)), wanted


def test_guides_of_a_part_of_the_exemplar_give_that_part_back():
    source = _exemplar()
    target, wanted = _shifted(source)
    colors, places = synthesise_patches(target, source, CONFIG)
    assert colors.shape == (46, 40, 3) and places.shape == (46, 40)
    assert np.abs(colors - wanted).mean() < 0.02
    y, x = np.mgrid[:46, :40]
    assert (places == (y + 8) * 56 + x + 6).mean() > 0.9


def test_a_wanted_place_leads_where_guides_do_not():
    source = _exemplar()
    source.guides = [np.zeros_like(planes) for planes in source.guides]
    target, wanted = _shifted(source)
    y, x = np.mgrid[:46, :40]
    target.wanted = (np.stack([x + 6, y + 8], axis=-1) + np.float32(0.5)).astype(np.float32)
    target.start = target.guided = target.wanted
    target.weight = np.full((46, 40), 4000, np.float32)
    colors, _ = synthesise_patches(target, source, CONFIG)
    assert np.abs(colors - wanted).mean() < 0.02


def test_given_colors_stay_and_what_lies_outside_stays_empty():
    source = _exemplar()
    target, wanted = _shifted(source)
    random = np.random.default_rng(3)
    state = np.full(target.shape, ACTIVE, np.uint8)
    state[:, :12], state[40:] = FIXED, OUTSIDE
    given = random.random((*target.shape, 3)).astype(np.float32)
    given[state != FIXED] = 0
    target.state, target.colors = state, given
    colors, _ = synthesise_patches(target, source, CONFIG)
    assert np.array_equal(colors[state == FIXED], given[state == FIXED])
    assert not colors[state == OUTSIDE].any()
    inner = np.abs(colors - wanted)[4:36, 16:36]
    assert inner.mean() < 0.05


def test_copies_hold_their_owners_color_and_place():
    source = _exemplar()
    target, wanted = _shifted(source, height=48, width=40)
    # The right half shows what the left one owns, and has no guides of its own.
    y, x = np.mgrid[:48, :40]
    target.owner = (y * 40 + x % 20).astype(np.int32)
    target.state = np.where(x < 20, ACTIVE, FOREIGN).astype(np.uint8)
    target.guides = np.ascontiguousarray(target.guides[:, x[0] % 20])
    colors, places = synthesise_patches(target, source, CONFIG)
    assert np.array_equal(colors[:, 20:], colors[:, :20])
    assert np.array_equal(places[:, 20:], places[:, :20])
    begin = start_levels(target.start, source, CONFIG)
    levels = replace(target, guides=GuideLevels.of(target.guides, source, CONFIG), start=begin,
                     guided=begin)
    again = synthesise_patches(levels, source, CONFIG)
    assert np.array_equal(again[0], colors) and np.array_equal(again[1], places)
    assert np.abs(colors - wanted)[:, 2:18].mean() < 0.05


def test_the_same_seed_gives_the_same_bytes_whatever_the_number_of_threads():
    source = _exemplar()
    target, _ = _shifted(source, height=54, width=44)
    target.owner = random_owners(5, (54, 44))
    index = np.arange(target.owner.size).reshape(54, 44)
    target.state = np.select([target.owner < 0, target.owner == index], [OUTSIDE, ACTIVE],
                             FOREIGN).astype(np.uint8)
    config = replace(CONFIG, uniformity=4000.0)
    threads, made = numba.get_num_threads(), []
    try:
        for count, seed in ((1, 0), (numba.config.NUMBA_NUM_THREADS, 0), (1, 1)):
            numba.set_num_threads(count)
            made.append(synthesise_patches(target, source, config, seed))
    finally:
        numba.set_num_threads(threads)
    one, two, other = (colors.tobytes() + places.tobytes() for colors, places in made)
    assert one == two != other


def test_uniformity_spreads_patches_over_what_is_wanted():
    source = _exemplar()
    source.guides = [np.zeros_like(planes) for planes in source.guides]
    target = _shifted(source)[0]
    target.guides = np.zeros_like(target.guides)
    target.start = target.guided = np.full((*target.shape, 2), 30, np.float32)
    # Of the right half of the exemplar nothing is wanted.
    target.even = np.zeros((64, 56), np.float32)
    target.even[:, :28] = target.guides[..., 0].size / (64 * 28)
    used = {}
    for uniformity in (0.0, 15000.0):
        _, places = synthesise_patches(target, source, replace(CONFIG, uniformity=uniformity))
        uses = occupancy(places, (64, 56))
        used[uniformity] = (uses > 0).mean(), uses[:, :7].sum() / uses.sum()
    assert used[15000.0][0] > used[0.0][0]
    assert used[15000.0][1] > 0.55
