"""Answer files read and checked, and analysed: preferences, ranking, agreement, attention.

Files that can't be used are reported, file by file. The statistics are those of choices between
two: intervals, tests, and how far people agree.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfportrait.arrays import Bool, Float64
from lfportrait.errors import UserError
from lfportrait.files import read_json

from .design import Question

_Z = 1.959963984540054


@dataclass(frozen=True)
class Share:
    """A share with its 95 % interval."""

    # count, total: How many of how many.
    count: int
    total: int
    # share, low, high: The share and the ends of its interval.
    share: float
    low: float
    high: float


def wilson(count: int, total: int, effective: float | None = None) -> Share:
    """The 95 % score interval of a share (Wilson 1927), without continuity correction.

    ``total``, at least 1, answers are worth ``effective`` independent ones; all by default.
    """
    n = float(total if effective is None else effective)
    share = count / total
    middle = (share + _Z ** 2 / (2 * n)) / (1 + _Z ** 2 / n)
    half = _Z / (1 + _Z ** 2 / n) * math.sqrt(share * (1 - share) / n + (_Z / (2 * n)) ** 2)
    return Share(count, total, share, max(0.0, middle - half), min(1.0, middle + half))


def effective_answers(counts: NDArray[np.integer]) -> float:
    """Effective number of independent answers, of [people, 2] of each kind, if each gave several.

    People have tastes: their answers are more alike than chance, and a share then varies more from
    study to study than Wilson's interval thinks. The number of answers is divided by how much more
    it varies (the design effect, here of a ratio over people; Korn & Graubard 1998); it is never
    more than the answers.
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
    from scipy.stats import binomtest  # takes most of a second to import

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
    share that are alike, less 1. Items of ``counts`` [items, 2] with fewer than two answers don't
    count; NaN if no item has two.
    """
    n = counts.sum(axis=1)
    couples = (n * (n - 1)).sum()
    return float(2 * (counts * (counts - 1)).sum() / couples - 1) if couples else float("nan")


def fleiss_kappa(counts: NDArray[np.integer]) -> float:
    """Agreement beyond chance of as many people on each item, [items, kinds] answers (Fleiss 1971).

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

    Items of ``counts`` [items, kinds] with fewer than two answers don't count; NaN if nothing can
    be compared, or all answers are of one kind.
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
    """Strengths of methods."""

    # strength, low, high: [methods] logarithms of p with mean 0, and the ends of their 95 %
    # intervals over people.
    strength: Float64
    low: Float64
    high: Float64
    # [methods] share of choices that a method would win against each of the others in turn.
    expected: Float64


def bradley_terry(wins: NDArray[np.floating], compared: Bool | None = None,
                  prior: float = 0.5, steps: int = 20000,
                  tolerance: float = 1e-9) -> Float64:
    """One scale for all methods, from choices between two: logarithms, with mean 0.

    Method i is preferred to method j with probability p_i / (p_i + p_j) (Bradley and Terry 1952).
    The strengths p are those of the highest likelihood, found by Hunter's MM algorithm (Annals of
    Statistics 32, 2004): p_i <- W_i / sum_j n_ij / (p_i + p_j). A method that was always preferred
    would have no finite strength; so each two methods that were compared are taken to have met once
    more, undecided. Raises `ValueError` if the methods fall into groups that have never met.

    Parameters
    ----------
    wins : [..., methods, methods] how often the row's method was preferred to the column's; the
        diagonal is 0.
    compared : [methods, methods] which are taken to have met once more, undecided; by default all
        that have met in any of ``wins``.
    prior : Wins that each of two that were compared gets on top; 0 for the plain model.
    steps, tolerance : Largest number of steps, and the change of a logarithm that ends them.
    """
    met: Bool = np.asarray(wins + np.swapaxes(wins, -1, -2) > 0)
    if compared is None:
        compared = np.logical_or.reduce(met.reshape(-1, *met.shape[-2:]), axis=0)
    from scipy.sparse.csgraph import connected_components

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

    ``wins`` [people, methods, methods] as for `bradley_terry`; people are drawn ``samples`` times.
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


@dataclass(frozen=True)
class Trial:
    """One pair as one person saw it."""

    # pair, sitter, style: Number of the pair in the study, and who is painted in it and how.
    pair: int
    sitter: str
    style: str
    # left, right: Methods by side.
    left: str
    right: str
    repeat: bool  # Whether the pair came for the second time.
    choices: dict[str, str]  # Question -> ``"left"`` or ``"right"``.
    seconds: dict[str, float]  # Question -> time that the answer took.

    def winner(self, question: str) -> str:
        """The method that was preferred."""
        return self.left if self.choices[question] == "left" else self.right


@dataclass(frozen=True)
class Answers:
    """All answers of one person."""

    file: Path  # Where they come from.
    # study, person: Names of the study and of the person.
    study: str
    person: str
    questions: tuple[Question, ...]  # What was asked.
    trials: tuple[Trial, ...]  # In the order in which they were shown.


def _need(right: bool, wrong: str) -> None:
    if not right:
        raise UserError(wrong)


def _trial(data: Any, questions: Sequence[Question], number: int) -> Trial:
    words = ("sitter", "style", "left", "right")
    _need(isinstance(data, dict) and isinstance(data.get("pair"), int)
          and all(isinstance(data.get(word), str) for word in words)
          and isinstance(data.get("choices"), dict), f"its pair {number} is damaged")
    missing = [question.name for question in questions
               if data["choices"].get(question.name) not in ("left", "right")]
    _need(not missing, f"its pair {number} has no answer to {', '.join(missing)}")
    seconds = data.get("seconds")
    times = {name: float(value) for name, value in (seconds if isinstance(seconds, dict)
                                                    else {}).items()
             if isinstance(value, (int, float))}
    return Trial(data["pair"], data["sitter"], data["style"], data["left"], data["right"],
                 data.get("repeat") is True,
                 {question.name: data["choices"][question.name] for question in questions}, times)


def _one(file: Path) -> Answers:
    """One file; `UserError` says what is wrong with it, without its name."""
    try:
        data = read_json(file)
    except UserError as error:
        raise UserError(str(error).removeprefix(f"{file} ")) from error
    _need(isinstance(data, dict) and data.get("format") == "lfportrait study answers",
          "it holds no answers to a study")
    asked = data.get("questions")
    _need(isinstance(data.get("study"), str) and isinstance(data.get("person"), str)
          and isinstance(asked, list) and bool(asked) and isinstance(data.get("trials"), list)
          and all(isinstance(each, dict) and isinstance(each.get("name"), str) for each in asked),
          "it is damaged")
    questions = tuple(Question(each["name"], str(each.get("text", ""))) for each in asked)
    _need(bool(data["trials"]), "it holds no answers")
    trials = tuple(_trial(each, questions, number) for number, each in enumerate(data["trials"], 1))
    _need(not all(trial.repeat for trial in trials), "it holds repeated answers alone")
    return Answers(file, data["study"], data["person"], questions, trials)


def _fits(answers: Answers, design: dict[str, Any]) -> None:
    """Raise `UserError` where answers don't fit the study's design."""
    names = [question["name"] for question in design["questions"]]
    _need([question.name for question in answers.questions] == names,
          f"it answers other questions than {', '.join(names)}")
    wanted = len(design["sheets"][0]) + int(design["repeats"])
    _need(len(answers.trials) == wanted, f"it has {len(answers.trials)} pairs instead of {wanted}")
    for number, trial in enumerate(answers.trials, 1):
        right = 0 <= trial.pair < len(design["pairs"])
        if right:
            entries = [design["entries"][place] for place in design["pairs"][trial.pair]]
            right = ({trial.left, trial.right} == {entry["method"] for entry in entries}
                     and (trial.sitter, trial.style) == (entries[0]["sitter"],
                                                         entries[0]["style"]))
        _need(right, f"its pair {number} is not one of the study")


def _design(path: Path) -> dict[str, Any]:
    """The study's design, from its file or folder."""
    path = path / "study.json" if path.is_dir() else path
    design = read_json(path)
    if not isinstance(design, dict) or design.get("format") != "lfportrait study":
        raise UserError(f"{path} is not the study.json that `lfportrait study` wrote")
    if not _is_whole(design):
        raise UserError(f"{path} is damaged; write the study again")
    return design


def _is_whole(design: dict[str, Any]) -> bool:
    """Whether all that answers are compared with is there and refers to what exists."""
    entries, sheets = design.get("entries"), design.get("sheets")
    return (isinstance(design.get("study"), str) and isinstance(design.get("repeats"), int)
            and _all(design.get("questions"), lambda one: isinstance(one["name"], str))
            and _all(entries, lambda one: all(isinstance(one[key], str)
                                              for key in ("sitter", "style", "method")))
            and _all(design.get("pairs"), lambda pair: len(pair) == 2 and all(
                isinstance(place, int) and 0 <= place < len(entries or ()) for place in pair))
            and _all(sheets, lambda sheet: isinstance(sheet, list)))


def _all(values: Any, right: Callable[[Any], bool]) -> bool:
    """Whether a document's part is a list that is not empty and whose entries are all right."""
    try:
        return isinstance(values, list) and bool(values) and all(map(right, values))
    except (KeyError, TypeError, IndexError):
        return False


def read_answers(files: Sequence[Path], study: Path | None = None,
                 ) -> tuple[list[Answers], list[tuple[Path, str]]]:
    """The answers to one study that can be used, and files with the reason why they can't.

    They are checked against a study's ``study.json``, or its folder; without it, the study that
    most of the files answer counts.
    """
    design = None if study is None else _design(study)
    read: list[Answers] = []
    left_out: list[tuple[Path, str]] = []
    for file in files:
        try:
            read.append(_one(file))
        except UserError as error:
            left_out.append((file, str(error)))
    name = design["study"] if design else ""
    if read and not design:
        name = Counter(answers.study for answers in read).most_common(1)[0][0]
    good: dict[str, Answers] = {}
    for answers in read:
        try:
            _need(answers.study == name, f"it answers another study, {answers.study} instead of "
                                         f"{name}")
            if design:
                _fits(answers, design)
            first = good.get(answers.person)
            _need(first is None, f"person {answers.person} is in "
                                 f"{first.file if first else ''} already")
        except UserError as error:
            left_out.append((answers.file, str(error)))
        else:
            good[answers.person] = answers
    if not good:
        result = "; ".join(f"{file}: {why}" for file, why in left_out[:3])
        more = f" (and {len(left_out) - 3} more)" if len(left_out) > 3 else ""
        raise UserError(f"no answers can be used: {result}{more}" if left_out else
                        "name the files of answers: lfportrait study results answers/*.json")
    return list(good.values()), left_out


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
    """All figures of a study, by the answers of different people.

    ``study``, ``people``, ``answers``, ``questions``, ``methods``; ``preferences`` for each
    question and two methods (the share of the first with its Wilson interval, by the number of
    ``effective`` answers, and by all as ``wilson_low`` and ``wilson_high``; for how many people it
    was the one they chose more often, the sign test's ``p`` of that and ``p_holm``, corrected for
    the number of tests); ``ranking`` by question (None if some methods have never met);
    ``agreement``, ``self_agreement`` and ``left`` by question (the latter two alone count pairs
    that came again); ``not_compared``, methods that no pair shows; ``seconds_per_answer``, the
    median.
    """
    shown = [(answers, trial) for answers in people for trial in answers.trials if not trial.repeat]
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
