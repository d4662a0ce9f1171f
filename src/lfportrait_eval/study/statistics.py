"""Statistics of choices between two: intervals, tests, and how far people agree."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.stats import binomtest, norm

from lfportrait.arrays import Bool, Float64

_Z = float(norm.ppf(0.975))


@dataclass(frozen=True)
class Share:
    """A share with its 95 % interval.

    Attributes
    ----------
    count, total
        How many of how many.
    share, low, high
        The share and the ends of its interval.
    """

    count: int
    total: int
    share: float
    low: float
    high: float


def wilson(count: int, total: int, effective: float | None = None) -> Share:
    """The 95 % score interval of a share (Wilson 1927), without continuity correction.

    Parameters
    ----------
    count, total
        How many of how many; ``total`` is at least 1.
    effective
        How many independent answers these are worth; ``total`` by default.
    """
    n = float(total if effective is None else effective)
    share = count / total
    middle = (share + _Z ** 2 / (2 * n)) / (1 + _Z ** 2 / n)
    half = _Z / (1 + _Z ** 2 / n) * math.sqrt(share * (1 - share) / n + (_Z / (2 * n)) ** 2)
    return Share(count, total, share, max(0.0, middle - half), min(1.0, middle + half))


def effective_answers(counts: NDArray[np.integer]) -> float:
    """Effective number of independent answers, if each person gave several.

    People have tastes: their answers are more alike than chance, and a share then varies more from
    study to study than Wilson's interval thinks. The number of answers is divided by how much more
    it varies (the design effect, here of a ratio over people; Korn & Graubard 1998).

    Parameters
    ----------
    counts
        [people, 2] answers of each kind.

    Returns
    -------
    number
        Never more than the answers.
    """
    each = counts.sum(axis=1)
    people, total = len(counts), int(each.sum())
    share = counts[:, 0].sum() / total
    if people < 2 or not 0 < share < 1:
        return float(total)
    variance = people / (people - 1) * ((counts[:, 0] - share * each) ** 2).sum() / total ** 2
    return float(total / max(1.0, variance * total / (share * (1 - share))))


def sign_test(plus: int, minus: int) -> float:
    """Two-sided p-value of the sign test; 1 without signs."""
    return float(binomtest(plus, plus + minus).pvalue) if plus + minus else 1.0


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values corrected for multiple tests (Holm 1979), in the same order."""
    adjusted = [1.0] * len(p_values)
    highest = 0.0
    for rank, place in enumerate(sorted(range(len(p_values)), key=lambda each: p_values[each])):
        highest = max(highest, min(1.0, (len(p_values) - rank) * p_values[place]))
        adjusted[place] = highest
    return adjusted


def kendall_agreement(counts: NDArray[np.integer]) -> float:
    """How far people agree, +1 for all alike, 0 for as by chance (Kendall & Babington Smith 1940).

    Their coefficient u: of all couples of answers to the same pair by different people, twice the
    share that are alike, less 1.

    Parameters
    ----------
    counts
        [items, 2] answers of each kind; items with fewer than two answers don't count.

    Returns
    -------
    u
        NaN if no item has two answers.
    """
    n = counts.sum(axis=1)
    couples = (n * (n - 1)).sum()
    return float(2 * (counts * (counts - 1)).sum() / couples - 1) if couples else float("nan")


def fleiss_kappa(counts: NDArray[np.integer]) -> float:
    """Agreement beyond chance of as many people on each item (Fleiss 1971).

    Parameters
    ----------
    counts
        [items, kinds] answers of each kind; each item has as many.

    Returns
    -------
    kappa
        NaN if the items have fewer than two answers, or not as many each, or all are of one kind.
    """
    people = counts.sum(axis=1)
    if not len(counts) or people.min() != people.max() or people[0] < 2:
        return float("nan")
    n = int(people[0])
    observed = ((counts * (counts - 1)).sum(axis=1) / (n * (n - 1))).mean()
    chance = ((counts.sum(axis=0) / counts.sum()) ** 2).sum()
    return float((observed - chance) / (1 - chance)) if chance < 1 else float("nan")


def krippendorff_alpha(counts: NDArray[np.integer]) -> float:
    """Agreement beyond chance where not everybody answers everything (Krippendorff, nominal).

    Parameters
    ----------
    counts
        [items, kinds] answers of each kind; items with fewer than two answers don't count.

    Returns
    -------
    alpha
        NaN if nothing can be compared, or all answers are of one kind.
    """
    counts = counts[counts.sum(axis=1) > 1]
    n = counts.sum(axis=1, keepdims=True)
    kinds = counts.sum(axis=0)
    total = int(kinds.sum())
    chance = total * total - (kinds ** 2).sum()
    if not chance:
        return float("nan")
    differing = ((n ** 2 - (counts ** 2).sum(axis=1, keepdims=True)) / (n - 1)).sum()
    return float(1 - (total - 1) * differing / chance)


@dataclass(frozen=True)
class Ranking:
    """Strengths of methods.

    Attributes
    ----------
    strength, low, high
        [methods] logarithms of p with mean 0, and the ends of their 95 % intervals over people.
    expected
        [methods] share of choices that a method would win against each of the others in turn.
    """

    strength: Float64
    low: Float64
    high: Float64
    expected: Float64


def bradley_terry(wins: NDArray[np.floating], compared: Bool | None = None,
                  prior: float = 0.5, steps: int = 20000,
                  tolerance: float = 1e-9) -> Float64:
    """One scale for all methods, from choices between two (Bradley and Terry 1952).

    Method i is preferred to method j with probability p_i / (p_i + p_j). The strengths p are those
    of the highest likelihood, found by Hunter's MM algorithm (Annals of Statistics 32, 2004):
    p_i <- W_i / sum_j n_ij / (p_i + p_j). A method that was always preferred would have no finite
    strength; so each two methods that were compared are taken to have met once more, undecided.

    Parameters
    ----------
    wins
        [..., methods, methods] how often the row's method was preferred to the column's; the
        diagonal is 0.
    compared
        [methods, methods] which are taken to have met once more, undecided; by default all that
        have met in any of ``wins``.
    prior
        Wins that each of two that were compared gets on top; 0 for the plain model, in which
        a method that always wins, or never does, has no finite strength.
    steps, tolerance
        Largest number of steps, and the change of a logarithm that ends them.

    Returns
    -------
    strength
        [..., methods] logarithms of p, with mean 0.

    Raises
    ------
    ValueError
        If the methods fall into groups that have never met.
    """
    met: Bool = np.asarray(wins + np.swapaxes(wins, -1, -2) > 0)
    if compared is None:
        compared = np.logical_or.reduce(met.reshape(-1, *met.shape[-2:]), axis=0)
    if connected_components(compared, directed=False, return_labels=False) > 1:
        raise ValueError("some methods were never compared, not even by way of others")
    more = prior * np.asarray(compared, float)
    games = wins + np.swapaxes(wins, -1, -2) + 2 * more
    total = (wins + more).sum(axis=-1)
    strength = np.zeros(total.shape)
    for _ in range(steps):
        p = np.exp(strength)
        fresh = np.log(total / (games / (p[..., :, None] + p[..., None, :])).sum(axis=-1))
        fresh -= fresh.mean(axis=-1, keepdims=True)
        change = np.abs(fresh - strength).max()
        strength = fresh
        if change < tolerance:
            break
    return strength


def rank(wins: NDArray[np.floating], samples: int = 2000, seed: int = 0) -> Ranking:
    """Strengths with intervals: people are resampled with all their answers (bootstrap).

    Parameters
    ----------
    wins
        [people, methods, methods] see `bradley_terry`.
    samples
        How often people are drawn.
    seed
        Seed of it.
    """
    people = len(wins)
    together = wins.sum(axis=0)
    strength = bradley_terry(together)
    drawn = np.random.default_rng(seed).multinomial(people, np.full(people, 1 / people), samples)
    each = bradley_terry(np.tensordot(drawn.astype(float), wins, 1),
                         together + together.T > 0, tolerance=1e-6)
    low, high = np.quantile(each, [0.025, 0.975], axis=0)
    beats = 1 / (1 + np.exp(strength[None, :] - strength[:, None]))
    others = max(len(strength) - 1, 1)
    return Ranking(strength, low, high, (beats.sum(axis=1) - 0.5) / others)
