"""Statistics against published numbers, and a ranking of people made up for it."""

import numpy as np
import pytest

from lfportrait_eval.study import (
    bradley_terry,
    effective_answers,
    fleiss_kappa,
    holm,
    kendall_agreement,
    krippendorff_alpha,
    rank,
    sign_test,
    wilson,
)


@pytest.mark.parametrize("count, total, low, high", [
    (81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611),
    (1, 29, 0.0061, 0.1718)])
def test_wilson_as_in_newcombe_1998(count, total, low, high):
    share = wilson(count, total)
    assert (share.low, share.high) == pytest.approx((low, high), abs=5e-5)
    assert share.share == count / total


def test_answers_of_people_with_tastes_are_worth_less():
    alike = np.array([[4, 0], [0, 4]] * 10)  # each person always gives the same answer
    assert effective_answers(alike) == pytest.approx(20 * 19 / 20)
    assert effective_answers(np.array([[2, 2]] * 9)) == 36  # more even than chance: no reward
    assert effective_answers(np.array([[3, 0]] * 9)) == 27
    assert effective_answers(np.array([[3, 1]])) == 4
    worth = wilson(40, 80, effective_answers(alike))
    plain = wilson(40, 80)
    assert worth.share == plain.share
    assert worth.high - worth.low == pytest.approx(2 * (plain.high - plain.low), rel=0.06)


def test_intervals_hold_what_they_promise_where_people_differ():
    generator = np.random.default_rng(0)
    hits = plain_hits = 0
    for _ in range(400):
        tastes = 1 / (1 + np.exp(-generator.normal(0, 1.5, 50)))
        first = generator.binomial(4, tastes)
        counts = np.stack([first, 4 - first], axis=1)
        share = wilson(int(first.sum()), 200, effective_answers(counts))
        plain = wilson(int(first.sum()), 200)
        hits += share.low < 0.5 < share.high
        plain_hits += plain.low < 0.5 < plain.high
    assert 0.92 < hits / 400 < 0.98 and plain_hits / 400 < 0.86


def test_the_sign_test_counts_both_tails():
    assert sign_test(9, 1) == sign_test(1, 9) == pytest.approx(22 / 1024)
    assert sign_test(5, 5) == 1 and sign_test(0, 0) == 1


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0] and holm([]) == []


FLEISS = np.array([
    [0, 0, 0, 0, 14], [0, 2, 6, 4, 2], [0, 0, 3, 5, 6], [0, 3, 9, 2, 0], [2, 2, 8, 1, 1],
    [7, 7, 0, 0, 0], [3, 2, 6, 3, 0], [2, 5, 3, 2, 2], [6, 5, 2, 1, 0], [0, 2, 2, 3, 7]])
"""The worked example of most texts: 14 people, 10 items, 5 kinds; kappa is 0.210."""


def test_fleiss_kappa_of_the_worked_example():
    assert fleiss_kappa(FLEISS) == pytest.approx(0.210, abs=5e-4)
    assert np.isnan(fleiss_kappa(FLEISS + np.eye(10, 5, dtype=int)))  # not as many on each item
    assert np.isnan(fleiss_kappa(np.array([[3, 0], [3, 0]])))


def test_krippendorff_alpha_of_his_example():
    # "Computing Krippendorff's alpha-reliability", data with gaps, nominal: 0.743.
    people = ["1 2 3 3 2 1 4 1 2 . . .", "1 2 3 3 2 2 4 1 2 5 . 3",
              ". 3 3 3 2 3 4 2 2 5 1 .", "1 2 3 3 2 4 4 1 2 5 1 ."]
    items = list(zip(*(line.split() for line in people)))
    counts = np.array([[item.count(kind) for kind in "12345"] for item in items])
    assert krippendorff_alpha(counts) == pytest.approx(0.743, abs=5e-4)
    assert np.isnan(krippendorff_alpha(np.array([[2, 0], [1, 0]])))


def test_kendalls_agreement_has_its_known_ends():
    assert kendall_agreement(np.array([[4, 0], [0, 5]])) == 1
    # The smallest for an even number of people is -1 / (n - 1).
    assert kendall_agreement(np.array([[2, 2], [2, 2]])) == pytest.approx(-1 / 3)
    assert np.isnan(kendall_agreement(np.array([[1, 0]])))


BASEBALL = np.array([
    [0, 7, 9, 7, 7, 9, 11], [6, 0, 7, 5, 11, 9, 9], [4, 6, 0, 7, 7, 8, 12],
    [6, 8, 6, 0, 6, 7, 10], [6, 2, 6, 7, 0, 7, 12], [4, 4, 5, 6, 6, 0, 6], [2, 4, 1, 3, 1, 7, 0]])
"""Agresti, Categorical Data Analysis: wins of seven baseball teams against each other, 1987."""


def test_bradley_terry_as_in_agresti():
    strength = bradley_terry(BASEBALL, prior=0)
    assert strength - strength[-1] == pytest.approx(
        [1.58, 1.44, 1.29, 1.25, 1.11, 0.68, 0], abs=0.006)
    assert strength.mean() == pytest.approx(0, abs=1e-9)


def test_a_method_that_always_wins_has_a_finite_strength():
    strength = bradley_terry(np.array([[0.0, 20], [0, 0]]))
    assert strength[0] - strength[1] == pytest.approx(np.log(20.5 / 0.5), abs=1e-6)


def test_methods_that_never_met_are_not_ranked():
    wins = np.zeros((4, 4))
    wins[0, 1] = wins[2, 3] = 5
    with pytest.raises(ValueError, match="never compared"):
        bradley_terry(wins)


def test_strengths_of_made_up_people_are_found_and_lie_in_their_intervals():
    generator = np.random.default_rng(3)
    true = np.array([0.9, 0.2, -0.3, -0.8])
    chance = 1 / (1 + np.exp(true[None, :] - true[:, None]))
    upper = np.triu_indices(4, 1)
    wins = np.zeros((300, 4, 4))
    won = generator.random((300, len(upper[0]))) < chance[upper]
    wins[:, upper[0], upper[1]] = won
    wins[:, upper[1], upper[0]] = ~won
    found = rank(wins, samples=400)
    assert found.strength == pytest.approx(true, abs=0.15)
    assert ((found.low < true) & (true < found.high)).all()
    assert (found.high - found.low < 0.5).all()
    others = (chance.sum(axis=1) - 0.5) / 3
    assert found.expected == pytest.approx(others, abs=0.04)
    again = rank(wins, samples=400)
    assert np.array_equal(found.low, again.low)
