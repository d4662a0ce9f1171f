"""The contact sheet: each photo with its grade and reasons, and the arc that they cover.

The check itself (`lfportrait.job.check_photos`) runs in a process of its own, which writes
``.studio/check.json``; the cameras, once they are placed, are read from the capture.
"""

from __future__ import annotations

import hashlib
import itertools
import math
import os
import shutil
from pathlib import Path
from typing import Any

from PIL import Image

from ..errors import UserError
from ..files import read_json, write_image
from ..media.kinds import VIDEOS
from ..media.pictures import file_of, open_picture
from .answers import Refusal, free_name, id_of
from .projects import Project

__all__ = ["VIDEO_FRAME", "check_key", "find_photo", "leave_out", "one_kind", "photo_entry",
           "photo_picture", "remove_photo", "sheet"]

_SIDES = (240, 1280)
VIDEO_FRAME = "video.jpg"
"""Picture of a video among the small pictures: a frame of its middle."""
_FACTS = ("sharpness", "yaw", "pitch", "face", "brightness")


def find_photo(project: Project, photo: str) -> Path:
    """The file of a photo, by its id."""
    for path in (*project.files(), *project.files(project.left_out)):
        if id_of(path.name) == photo:
            return path
    raise Refusal("not_found", "there is no such photo any more")


def check_key(project: Project) -> str:
    """Changes whenever the photos that are used do."""
    states = [(path.name, path.stat().st_size, path.stat().st_mtime_ns)
              for path in project.files()]
    return hashlib.sha256(repr(states).encode()).hexdigest()[:16]


def _read(path: Path) -> dict[str, Any]:
    try:
        found = read_json(path)
    except UserError:
        return {}
    return found if isinstance(found, dict) else {}


def _placed(project: Project) -> dict[str, dict[str, float]] | None:
    """Where each photo was taken from, by its name without ending; None before it is known."""
    data = _read(project.job / "capture" / "transforms.json")
    found = {}
    try:
        for frame in data["frames"]:
            x, y, z = (float(row[3]) for row in frame["transform_matrix"][:3])
            distance = math.sqrt(x * x + y * y + z * z)
            found[Path(frame["file_path"]).stem] = {
                "yaw": math.degrees(math.atan2(x, z)), "distance": distance,
                "pitch": math.degrees(math.asin(max(-1.0, min(1.0, y / max(distance, 1e-9)))))}
    except (KeyError, TypeError, ValueError, IndexError):
        return None
    return found


def _grade(facts: dict[str, Any] | None, placed: dict[str, float] | None, known: bool,
           checked: bool) -> tuple[str, list[str]]:
    """Color of a photo's frame, and why."""
    reasons: list[str] = []
    grade = "none"
    if facts is None and checked:
        return "red", ["can't be read"]
    if facts is not None:
        wrong = [one for one in str(facts["wrong"]).split(", ") if one]
        reasons = wrong + [one for one in str(facts["fair"]).split(", ") if one]
        grade = "red" if wrong else "yellow" if reasons else "green"
    if known and placed is None:
        return "red", [*reasons, "not placed"]
    return grade, reasons


def photo_entry(project: Project, path: Path, check: dict[str, Any] | None = None,
                placed: dict[str, dict[str, float]] | None = None, checked: bool = False,
                ) -> dict[str, Any]:
    """A photo as the page sees it."""
    check = _read(project.own / "check.json") if check is None else check
    video, out = path.suffix.lower() in VIDEOS, path.parent == project.left_out
    facts = None if video else check.get("facts", {}).get(path.name)
    place = None if placed is None else placed.get(path.stem)
    grade, reasons = ("none", []) if video else _grade(
        facts, place, placed is not None and not out, checked and not out)
    state = path.stat()
    stamp = f"{state.st_size:x}{state.st_mtime_ns:x}"
    if video:
        frame = _frame(project, path)
        stamp += f"{frame.stat().st_mtime_ns:x}" if frame is not None else ""
    number = id_of(path.name)
    return {"id": number, "name": path.name, "size": state.st_size, "left_out": out,
            "video": video, "grade": "grey" if out else grade, "reasons": reasons,
            **{key: None if facts is None else facts.get(key) for key in _FACTS}, "placed": place,
            "picture": None if video and frame is None else
            f"/api/projects/{project.id}/photos/{number}/picture?v={stamp}"}


def sheet(project: Project) -> dict[str, Any]:
    """The whole contact sheet."""
    check = _read(project.own / "check.json")
    checked = bool(check) and check.get("key") == check_key(project)
    known = _placed(project) if checked else None
    # Cameras of other photos than these say nothing; those of a video are its frames'.
    names = {path.stem for path in project.files()}
    placed = known if known and len(names & known.keys()) >= 0.5 * len(known) else None
    photos = [photo_entry(project, path, check, placed, checked)
              for path in (*project.files(), *project.files(project.left_out))]
    return {"photos": sorted(photos, key=lambda one: one["name"]), "checked": checked,
            "checking": None, "arc": _arc(check if checked else {}, placed, photos),
            "advice": check.get("advice", []) if checked else [],
            "looked": len(check.get("facts", {})) if checked else 0,  # of a video its frames
            "faces": check.get("faces", 0), "useless": check.get("useless", 0)}


def _arc(check: dict[str, Any], placed: dict[str, dict[str, float]] | None,
         photos: list[dict[str, Any]]) -> dict[str, Any]:
    """The angles that the photos cover, and the gaps between them."""
    used = [one for one in photos if not one["left_out"] and one["grade"] != "red"]
    if placed:
        yaws = sorted(place["yaw"] for one in used if (place := one["placed"]) is not None)
    elif any(one["video"] for one in used):  # of its frames
        yaws = sorted(one["yaw"] for one in check.get("facts", {}).values()
                      if one["yaw"] is not None and not one["wrong"])
    else:
        yaws = sorted(one["yaw"] for one in used if one["yaw"] is not None)
    gaps = check.get("gaps", [])
    if placed:
        step = check.get("step", 14.0)
        gaps = [[a, b] for a, b in itertools.pairwise(yaws) if b - a > step]
    return {"gaps": gaps, "reach": [yaws[0], yaws[-1]] if yaws else None, "yaws": yaws,
            "placed": placed is not None}


def leave_out(project: Project, path: Path, out: bool) -> Path:
    """Leave a photo out, or take it in again; its new place."""
    if out == (path.parent == project.left_out):
        return path
    if project.calibrated:
        raise Refusal("exists", "these photos are a calibrated data set: none can be left out")
    if not out:
        one_kind(project, path.name)
    target = project.left_out if out else project.photos
    target.mkdir(exist_ok=True)
    place = target / free_name(path.name, [other.name for other in target.iterdir()])
    os.replace(path, place)
    return place


def remove_photo(project: Project, path: Path) -> None:
    """Move a photo into the project's trash."""
    if project.calibrated:
        raise Refusal("exists", "these photos are a calibrated data set: none can be removed")
    trash = project.own / "trash"
    trash.mkdir(parents=True, exist_ok=True)
    shutil.move(path, trash / free_name(path.name, [other.name for other in trash.iterdir()]))


def _frame(project: Project, video: Path) -> Path | None:
    """The picture of a video, made when it is checked; another one's is older than the video."""
    frame = project.own / "small" / VIDEO_FRAME
    if frame.is_file() and frame.stat().st_mtime >= video.stat().st_mtime:
        return frame
    return None


def one_kind(project: Project, name: str) -> None:
    """A project has photos, or one video: raise a `Refusal` where another file would be both."""
    kinds = [path.suffix.lower() in VIDEOS for path in project.files()]
    video = Path(name).suffix.lower() in VIDEOS
    if any(kinds) or (video and kinds):
        raise Refusal("exists", "a project has photos or one video, not both: remove what is "
                      "there, or make a new project", name=name)


def photo_picture(project: Project, path: Path, size: int) -> Path:
    """A small JPEG of a photo, made once.

    Raises
    ------
    Refusal
        If the photo can't be read, or is a video.
    """
    if size not in _SIDES:
        raise Refusal("bad_request", f"size must be one of {_SIDES}", field="size")
    state = path.stat()
    if path.suffix.lower() in VIDEOS:
        frame = _frame(project, path)
        if frame is None:
            raise Refusal("not_found", "a video has a picture once it is checked")
        return frame
    name = f"{id_of(path.name)}-{state.st_size:x}{state.st_mtime_ns:x}-{size}.jpg"
    target = project.own / "small" / name
    if not target.is_file():
        target.parent.mkdir(parents=True, exist_ok=True)
        small_picture(path, target, size)
    return target


def small_picture(path: Path, target: Path, size: int) -> None:
    """Write a picture's reduced copy, upright, as JPEG."""
    import numpy as np

    from ..media.colors import srgb

    try:
        with open_picture(path) as picture:
            picture.draft(None, (2 * size, 2 * size))
            upright = srgb(picture, file_of(picture))
            upright.thumbnail((size, size), Image.Resampling.LANCZOS)
            if upright.mode == "RGBA":
                upright = Image.alpha_composite(Image.new("RGBA", upright.size, "white"), upright)
            write_image(target, np.asarray(upright.convert("RGB")), quality=85)
    except (OSError, ValueError, SyntaxError, RuntimeError) as error:
        raise Refusal("user_error", f"{path.name} can't be read: it is damaged") from error
