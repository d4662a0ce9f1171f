"""Design of a study: its questions, the portraits that are compared, each person's pairs and sides.

Shen et al. 2023 (section 3, "User study") show the painting, the original portrait and two results
of different methods, and ask for the one "that better matches the style of the given style image":
one question, 50 people. It stands first here. What the style has to be paid with, the paper does
not ask; later studies of stylised scenes do, and the other two questions are theirs: structure and
quality.

A portrait comes from the folder of a job, whose record names method, style and sitter, or is a
video. A video lies in ``SITTER/STYLE/METHOD.mp4``, or is named on the command line.

A study has a number of sheets; a person gets one, by their number. What is random for a person is
the order (the page shuffles the sheet); what has to be even is laid down here, so that it is even
and not only so on average:

- Over all sheets each pair is shown equally often, and as often with its sides swapped: sheets come
  in couples that are mirror images of each other.
- On one sheet the pairs of methods occur equally often, up to one, if every sitter and style has
  every method.
- On one sheet each method stands as often on the left as on the right, up to one. For this, pairs
  are taken as the edges of a graph between methods, each edge is walked along once on closed walks,
  and what one comes from stands on the left: one leaves every place as often as one comes to it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from lfportrait.arrays import UInt8
from lfportrait.errors import UserError
from lfportrait.files import read_json
from lfportrait.media.pictures import read_image


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


_VIDEOS = {".mp4", ".m4v", ".mov", ".webm", ".mkv", ".avi", ".gif"}
_PICTURES = (".png", ".jpg", ".jpeg", ".webp")


@dataclass(frozen=True)
class Entry:
    """One portrait of the study.

    Attributes
    ----------
    method, sitter, style
        Who painted whom, and how.
    video
        The portrait as it turns.
    painting, photo
        The exemplar and the sitter, uint8 [H, W, 3]; the photo is None where there is none.
    """

    method: str
    sitter: str
    style: str
    video: Path
    painting: UInt8 | None = field(default=None, compare=False, repr=False)
    photo: UInt8 | None = field(default=None, compare=False, repr=False)

    @property
    def group(self) -> tuple[str, str]:
        """Sitter and style: entries of the same group are compared."""
        return self.sitter, self.style


def _on_white(image: UInt8) -> UInt8:
    if image.shape[2] == 3:
        return image
    alpha = image[..., 3:] / 255.0
    return np.asarray(image[..., :3] * alpha + 255.0 * (1.0 - alpha) + 0.5, np.uint8)


def _picture(folders: Iterable[Path], name: str) -> UInt8 | None:
    """The first picture of this name in some folders."""
    for folder in folders:
        for suffix in _PICTURES:
            if (folder / f"{name}{suffix}").is_file():
                return _on_white(read_image(folder / f"{name}{suffix}"))
    return None


def _frontal(job: Path) -> UInt8:
    """The job's photo that shows the face most from the front, on white."""
    from lfportrait.capture import Capture

    capture = Capture.load(job / "capture")
    eyes = capture.cameras.position
    view = int(np.argmin(np.abs(np.arctan2(eyes[:, 0], eyes[:, 2])) + np.abs(
        np.arctan2(eyes[:, 1], np.hypot(eyes[:, 0], eyes[:, 2])))))
    return np.asarray(np.clip(capture.image_float(view), 0, 1) * 255 + 0.5, np.uint8)


def _built_in(style: str) -> UInt8 | None:
    """The painting of a style that is installed."""
    from lfportrait.example import Exemplar
    from lfportrait.plugins import provided_styles

    return Exemplar.load(style).image if style in provided_styles() else None


def _of_job(job: Path) -> Entry:
    """The portrait that a job's folder holds."""
    if not (job / "run.json").is_file() or not (job / "sweep.mp4").is_file():
        raise UserError(f"{job} is not a finished job: it has no run.json and sweep.mp4; run "
                        "`lfportrait make` or `lfportrait demo` first, or name a video")
    run: Any = read_json(job / "run.json")
    stage = run.get("stylize") if isinstance(run, dict) else None
    if not isinstance(stage, dict) or not isinstance(run.get("style"), str):
        raise UserError(f"{job / 'run.json'} does not record the job's style; run the job again")
    record = job / ".stages" / "capture.json"
    # The same photos, read in the same way, have the same key.
    sitter = read_json(record)["key"] if record.is_file() else str(job.resolve())
    return Entry(str(stage.get("method", job.name)), sitter, run["style"], job / "sweep.mp4",
                 photo=_frontal(job))


def _of_video(video: Path) -> Entry:
    """A portrait by the place of its video: ``SITTER/STYLE/METHOD.mp4``."""
    if video.suffix.lower() not in _VIDEOS:
        raise UserError(f"{video} is neither a job's folder nor a video "
                        f"({', '.join(sorted(_VIDEOS))})")
    folder = video.resolve().parent
    return Entry(video.stem, folder.parent.name, folder.name, video,
                 _picture([folder], "painting"), _picture([folder, folder.parent], "photo"))


def _entry(word: str) -> Entry:
    """The portrait that one word of the command line names."""
    name, equals, path = word.partition("=")
    if not equals or Path(word).exists() or "/" in name:
        name, path = "", word
    place = Path(path)
    if not path or not place.exists():
        raise UserError(f"there is no folder or file {path or word}; name the folder of a job, or "
                        "a video")
    entry = _of_job(place) if place.is_dir() else _of_video(place)
    given = [part.strip() for part in name.split(":")] if name else []
    if len(given) > 3:
        raise UserError(f"{word}: write METHOD=PATH, or METHOD:SITTER:STYLE=PATH")
    method, sitter, style = (*given, *(entry.method, entry.sitter, entry.style)[len(given):])
    return replace(entry, method=method, sitter=sitter, style=style)


def _named(entries: Sequence[Entry]) -> list[Entry]:
    """Sitters that are known by a hash alone get a number."""
    names: dict[str, str] = {}
    for entry in entries:
        if re.fullmatch(r"[0-9a-f]{32}|/.*", entry.sitter):
            names.setdefault(entry.sitter, f"sitter {len(names) + 1}")
    return [replace(entry, sitter=names.get(entry.sitter, entry.sitter)) for entry in entries]


def entries_of(jobs: Sequence[str], pictures: Sequence[Path] = ()) -> list[Entry]:
    """Find the portraits that are compared.

    Parameters
    ----------
    jobs
        Folders that `lfportrait make` or `demo` wrote, and videos; ``METHOD=PATH`` or
        ``METHOD:SITTER:STYLE=PATH`` says what a portrait is called.
    pictures
        Paintings and photos, by the names of styles and sitters.

    Returns
    -------
    entries
        In order of sitter, style and method. Those of one sitter and style have the same painting
        and photo.

    Raises
    ------
    UserError
        If something is missing, a method occurs twice, or there is nothing to compare.
    """
    entries = _named([_entry(word) for word in jobs])
    extra = {path.stem: _on_white(read_image(path)) for path in pictures}
    groups: dict[tuple[str, str], list[Entry]] = {}
    for entry in entries:
        groups.setdefault(entry.group, []).append(entry)
    if all(len(members) < 2 for members in groups.values()):
        raise UserError("there is nothing to compare: no two portraits are of the same sitter in "
                        "the same style; say which are: METHOD:SITTER:STYLE=PATH")
    found = []
    for (sitter, style), members in sorted(groups.items()):
        methods = [entry.method for entry in members]
        twice = sorted({method for method in methods if methods.count(method) > 1})
        if twice:
            raise UserError(f"two portraits of {sitter} in the style {style} are by {twice[0]!r}; "
                            "say which is which: NAME=PATH")
        painting = extra.get(style)
        for entry in members:
            painting = entry.painting if painting is None else painting
        painting = _built_in(style) if painting is None else painting
        if painting is None:
            raise UserError(f"the painting {style!r} is not at hand; give it with --pictures "
                            f"{style}.png, or put it beside the videos as painting.png")
        photo = extra.get(sitter, next((entry.photo for entry in members
                                        if entry.photo is not None), None))
        found += [replace(entry, painting=painting, photo=photo)
                  for entry in sorted(members, key=lambda each: each.method)]
    return found


@dataclass(frozen=True)
class Pair:
    """Two portraits that are compared.

    Attributes
    ----------
    first, second
        Numbers of the entries; the first is the left one unless sides are swapped.
    methods
        Their methods.
    """

    first: int
    second: int
    methods: tuple[str, str]


Sheet = tuple[tuple[int, bool], ...]
"""What one person sees: numbers of pairs, and whether their sides are swapped."""


def pairs_of(entries: Sequence[Entry], seed: int = 0) -> list[Pair]:
    """All pairs of methods of each sitter and style, pairs of methods taking turns.

    Parameters
    ----------
    entries
        The portraits.
    seed
        Seed of the order of sitters and styles.

    Returns
    -------
    pairs
        In an order of which any stretch has the pairs of methods equally often, up to one, if each
        sitter and style has all methods.
    """
    generator = np.random.default_rng(seed)
    groups: dict[tuple[str, str], list[int]] = {}
    for number, entry in enumerate(entries):
        groups.setdefault(entry.group, []).append(number)
    by_methods: dict[tuple[str, str], list[Pair]] = {}
    for members in groups.values():
        for first, second in combinations(members, 2):
            methods = (entries[first].method, entries[second].method)
            by_methods.setdefault(methods, []).append(Pair(first, second, methods))
    columns = [[column[place] for place in generator.permutation(len(column))]
               for column in by_methods.values()]
    return [pair for row in zip_longest(*columns) for pair in row if pair is not None]


def _swapped(edges: Sequence[tuple[str, str]]) -> list[bool]:
    """Which edges are turned round so that each node has as many outgoing as incoming, up to one.

    Nodes of odd degree are joined to one more node; then every edge lies on a closed walk
    (Hierholzer).
    """
    ends: list[tuple[str | None, str]] = list(edges)
    degree: dict[str, int] = {}
    for one, two in edges:
        for node in (one, two):
            degree[node] = degree.get(node, 0) + 1
    ends += [(None, node) for node, count in degree.items() if count % 2]
    at: dict[str | None, list[int]] = {}
    for number, pair in enumerate(ends):
        for end in pair:
            at.setdefault(end, []).append(number)
    walked: dict[int, bool] = {}
    for start in at:
        here = start
        while True:
            while at[here] and at[here][-1] in walked:
                at[here].pop()
            if not at[here]:
                break  # only at the start: every other node that is entered can be left
            number = at[here].pop()
            left, right = ends[number]
            walked[number] = here != left
            here = right if here == left else left
    return [walked[number] for number in range(len(edges))]


def sheets_of(pairs: Sequence[Pair], pairs_per_person: int = 0) -> list[Sheet]:
    """The sheets of a study.

    Parameters
    ----------
    pairs
        Those of `pairs_of`.
    pairs_per_person
        Pairs on one sheet; 0 for all.

    Returns
    -------
    sheets
        Sheet ``2 k + 1`` is sheet ``2 k`` with all sides swapped.

    Raises
    ------
    UserError
        If there are fewer pairs than a person should see.
    """
    if not 0 <= pairs_per_person <= len(pairs):
        raise UserError(f"--pairs-per-person must be 1 to {len(pairs)}, the number of pairs, or 0 "
                        f"for all, not {pairs_per_person}")
    size = pairs_per_person or len(pairs)
    sheets: list[Sheet] = []
    for window in range(len(pairs) // math.gcd(size, len(pairs))):
        shown = [(window * size + place) % len(pairs) for place in range(size)]
        sides = _swapped([pairs[number].methods for number in shown])
        for mirrored in (False, True):
            sheets.append(tuple((number, side != mirrored)
                                for number, side in zip(shown, sides)))
    return sheets
