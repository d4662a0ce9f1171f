"""What a study compares: portraits by different methods, of the same sitter in the same style.

A portrait comes from the folder of a job, whose record names method, style and sitter, or is a
video. A video lies in ``SITTER/STYLE/METHOD.mp4``, or is named on the command line.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfportrait.errors import UserError
from lfportrait.files import read_json
from lfportrait.media.pictures import read_image

__all__ = ["Entry", "entries_of"]

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
    painting: NDArray[np.uint8] | None = field(default=None, compare=False, repr=False)
    photo: NDArray[np.uint8] | None = field(default=None, compare=False, repr=False)

    @property
    def group(self) -> tuple[str, str]:
        """Sitter and style: entries of the same group are compared."""
        return self.sitter, self.style


def _on_white(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if image.shape[2] == 3:
        return image
    alpha = image[..., 3:] / 255.0
    return np.asarray(image[..., :3] * alpha + 255.0 * (1.0 - alpha) + 0.5, np.uint8)


def _picture(folders: Iterable[Path], name: str) -> NDArray[np.uint8] | None:
    """The first picture of this name in some folders."""
    for folder in folders:
        for suffix in _PICTURES:
            if (folder / f"{name}{suffix}").is_file():
                return _on_white(read_image(folder / f"{name}{suffix}"))
    return None


def _frontal(job: Path) -> NDArray[np.uint8]:
    """The job's photo that shows the face most from the front, on white."""
    from lfportrait.capture import Capture

    capture = Capture.load(job / "capture")
    eyes = capture.cameras.position
    view = int(np.argmin(np.abs(np.arctan2(eyes[:, 0], eyes[:, 2])) + np.abs(
        np.arctan2(eyes[:, 1], np.hypot(eyes[:, 0], eyes[:, 2])))))
    return np.asarray(np.clip(capture.image_float(view), 0, 1) * 255 + 0.5, np.uint8)


def _built_in(style: str) -> NDArray[np.uint8] | None:
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
