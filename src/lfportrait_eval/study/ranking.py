"""One scale for all methods, from choices between two (Bradley and Terry 1952).

Method i is preferred to method j with probability p_i / (p_i + p_j). The strengths p are those of
the highest likelihood, found by Hunter's MM algorithm (Annals of Statistics 32, 2004):
p_i <- W_i / sum_j n_ij / (p_i + p_j). A method that was always preferred would have no finite
strength; so each two methods that were compared are taken to have met once more, undecided.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

__all__ = ["Ranking", "bradley_terry", "rank"]


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

    strength: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    expected: NDArray[np.float64]


def bradley_terry(wins: NDArray[np.floating], compared: NDArray[np.bool_] | None = None,
                  prior: float = 0.5, steps: int = 20000,
                  tolerance: float = 1e-9) -> NDArray[np.float64]:
    """Strengths of the highest likelihood.

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
    met: NDArray[np.bool_] = np.asarray(wins + np.swapaxes(wins, -1, -2) > 0)
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
