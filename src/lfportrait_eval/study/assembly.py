"""Write a study: the page with the questions, and its design."""

from __future__ import annotations

import base64
import hashlib
import html
import io
import json
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from lfportrait.arrays import UInt8
from lfportrait.errors import UserError
from lfportrait.files import atomic_write, read_json, write_json
from lfportrait.progress import Progress
from lfportrait.share import write_video
from lfportrait.temporary import temporary_folder
from lfportrait.version import __version__

from .design import (
    Entry,
    Pair,
    Question,
    Sheet,
    StudyConfig,
    entries_of,
    pairs_of,
    questions_of,
    sheets_of,
)

_SCRIPTS = ("schedule", "session", "player", "screens", "main")


def _text(name: str) -> str:
    return (resources.files(__package__) / "web" / name).read_text(encoding="utf-8")


def study_script() -> str:
    """The page's script: its files, joined into one function of its own."""
    return '(() => {\n"use strict";\n' + "\n".join(_text(f"{name}.js") for name in _SCRIPTS) + (
        "})();\n")


def _json(data: Any) -> str:
    """JSON that can stand in a script element: no ``</script>`` ends it early."""
    return json.dumps(data, separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c")


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


def _streams(files: dict[str, bytes]) -> str:
    return "\n".join(f'<script type="application/octet-stream" data-stream="{name}">'
                     f"{base64.b64encode(data).decode()}</script>"
                     for name, data in files.items())


def write_study(jobs: Sequence[str], out: str | Path, config: StudyConfig | None = None, *,
                seed: int = 0, progress: Progress | None = None) -> dict[str, Any]:
    """Write the page of a user study.

    Parameters
    ----------
    jobs
        What is compared: see `entries_of`.
    out
        Folder for ``index.html`` (opens offline), ``study.json`` and, where the videos are large,
        ``media/``.
    config
        Questions, pairs and looks.
    seed
        Seed of the order in which pairs are dealt out.
    progress
        Progress line.

    Returns
    -------
    figures
        ``study`` (its name), ``methods``, ``groups`` of sitter and style, ``pairs``,
        ``pairs_per_person``, ``answers_per_person``, ``sheets``, ``bytes`` of the page and of the
        ``media`` beside it.

    Raises
    ------
    UserError
        If an input can't be used, or the folder holds another study: answers to it would be lost.
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
             "script": study_script(), "study": _json(data),
             "streams": _streams({**pictures, **(videos if embedded else {})})}
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
    """A video for the page.

    Attributes
    ----------
    data, kind : The file's bytes, and ``"mp4"`` or ``"webm"``.
    seconds : How long it lasts.
    size : Width and height in pixels.
    """

    data: bytes
    kind: str
    seconds: float
    size: tuple[int, int]


def _frames(container: Any) -> Iterator[UInt8]:
    for frame in container.decode(video=0):
        yield frame.to_ndarray(format="rgb24")


def clip_of(path: Path) -> Clip:
    """Read a video; formats that browsers may not show are re-encoded as H.264.

    Raises
    ------
    UserError
        If it can't be read or has no pictures.
    """
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
    """A picture as WebP, its longer side at most ``longest`` pixels.

    Parameters
    ----------
    image : uint8 [H, W, 3].
    longest : Length in pixels.
    """
    picture = Image.fromarray(image)
    picture.thumbnail((longest, longest), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    picture.save(buffer, "WEBP", quality=88, method=6)
    return buffer.getvalue()
