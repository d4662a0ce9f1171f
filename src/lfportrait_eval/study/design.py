"""A study: its questions, the portraits that are compared, each person's pairs and sides, its page.

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

import hashlib
import html
import io
import json
import math
import re
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib import resources
from itertools import combinations, zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from lfportrait.arrays import UInt8
from lfportrait.color import to_uint8
from lfportrait.errors import UserError
from lfportrait.files import atomic_write, read_json, script_json, script_streams, write_json
from lfportrait.media.pictures import read_image
from lfportrait.progress import Progress
from lfportrait.share import write_video
from lfportrait.temporary import temporary_folder
from lfportrait.version import __version__


@dataclass(frozen=True)
class Question:
    """One question about a pair of portraits."""

    name: str  # Short name, in files and tables.
    text: str  # What people read; the answer is the left or the right portrait.


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
    """The questions of ``"all"``, ``"paper"`` or a text file.

    It has one ``name: text`` a line; ``#`` begins a comment.
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
    """One portrait of the study."""

    # method, sitter, style: Who painted whom, and how.
    method: str
    sitter: str
    style: str
    video: Path  # The portrait as it turns.
    # painting, photo: The exemplar and the sitter, uint8 [H, W, 3]; the photo is None where there
    # is none.
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
    return to_uint8(capture.image_float(view))


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
    """Find the portraits that are compared, in order of sitter, style and method.

    Those of one sitter and style have the same painting and photo.

    Parameters
    ----------
    jobs : Folders that `lfportrait make` or `demo` wrote, and videos; ``METHOD=PATH`` or
        ``METHOD:SITTER:STYLE=PATH`` says what a portrait is called.
    pictures : Paintings and photos, by the names of styles and sitters.
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
    """Two portraits that are compared."""

    # first, second: Numbers of the entries; the first is the left one unless sides are swapped.
    first: int
    second: int
    methods: tuple[str, str]  # Their methods.


Sheet = tuple[tuple[int, bool], ...]
"""What one person sees: numbers of pairs, and whether their sides are swapped."""


def pairs_of(entries: Sequence[Entry], seed: int = 0) -> list[Pair]:
    """All pairs of methods of each sitter and style, pairs of methods taking turns.

    In an order of which any stretch has the pairs of methods equally often, up to one, if each
    sitter and style has all methods; ``seed`` is that of sitters and styles.
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
    """The sheets of a study with so many pairs (0 for all) a person.

    Sheet ``2 k + 1`` is sheet ``2 k`` with all sides swapped.
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
            sheets.append(tuple((number, side != mirrored) for number, side in zip(shown, sides)))
    return sheets


_SCRIPTS = ("schedule", "session", "player", "screens", "main")


def _text(name: str) -> str:
    return (resources.files(__package__) / "web" / name).read_text(encoding="utf-8")


def study_script() -> str:
    """The page's script: its files, joined into one function of its own."""
    return '(() => {\n"use strict";\n' + "\n".join(_text(f"{name}.js") for name in _SCRIPTS) + (
        "})();\n")


def _clips(entries: Sequence[Entry], progress: Progress | None) -> list[Clip]:
    """The entries' videos; those that are compared should look alike but for the method."""
    clips = []
    for number, entry in enumerate(entries):
        if progress is not None:
            progress.update(number, f"videos: {entry.method}")
        clips.append(clip_of(entry.video))
    groups: dict[tuple[str, str], list[Clip]] = {}
    for entry, clip in zip(entries, clips):
        groups.setdefault(entry.group, []).append(clip)
    for (sitter, style), members in groups.items():
        if len({clip.size for clip in members}) > 1:
            sizes = sorted({f"{clip.size[0]}x{clip.size[1]}" for clip in members})
            warnings.warn(f"the videos of {sitter} in the style {style} differ in size "
                          f"({', '.join(sizes)}): people may see that instead of the method",
                          stacklevel=3)
        seconds = [clip.seconds for clip in members]
        if max(seconds) > 1.02 * min(seconds) + 0.05:
            warnings.warn(f"the videos of {sitter} in the style {style} last {min(seconds):.1f} to "
                          f"{max(seconds):.1f} s: they can't turn together", stacklevel=3)
    return clips


def _pictures(entries: Sequence[Entry]) -> tuple[dict[str, bytes], dict[tuple[str, str],
                                                                       tuple[str, str]]]:
    """Pictures by a name that is a hash, and the names of each group's painting and photo."""
    pictures: dict[str, bytes] = {}
    names: dict[tuple[str, str], tuple[str, str]] = {}
    for entry in entries:
        if entry.group in names:
            continue
        pair = []
        for image in (entry.painting, entry.photo):
            data = b"" if image is None else picture_bytes(image)
            name = hashlib.sha256(data).hexdigest()[:12] if data else ""
            if data:
                pictures[name] = data
            pair.append(name)
        names[entry.group] = (pair[0], pair[1])
    return pictures, names


def _design(config: StudyConfig, questions: Sequence[Question], entries: Sequence[Entry],
            pairs: Sequence[Pair], sheets: Sequence[Sheet], digests: Sequence[str],
            seed: int) -> dict[str, Any]:
    """What ``study.json`` holds; its ``study`` is a hash of all the rest."""
    design: dict[str, Any] = {
        "format": "lfportrait study", "version": __version__, "title": config.title, "seed": seed,
        "questions": [asdict(question) for question in questions], "repeats": config.repeats,
        "entries": [{"method": entry.method, "sitter": entry.sitter, "style": entry.style,
                     "video": digest} for entry, digest in zip(entries, digests)],
        "pairs": [[pair.first, pair.second] for pair in pairs],
        "sheets": [[[number, int(side)] for number, side in sheet] for sheet in sheets]}
    text = json.dumps(design, sort_keys=True).encode()
    return {"study": hashlib.sha256(text).hexdigest()[:12], **design}


def write_study(jobs: Sequence[str], out: str | Path, config: StudyConfig | None = None, *,
                seed: int = 0, progress: Progress | None = None) -> dict[str, Any]:
    """Write the page of a user study of the portraits that `entries_of` finds.

    An older study in the folder is not overwritten: answers to it would be lost.

    Parameters
    ----------
    out : Folder for ``index.html`` (opens offline), ``study.json`` and, where the videos are large,
        ``media/``.
    config : Questions, pairs and looks.
    seed : Seed of the order in which pairs are dealt out.

    Returns
    -------
    figures : ``study`` (its name), ``methods``, ``groups`` of sitter and style, ``pairs``,
        ``pairs_per_person``, ``answers_per_person``, ``sheets``, ``bytes`` of the page and of the
        ``media`` beside it.
    """
    config, out = config or StudyConfig(), Path(out)
    questions = questions_of(config.questions)
    entries = entries_of(jobs, config.pictures)
    pairs = pairs_of(entries, seed)
    sheets = sheets_of(pairs, config.pairs_per_person)
    if not 0 <= config.repeats <= len(sheets[0]):
        raise UserError(f"--repeats must be 0 to {len(sheets[0])}, not {config.repeats}")
    clips = _clips(entries, progress)
    digests = [hashlib.sha256(clip.data).hexdigest() for clip in clips]
    design = _design(config, questions, entries, pairs, sheets, digests, seed)
    _look_for_another(out, design["study"])
    pictures, shown = _pictures(entries)
    # File names must not reveal the methods.
    names = [f"video{number}" for number in np.random.default_rng(seed).permutation(len(clips))]
    videos = {name: clip.data for name, clip in sorted(zip(names, clips), key=lambda item: item[0])}
    embedded = sum(map(len, videos.values())) <= config.max_embedded * 1e6
    media = {name: f"media/{name}.{clip.kind}" for name, clip in zip(names, clips)}
    data = {key: design[key] for key in ("study", "title", "questions", "repeats", "pairs",
                                         "sheets")}
    data["entries"] = [
        {"method": entry.method, "sitter": entry.sitter, "style": entry.style, "video": name,
         "kind": clip.kind, "file": "" if embedded else media[name],
         "painting": shown[entry.group][0], "photo": shown[entry.group][1]}
        for entry, name, clip in zip(entries, names, clips)]
    if not embedded:
        for name, clip in zip(names, clips):
            with atomic_write(out / media[name]) as stream:
                stream.write(clip.data)
    parts = {"title": html.escape(config.title), "style": _text("study.css"),
             "script": study_script(), "study": script_json(data),
             "streams": script_streams({**pictures, **(videos if embedded else {})})}
    # One pass: what is put in may itself hold such a mark.
    page = re.sub("@([a-z]+)@", lambda mark: parts[mark[1]], _text("study.html")).encode()
    with atomic_write(out / "index.html") as stream:
        stream.write(page)
    write_json(out / "study.json", design)
    return {"study": design["study"], "methods": sorted({entry.method for entry in entries}),
            "groups": len(shown), "pairs": len(pairs), "pairs_per_person": len(sheets[0]),
            "answers_per_person": len(questions) * (len(sheets[0]) + config.repeats),
            "sheets": len(sheets), "bytes": len(page),
            "media": 0 if embedded else sum(map(len, videos.values()))}


def _look_for_another(out: Path, study: str) -> None:
    """Raise `UserError` where a folder holds another study."""
    if not (out / "study.json").is_file():
        return
    before = read_json(out / "study.json")
    if not isinstance(before, dict) or before.get("study") != study:
        raise UserError(f"{out} holds another study, and answers to it would no longer fit; choose "
                        "another folder with --out, or remove it")


_BROWSERS = {("h264", "yuv420p"), ("h264", "yuvj420p"), ("vp8", "yuv420p"), ("vp9", "yuv420p"),
             ("av1", "yuv420p")}
"""Formats that all browsers decode; everything else is re-encoded."""


@dataclass(frozen=True)
class Clip:
    """A video for the page."""

    # data, kind: The file's bytes, and ``"mp4"`` or ``"webm"``.
    data: bytes
    kind: str
    seconds: float  # How long it lasts.
    size: tuple[int, int]  # Width and height in pixels.


def _frames(container: Any) -> Iterator[UInt8]:
    for frame in container.decode(video=0):
        yield frame.to_ndarray(format="rgb24")


def clip_of(path: Path) -> Clip:
    """Read a video; formats that browsers may not show are re-encoded as H.264."""
    import av

    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise UserError(f"{path} holds no video")
            stream = container.streams.video[0]
            if stream.codec_context is None:
                raise UserError(f"{path} holds a video of an unknown kind")
            rate = float(stream.average_rate or 30)
            known = (stream.codec_context.name.removeprefix("lib"),
                     str(stream.codec_context.pix_fmt))
            size = (stream.codec_context.width, stream.codec_context.height)
            kind = path.suffix.lower().removeprefix(".").replace("m4v", "mp4")
            if known in _BROWSERS and kind in ("mp4", "webm"):
                data, count = path.read_bytes(), stream.frames
                count = count or sum(1 for _ in container.decode(video=0))
            else:
                with temporary_folder() as folder:
                    fresh = folder / "video.mp4"
                    count = write_video(fresh, _frames(container), rate)
                    data, kind = fresh.read_bytes(), "mp4"
    except (av.FFmpegError, OSError, IndexError, ValueError) as error:
        raise UserError(f"can't read the video {path}: {error}") from error
    return Clip(data, kind, count / rate, size)


def picture_bytes(image: UInt8, longest: int = 640) -> bytes:
    """A picture uint8 [H, W, 3] as WebP, its longer side at most ``longest`` pixels."""
    picture = Image.fromarray(image)
    picture.thumbnail((longest, longest), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    picture.save(buffer, "WEBP", quality=88, method=6)
    return buffer.getvalue()
