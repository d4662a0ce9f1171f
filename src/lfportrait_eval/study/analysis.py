"""Analyse a study's answers: preferences, ranking, agreement, attention."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict
from itertools import combinations
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .answers import Answers, Trial
from .statistics import (
    effective_answers,
    fleiss_kappa,
    holm,
    kendall_agreement,
    krippendorff_alpha,
    rank,
    sign_test,
    wilson,
)

__all__ = ["analyse"]

Shown = list[tuple[Answers, Trial]]


def _share(count: int, total: int) -> dict[str, Any]:
    """A share and its interval, None where there is nothing to count."""
    if not total:
        return {"count": 0, "total": 0, "share": None, "low": None, "high": None}
    return asdict(wilson(count, total))


def _share_of_people(counts: NDArray[np.integer]) -> dict[str, Any]:
    """The share of the first kind in [people, 2] answers; its interval knows of people's tastes."""
    effective = effective_answers(counts)
    return {**asdict(wilson(int(counts[:, 0].sum()), int(counts.sum()), effective)),
            "effective": round(effective, 1)}


def _preferences(shown: Shown, questions: Sequence[str]) -> list[dict[str, Any]]:
    """Each question and pair of methods: the preferred one first."""
    rows: list[dict[str, Any]] = []
    for question in questions:
        votes: dict[tuple[str, str], dict[str, list[int]]] = defaultdict(
            lambda: defaultdict(lambda: [0, 0]))
        for answers, trial in shown:
            first, second = sorted((trial.left, trial.right))
            votes[first, second][answers.person][trial.winner(question) == second] += 1
        for (first, second), by_person in sorted(votes.items()):
            counts = np.array(list(by_person.values()))
            won = int(counts[:, 0].sum())
            if 2 * won < counts.sum():
                first, second, counts = second, first, counts[:, ::-1]
            plus = int((counts[:, 0] > counts[:, 1]).sum())
            minus = int((counts[:, 0] < counts[:, 1]).sum())
            plain = _share(int(counts[:, 0].sum()), int(counts.sum()))
            rows.append({"question": question, "first": first, "second": second,
                         **_share_of_people(counts),
                         "wilson_low": plain["low"], "wilson_high": plain["high"],
                         "people_for": plus, "people_against": minus,
                         "people_undecided": len(counts) - plus - minus,
                         "p": sign_test(plus, minus)})
    for row, corrected in zip(rows, holm([row["p"] for row in rows])):
        row["p_holm"] = corrected
    return rows


def _ranking(shown: Shown, question: str, methods: Sequence[str], people: Sequence[str],
             seed: int) -> list[dict[str, Any]] | None:
    """Strengths of the methods, best first; None if some have never met."""
    wins = np.zeros((len(people), len(methods), len(methods)))
    for answers, trial in shown:
        winner = trial.winner(question)
        loser = trial.right if winner == trial.left else trial.left
        wins[people.index(answers.person), methods.index(winner), methods.index(loser)] += 1
    try:
        found = rank(wins, seed=seed)
    except ValueError:
        return None
    won, met = wins.sum(axis=(0, 2)), wins.sum(axis=0) + wins.sum(axis=0).T
    rows = [{"question": question, "method": method, "strength": float(found.strength[place]),
             "low": float(found.low[place]), "high": float(found.high[place]),
             "expected_share": float(found.expected[place]), "wins": int(won[place]),
             "answers": int(met[place].sum())} for place, method in enumerate(methods)]
    return sorted(rows, key=lambda row: (-float(row["strength"]), row["method"]))


def _agreement(shown: Shown, question: str) -> dict[str, Any]:
    """How far different people prefer the same portrait of a pair."""
    counts: dict[int, list[int]] = defaultdict(lambda: [0, 0])
    for _, trial in shown:
        counts[trial.pair][trial.winner(question) != min(trial.left, trial.right)] += 1
    table = np.array(list(counts.values()))
    figures = {"kendall_u": kendall_agreement(table), "fleiss_kappa": fleiss_kappa(table),
               "krippendorff_alpha": krippendorff_alpha(table)}
    return {"question": question, "pairs": int((table.sum(axis=1) > 1).sum()),
            **{name: value if np.isfinite(value) else None for name, value in figures.items()}}


def _with_oneself(people: Sequence[Answers], question: str) -> dict[str, Any]:
    """How often somebody who saw a pair again, its sides swapped, chose the same portrait."""
    same = total = 0
    for answers in people:
        before = {trial.pair: trial.winner(question) for trial in answers.trials
                  if not trial.repeat}
        for trial in answers.trials:
            if trial.repeat and trial.pair in before:
                same += trial.winner(question) == before[trial.pair]
                total += 1
    return {"question": question, **_share(same, total)}


def _sides(people: Sequence[Answers], question: str) -> dict[str, Any]:
    """How often the left one was chosen."""
    sides = [[trial.choices[question] for trial in answers.trials] for answers in people]
    return {"question": question, **_share_of_people(np.array(
        [[each.count("left"), each.count("right")] for each in sides]))}


def analyse(people: Sequence[Answers], seed: int = 0) -> dict[str, Any]:
    """All figures of a study.

    Parameters
    ----------
    people
        Answers of different people to the same study. Pairs that came again count for
        ``self_agreement`` and ``left`` alone.
    seed
        Seed of the bootstrap.

    Returns
    -------
    figures
        ``study``, ``people``, ``answers``, ``questions``, ``methods``; ``preferences`` for each
        question and two methods (the share of the first with its Wilson interval, by the number of
        ``effective`` answers, and by all as ``wilson_low`` and ``wilson_high``; for how many
        people it was the one they chose more often, the sign test's ``p`` of that and ``p_holm``,
        corrected for the number of tests); ``ranking`` by question (None if some methods have never
        met); ``agreement``, ``self_agreement`` and ``left`` by question; ``not_compared``, methods
        that no pair shows; ``seconds_per_answer``, the median.
    """
    shown = [(answers, trial) for answers in people for trial in answers.trials
             if not trial.repeat]
    questions = people[0].questions
    names = [question.name for question in questions]
    methods = sorted({method for _, trial in shown for method in (trial.left, trial.right)})
    met = {frozenset((trial.left, trial.right)) for _, trial in shown}
    times = [seconds for answers in people for trial in answers.trials
             for seconds in trial.seconds.values()]
    persons = [answers.person for answers in people]
    return {
        "study": people[0].study, "people": len(people),
        "answers": sum(len(answers.trials) for answers in people) * len(names),
        "questions": [asdict(question) for question in questions], "methods": methods,
        "preferences": _preferences(shown, names),
        "ranking": {name: _ranking(shown, name, methods, persons, seed) for name in names},
        "agreement": [_agreement(shown, name) for name in names],
        "self_agreement": [_with_oneself(people, name) for name in names],
        "left": [_sides(people, name) for name in names],
        "not_compared": [list(pair) for pair in combinations(methods, 2)
                         if frozenset(pair) not in met],
        "seconds_per_answer": round(median(times), 2) if times else None}
