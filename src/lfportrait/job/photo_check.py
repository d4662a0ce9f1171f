"""Look at photos before hours are spent on them, and say which to take again.

Each photo is looked at alone and beside its neighbours in the order of their names: how sharp it
is, whether a face shows and from which side, how bright and of what tint the face is. No cameras
are computed: the side follows from the landmarks of the face (`face_pose`).
"""

import functools
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from .. import capture, models
from ..arrays import Float64, UInt8
from ..capture import Photo
from ..color import linear_light
from ..face import (
    MOST_TURNED,
    PORTRAIT_CONE,
    detect_faces,
    detect_landmarks,
    face_pose,
    faces_of_people,
    person_matte,
)
from ..files import write_image
from ..progress import Progress, note
from .inspection import FolderFacts, inspect, left_out_lines, mixed_lines
from .made_from import head_way, reason_to_fit

_SIDE = 960
# Parts of the neighbours' fine detail below which a photo is blurred, or soft.
_BLURRED, _SOFT = 0.4, 0.6
# Brightness beside the neighbours', and tint, beyond which light or exposure changed; by eye on
# photos of a head at steps of exposure: from a third of a stop on it shows.
_BRIGHTER, _TINTED = 1.35, 1.12
_BURNT, _DARK = 0.06, 0.03
# Degrees between photos that leave no gap: half of it gives every part in three photos.
_STEP, _REACH, _WANTED = 14.0, 40.0, 20
# The face is at least this part of the picture's longer side.
_SMALL = 0.1
# Pixels on the shorter side (of the copy that is looked at) with which nothing can be matched.
_FEW_PIXELS, _TINY = 64, "too few pixels"


@dataclass
class PhotoFacts:
    """Results of the check for one photo."""

    name: str  # File name.
    sharpness: float = 1.0  # Fine detail beside that of its neighbours; 1 is usual.
    # yaw, pitch: Degrees from which the face is seen: 0 frontal, positive from its left side (to
    # the right in a frontal photo) and from above. None where no face shows.
    yaw: float | None = None
    pitch: float | None = None
    face: float | None = None  # Height of the face over the picture's longer side, or None.
    brightness: float = 0.0  # Mean of the face (else of the middle of the picture), linear, 0 to 1.
    # wrong, fair: What makes the photo useless, and what could be better; empty where nothing.
    wrong: str = ""
    fair: str = ""


@dataclass
class PhotoCheck:
    """Results of the check for all photos."""

    photos: list[PhotoFacts]  # One by one, in the order of their names.
    # Yaw angles (from, to) in degrees, within the arc, between which no photo was taken.
    gaps: list[tuple[float, float]] = field(default_factory=list)
    # Sentences: what to do. Empty where all is well.
    advice: list[str] = field(default_factory=list)
    # Small copies for a contact sheet, uint8 [H, W, 3 or 4].
    images: list[UInt8] = field(default_factory=list, repr=False)
    # What is left out of the folder and why, and in what its photos differ; no problem as such.
    notes: list[str] = field(default_factory=list)

    def figures(self) -> dict[str, Any]:
        """As JSON: ``photos``, ``gaps``, ``advice``, ``notes`` and counts."""
        return {"count": len(self.photos), "advice": self.advice, "gaps": self.gaps,
                "notes": self.notes,
                "faces": sum(one.yaw is not None for one in self.photos),
                "useless": sum(bool(one.wrong) for one in self.photos),
                "photos": [asdict(one) for one in self.photos]}


def _upright(points: Float64, size: tuple[int, int], turn: int) -> Float64:
    """Points [68, 2] of a picture of ``size`` turned counter-clockwise by quarter turns."""
    for _ in range(turn):
        points, size = np.stack([points[:, 1], size[0] - points[:, 0]], 1), size[::-1]
    return points


def _look(photo: Photo, faces: bool, turn: int) -> tuple[PhotoFacts, Float64, float]:
    """Facts of one photo alone, its mean color (linear, [3]) and the share that is burnt out."""
    image = np.ascontiguousarray(photo.image[..., :3])
    height, width = image.shape[:2]
    facts = PhotoFacts(photo.name, wrong=_TINY if min(height, width) < _FEW_PIXELS else "")
    seen = np.zeros((height, width), np.uint8)
    seen[height // 4:3 * height // 4 + 1, width // 4:3 * width // 4 + 1] = 1  # never empty
    points = detect_landmarks(image, turns=(turn,), thorough=False) if faces else None
    if points is not None:
        low, high = points.min(0), points.max(0)
        facts.face = float(max(high - low) / max(height, width))
        pose = face_pose(_upright(points, (width, height), turn))
        # A camera at the person's left sees the face turned to the picture's left.
        facts.yaw, facts.pitch = -pose.yaw, -pose.pitch
        # Not up to the outline: beside a turned face the room would count.
        inner = points.mean(0) + 0.8 * (points - points.mean(0))
        hull = np.asarray(cv2.convexHull(inner.astype(np.int32)))
        face = np.asarray(cv2.fillConvexPoly(np.zeros_like(seen), hull, 1.0), np.uint8)
        seen = face if face.any() else seen
    part = image[seen > 0]
    color = linear_light(part[::4] / 255.0).mean(0)
    facts.brightness = float(color.mean())
    return facts, color, float((part.min(-1) >= 254).mean())


def _beside(values: Float64, reach: int = 7) -> Float64:
    """Each value over the median of its neighbours'."""
    found = np.ones_like(values)
    for index in range(len(values)):
        near = np.r_[values[max(0, index - reach):index], values[index + 1:index + 1 + reach]]
        if len(near):
            found[index] = values[index] / max(float(np.median(near, axis=0)), 1e-6)
    return found


def _judge_few(photos: list[Photo], facts: list[PhotoFacts]) -> None:
    """Note what keeps a head from being fitted to the faces of a few photos."""
    for photo, one in zip(photos, facts):
        if one.wrong:
            continue
        picture = np.ascontiguousarray(photo.image[..., :3])
        others = detect_faces(picture, thorough=False)
        if len(others) > 1 and models.available("person-segmentation"):
            others = faces_of_people(others, person_matte(picture))
        if one.yaw is None:
            one.wrong = "no face"
        elif len(facts) == 1 and abs(one.yaw) > MOST_TURNED:
            one.wrong = "turned too far"
        elif sum(_width(face) > 0.4 * _width(others[0]) for face in others) > 1:
            one.wrong = "several faces"


def _width(face: Float64) -> float:
    """Distance of the jaw's ends."""
    return float(np.linalg.norm(face[16] - face[0]))


def _few_advice(facts: list[PhotoFacts]) -> list[str]:
    """What to do where there are only so many photos that a head may be fitted to the face."""
    found = []
    for word, what in (("no face", "A face can't be seen in {}: it must be upright and in focus, "
                        "and nothing before it."),
                       ("turned too far", "The face is turned too far in {}: by 35 degrees at "
                        "most, for a head from a single photo."),
                       ("several faces", "Several faces are in {}: crop it to the one that is "
                        "meant."),
                       ("blurred", "Take these again, they are blurred: {}.")):
        names = [one.name for one in facts if word in one.wrong.split(", ")]
        if names:
            found.append(what.format(_named(names)))
    for word, cure in (("dark", "more light"), ("burnt out", "less light or a shorter exposure"),
                       ("face small", "come closer: head and shoulders fill the picture")):
        count = sum(word in one.fair.split(", ") for one in facts)
        if count:
            found.append(f"{count} photos: {word}; {cure}.")
    return found


def _judge(facts: list[PhotoFacts], colors: Float64, burnt: list[float]) -> None:
    """Note what is wrong with each photo, or could be better."""
    brighter = _beside(colors.mean(1) + 1e-4)
    tint = np.maximum(*(np.abs(np.log(_beside((colors[:, c] + 1e-4) / (colors[:, 1] + 1e-4))))
                        for c in (0, 2)))
    for one, factor, change, share in zip(facts, brighter, tint, burnt):
        wrong, fair = [one.wrong] if one.wrong else [], []
        if one.sharpness < _BLURRED:
            wrong.append("blurred")
        elif one.sharpness < _SOFT:
            fair.append("soft")
        if one.brightness < _DARK:
            fair.append("dark")
        if share > _BURNT:
            fair.append("burnt out")
        if one.face is None:
            pass  # what the middle of the picture shows is not the same in all photos
        elif not 1 / _BRIGHTER < factor < _BRIGHTER:
            fair.append("brighter than its neighbours" if factor > 1
                        else "darker than its neighbours")
        elif change > np.log(_TINTED):
            fair.append("other colors than its neighbours")
        if one.face is not None and one.face < _SMALL:
            fair.append("face small")
        one.wrong, one.fair = ", ".join(wrong), ", ".join(fair)


def _gaps(facts: list[PhotoFacts]) -> list[tuple[float, float]]:
    """Where the arc has no photos, between those of use."""
    yaws = sorted(one.yaw for one in facts if one.yaw is not None and not one.wrong)
    return [(round(a, 1), round(b, 1)) for a, b in pairwise(yaws) if b - a > _STEP]


def _side(yaw: float) -> str:
    if abs(yaw) < 3:
        return "the front"
    return f"{abs(yaw):.0f} degrees to the {'right' if yaw > 0 else 'left'}"


def _named(names: list[str]) -> str:
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def _advice(facts: list[PhotoFacts], gaps: list[tuple[float, float]], faces: bool,
            lenses: int) -> list[str]:
    """What to do, the most important first."""
    found = []
    useful = [one for one in facts if not one.wrong]
    tiny = [one.name for one in facts if _TINY in one.wrong]
    bad = [one.name for one in facts if one.wrong and one.name not in tiny]
    if tiny:
        found.append(f"These have too few pixels: {_named(tiny)}. Take the photos as the camera "
                     "made them, not their small copies.")
    if bad:
        found.append(f"Take these again, they are blurred: {_named(bad)}. Use more light, or hold "
                     "the camera still for each photo.")
    if len(useful) < _WANTED:
        found.append(f"1 usable photo is too few; take 40, at least {_WANTED}."
                     if len(useful) == 1 else
                     f"{len(useful)} usable photos are too few; take 40, at least {_WANTED}.")
    yaws = [one.yaw for one in useful if one.yaw is not None]
    if faces and len(yaws) < 0.15 * len(facts):
        found.append("Hardly any photo shows a face: keep the head upright and unobstructed. "
                     "(Ignore this for an object without a face.)")
    elif yaws:
        for first, last in gaps:
            found.append(f"There are no photos between {_side(first)} and {_side(last)}; take "
                         f"{max(1, round((last - first) / 7) - 1)} photos there.")
        for reach, side in ((-min(yaws), "left"), (max(yaws), "right")):
            if reach < _REACH and all(one.yaw is not None for one in facts):
                found.append(f"The photos reach {max(reach, 0):.0f} degrees to the {side}; go on "
                             "to 60 or 90, or the portrait is incomplete there.")
    uneven = [one.name for one in facts if "neighbours" in one.fair]
    if len(uneven) > 0.1 * len(facts):
        found.append(f"Light or exposure changes ({_named(uneven)}): lock the exposure and the "
                     "white balance, avoid flash and changing sunlight.")
    for word, cure in (("dark", "more light"), ("burnt out", "less light or a shorter exposure"),
                       ("soft", "hold the camera still, focus on the eyes"),
                       ("face small", "come closer: head and shoulders fill the picture")):
        names = [one.name for one in facts if word in one.fair.split(", ")]
        if len(names) > 0.1 * len(facts):
            found.append(f"{len(names)} photos: {word}; {cure}.")
    if lenses > 1:
        found.append(f"The photos come from {lenses} lenses or zooms; use one.")
    return found


@functools.cache
def _can_see_faces() -> bool:
    return models.available("face-landmarker")


def check_photos(path: str | Path, progress: Progress | None = None) -> PhotoCheck:
    """Check a folder of photos, or a video; `UserError` if there is nothing that can be read."""
    path = Path(path)
    note(progress, "reading photos")
    photos = (capture.read_video(path, 60, _SIDE) if capture.is_video(path)
              else capture.read_photos(path, _SIDE))
    faces = _can_see_faces()
    if not faces:
        warnings.warn("faces are not detected: run `lfportrait models fetch face-landmarker` "
                      "first", stacklevel=2)
    looked = []
    for number, photo in enumerate(photos):
        if progress is not None:
            progress.update(number, photo.name)
        looked.append(_look(photo, faces, 0))
    unseen = [index for index, (one, _, _) in enumerate(looked) if one.yaw is None]
    if faces and len(unseen) > 0.5 * len(photos):
        # Pictures that lie on their side, from cameras that note nothing.
        for turn in (1, 3):
            sample = unseen[::max(1, len(unseen) // 8)]
            if any(_look(photos[index], True, turn)[0].yaw is not None for index in sample):
                for index in unseen:
                    turned = _look(photos[index], True, turn)
                    looked[index] = turned if turned[0].yaw is not None else looked[index]
    facts = [one for one, _, _ in looked]
    sharp = capture.relative_sharpness(
        np.array([capture.fineness(photo.image) for photo in photos]),
        [photo.image.shape[:2] for photo in photos])
    for one, value in zip(facts, sharp):
        one.sharpness = float(value)
    _judge(facts, np.array([color for _, color, _ in looked]), [share for _, _, share in looked])
    images = [photo.image for photo in photos]
    if faces and head_way(path, "auto") == "face":
        _judge_few(photos, facts)
        useful = sum(not one.wrong for one in facts)
        notes = [f"A head is fitted to the face; it can be looked at over {PORTRAIT_CONE:.0f} "
                 "degrees in all. 20 to 100 photos around the head show all of it."
                 ] if useful else []
        return PhotoCheck(facts, [], _few_advice(facts), images, [*notes, *_notes(path)])
    gaps = _gaps(facts)
    lenses = len({photo.lens for photo in photos})
    placed = capture.is_calibrated(path) or head_way(path, "auto") != "photos"
    reason = "" if placed else reason_to_fit(photos)
    notes = [f"A head will be fitted to the best of these pictures, as {reason}. For one that all "
             "of them show, hold still, do not talk, and let the camera go around the head."
             ] if reason else []
    return PhotoCheck(facts, gaps, _advice(facts, gaps, faces, lenses), images,
                      [*notes, *_notes(path)])


def _notes(path: Path) -> list[str]:
    """What is to be said of a folder besides its photos' quality; nothing of a video."""
    facts = inspect(path).facts
    if not isinstance(facts, FolderFacts):
        return []
    return [*(f"Left out: {line}." for line in left_out_lines(facts)),
            *(f"The photos differ in {line}." for line in mixed_lines(facts))]


def problem_sheet(path: Path, marks: dict[str, str], out: Path, frames: int = 80) -> None:
    """Write a contact sheet of photos or of a video's frames, marked with what is wrong."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # unreadable files were reported already
        photos = (capture.read_video(path, frames, 240) if capture.is_video(path)
                  else capture.read_photos(path, 240))
    write_image(out, contact_sheet([photo.image for photo in photos],
                                   [photo.name for photo in photos], marks), sheet=True, quality=90)


_WIDTH, _HEIGHT, _RADIUS = 1772, 470, 290
_FAINT, _SKIN = (214, 211, 204), (236, 226, 212)


def _place(yaw: float, radius: float) -> tuple[float, float]:
    """Where a camera stands, seen from above: the person looks down the picture."""
    angle = math.radians(yaw)
    return 360 + radius * math.sin(angle), 120 + radius * math.cos(angle)


def _arc(draw: ImageDraw.ImageDraw, check: PhotoCheck) -> None:
    """A head from above, the photos around it, and where there are none."""
    x, y = _place(0, 0)
    rim = (x - _RADIUS, y - _RADIUS, x + _RADIUS, y + _RADIUS)
    # Pillow's angles run clockwise from the right; ours run from straight down to the right.
    draw.arc(rim, 0, 180, fill=_FAINT, width=2)
    for first, last in check.gaps:
        draw.pieslice(rim, 90 - last, 90 - first, fill=(250, 226, 222))
        draw.arc(rim, 90 - last, 90 - first, fill=BAD, width=5)
    for yaw in range(-90, 91, 30):
        inner, outer = _place(yaw, _RADIUS + 14), _place(yaw, _RADIUS + 22)
        draw.line((*inner, *outer), fill=INK, width=2)
        draw.text(_place(yaw, _RADIUS + 38), f"{abs(yaw)}", INK, font(14), anchor="mm")
    draw.ellipse((x - 9, y + 38, x + 9, y + 60), fill=_SKIN, outline=INK, width=2)
    draw.ellipse((x - 56, y - 10, x - 40, y + 16), fill=_SKIN, outline=INK, width=2)
    draw.ellipse((x + 40, y - 10, x + 56, y + 16), fill=_SKIN, outline=INK, width=2)
    draw.ellipse((x - 46, y - 50, x + 46, y + 50), fill=_SKIN, outline=INK, width=2)
    sizes = [one.face for one in check.photos if one.face]
    usual = float(np.median(sizes)) if sizes else 1.0
    for one in check.photos:
        if one.yaw is None:
            continue
        color = BAD if one.wrong else FAIR if one.fair else GOOD
        # Farther away where the face is smaller.
        near = float(np.clip(usual / max(one.face or usual, 1e-3), 0.75, 1.12))
        px, py = _place(one.yaw, _RADIUS * near)
        draw.line((px, py, *_place(one.yaw, 70)), fill=(*color, 60), width=1)
        draw.ellipse((px - 7, py - 7, px + 7, py + 7), fill=color, outline=PAPER, width=1)
    unseen = sum(one.yaw is None for one in check.photos)
    if unseen:
        draw.text((24, 440), f"{unseen} photos without a face that is seen (from the side, from "
                  "behind, or hidden) are not drawn here.", INK, font(14))


def wrapped(draw: ImageDraw.ImageDraw, text: str, width: float, size: int) -> list[str]:
    """A text in lines of at most ``width`` pixels."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if draw.textlength(longer, font=font(size)) > width and lines[-1]:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def check_picture(check: PhotoCheck) -> UInt8:
    """Draw what `check_photos` found, uint8 [H, W, 3].

    From above on the left, advice on the right, all photos below, those of no use crossed out in
    red, those that could be better framed in yellow.
    """
    top = Image.new("RGB", (_WIDTH, _HEIGHT), PAPER)
    draw = ImageDraw.Draw(top, "RGBA")
    _arc(draw, check)
    left, y = 760, 28
    useful = sum(not one.wrong for one in check.photos)
    draw.text((left, y), f"{len(check.photos)} photos, {useful} of use", INK, font(26))
    y += 48
    for line in check.advice or ["No problems found: these photos are suitable for a portrait."]:
        rows = wrapped(draw, line, _WIDTH - left - 60, 18)
        if y + 25 * len(rows) > _HEIGHT - 10:
            draw.text((left + 22, y), "...", INK, font(18))
            break
        mark = BAD if check.advice else GOOD
        draw.ellipse((left, y + 6, left + 10, y + 16), fill=mark)
        for row in rows:
            draw.text((left + 22, y), row, INK, font(18))
            y += 25
        y += 7
    sheet = contact_sheet(check.images, [one.name for one in check.photos],
                          {one.name: one.wrong for one in check.photos if one.wrong},
                          fair={one.name: one.fair for one in check.photos if one.fair})
    width = max(_WIDTH, sheet.shape[1])
    picture = Image.new("RGB", (width, _HEIGHT + sheet.shape[0]), PAPER)
    picture.paste(top, (0, 0))
    picture.paste(Image.fromarray(sheet), (0, _HEIGHT))
    return np.asarray(picture)


PAPER, INK = (250, 249, 246), (40, 40, 44)
GOOD, FAIR, BAD = (66, 140, 82), (214, 148, 32), (196, 52, 44)
"""Colors of photos that are well, that could be better, that are of no use."""

_CELL, _FOOT, _GAP = (208, 156), 36, 12


def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Pillow's own font, so that sheets look alike on all machines."""
    return ImageFont.load_default(size)


def _shortened(draw: ImageDraw.ImageDraw, text: str, face: ImageFont.FreeTypeFont
               | ImageFont.ImageFont, width: float) -> str:
    """The text, cut so that it fits."""
    if draw.textlength(text, font=face) <= width:
        return text
    while text and draw.textlength(text + "...", font=face) > width:
        text = text[:-1]
    return text + "..."


def contact_sheet(images: Sequence[UInt8], names: Sequence[str], marks: Mapping[str, str], *,
                  fair: Mapping[str, str] | None = None, columns: int = 8) -> UInt8:
    """Draw a contact sheet, uint8 [H, W, 3], of pictures uint8 [H, W, 3 or 4] and their names.

    What is wrong, or could be better, by name, stands in ``marks`` and ``fair``: these photos are
    framed in red and crossed out, or framed in yellow.
    """
    fair = fair or {}
    columns = max(1, min(columns, len(images)))
    rows = -(-len(images) // columns)
    step = _CELL[0] + _GAP, _CELL[1] + _FOOT + _GAP
    sheet = Image.new("RGB", (columns * step[0] + _GAP, rows * step[1] + _GAP), PAPER)
    draw = ImageDraw.Draw(sheet)
    plain, small = font(13), font(12)
    for index, (image, name) in enumerate(zip(images, names)):
        x, y = _GAP + (index % columns) * step[0], _GAP + (index // columns) * step[1]
        picture = Image.fromarray(np.ascontiguousarray(image[..., :3]))
        picture.thumbnail((_CELL[0] - 6, _CELL[1] - 6), Image.Resampling.LANCZOS)
        left = x + (_CELL[0] - picture.width) // 2
        top = y + (_CELL[1] - picture.height) // 2
        sheet.paste(picture, (left, top))
        wrong, could = marks.get(name, ""), fair.get(name, "")
        color = BAD if wrong else FAIR if could else GOOD
        frame = (left - 3, top - 3, left + picture.width + 2, top + picture.height + 2)
        draw.rectangle(frame, outline=color, width=3)
        if wrong:
            draw.line((frame[0], frame[3], frame[2], frame[1]), fill=BAD, width=3)
        draw.text((x, y + _CELL[1] + 1), _shortened(draw, name, plain, _CELL[0]), INK, plain)
        draw.text((x, y + _CELL[1] + 17), _shortened(draw, wrong or could, small, _CELL[0]),
                  color, small)
    return np.asarray(sheet)
