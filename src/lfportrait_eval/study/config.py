"""Parameters and questions of a user study.

Shen et al. 2023 (section 3, "User study") show the painting, the original portrait and two results
of different methods, and ask for the one "that better matches the style of the given style image":
one question, 50 people. It stands first here. What the style has to be paid with, the paper does
not ask; later studies of stylised scenes do, and the other two questions are theirs: structure and
quality.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from lfportrait.errors import UserError

__all__ = ["QUESTIONS", "Question", "StudyConfig", "questions_of"]


@dataclass(frozen=True)
class Question:
    """One question about a pair of portraits.

    Attributes
    ----------
    name
        Short name, in files and tables.
    text
        What people read; the answer is the left or the right portrait.
    """

    name: str
    text: str


QUESTIONS = (
    Question("style", "Which portrait better matches the style of the painting?"),
    Question("structure", "Which portrait better keeps the person: face, shape, expression?"),
    Question("quality", "Which portrait looks better as it turns, as a whole?"),
)
"""The paper's question, and two about what the style costs."""


@dataclass(frozen=True)
class StudyConfig:
    """Parameters of a user study."""

    title: str = "Portraits side by side"
    """Title of the page."""
    questions: str = "all"
    """Which questions: all (style, structure, quality), paper (style alone, as in Shen et al.), or
    a text file with one question a line, as `name: text`."""
    pairs_per_person: int = 0
    """Pairs per person, without the repeated ones; 0 = all. With fewer, each pair is still shown
    equally often overall."""
    repeats: int = 1
    """Pairs that are repeated at the end with swapped sides, to test each person's consistency."""
    max_embedded: float = 60.0
    """Embed the videos into the page up to this many MB (of 1,000,000 bytes); larger ones are
    written to a folder `media` beside it."""
    pictures: tuple[Path, ...] = ()
    """Paintings and photos of sitters that the jobs do not contain; name each file like its style
    or sitter."""


def questions_of(choice: str) -> tuple[Question, ...]:
    """The questions of a choice.

    Parameters
    ----------
    choice
        ``"all"``, ``"paper"`` or a text file, one ``name: text`` a line; ``#`` begins a comment.

    Raises
    ------
    UserError
        If the file is missing or a line is not a question.
    """
    if choice in ("all", "paper"):
        return QUESTIONS if choice == "all" else QUESTIONS[:1]
    try:
        lines = Path(choice).read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not a text file"
        raise UserError(f"can't read the questions {choice}: {why}; say all, paper, or name a text "
                        "file with one question a line") from error
    found: list[Question] = []
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        name, _, text = (part.strip() for part in line.partition(":"))
        if not re.fullmatch(r"[\w-]{1,32}", name) or not text:
            raise UserError(f"{choice}, line {number}: write a question as `name: text`, the name "
                            "of letters and digits")
        if name in (question.name for question in found):
            raise UserError(f"{choice}, line {number}: there is a question {name!r} already")
        found.append(Question(name, text))
    if not found:
        raise UserError(f"{choice} holds no question; write one a line, as `name: text`")
    return tuple(found)
