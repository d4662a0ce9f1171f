"""Read and check the answer files; report those that can't be used, file by file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lfportrait.errors import UserError
from lfportrait.files import read_json

from .config import Question

__all__ = ["Answers", "Trial", "read_answers"]


@dataclass(frozen=True)
class Trial:
    """One pair as one person saw it.

    Attributes
    ----------
    pair, sitter, style
        Number of the pair in the study, and who is painted in it and how.
    left, right
        Methods by side.
    repeat
        Whether the pair came for the second time.
    choices
        Question -> ``"left"`` or ``"right"``.
    seconds
        Question -> time that the answer took.
    """

    pair: int
    sitter: str
    style: str
    left: str
    right: str
    repeat: bool
    choices: dict[str, str]
    seconds: dict[str, float]

    def winner(self, question: str) -> str:
        """The method that was preferred."""
        return self.left if self.choices[question] == "left" else self.right


@dataclass(frozen=True)
class Answers:
    """All answers of one person.

    Attributes
    ----------
    file
        Where they come from.
    study, person
        Names of the study and of the person.
    questions
        What was asked.
    trials
        In the order in which they were shown.
    """

    file: Path
    study: str
    person: str
    questions: tuple[Question, ...]
    trials: tuple[Trial, ...]


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
    trials = tuple(_trial(each, questions, number)
                   for number, each in enumerate(data["trials"], 1))
    _need(not all(trial.repeat for trial in trials), "it holds repeated answers alone")
    return Answers(file, data["study"], data["person"], questions, trials)


def _fits(answers: Answers, design: dict[str, Any]) -> None:
    """Raise `UserError` where answers don't fit the study's design."""
    names = [question["name"] for question in design["questions"]]
    _need([question.name for question in answers.questions] == names,
          f"it answers other questions than {', '.join(names)}")
    wanted = len(design["sheets"][0]) + int(design["repeats"])
    _need(len(answers.trials) == wanted,
          f"it has {len(answers.trials)} pairs instead of {wanted}")
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
    """Read the answers to one study.

    Parameters
    ----------
    files
        Answer files.
    study
        The study's ``study.json``, or its folder, to check the answers against; without it, the
        study that most of the files answer counts.

    Returns
    -------
    answers, left_out
        What can be used, and files with the reason why they can't.

    Raises
    ------
    UserError
        If no file can be used; the reasons are in it.
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
