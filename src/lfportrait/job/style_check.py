"""Check a painting before a head is painted by it.

How the face is turned and which parts of it are therefore taken from its mirror image, how large it
is beside what displays show, which materials (hair, neck, clothes) it has paint for and which must
be made of others, what in it will show in portraits after it, and a preview on the embedded head.
Each finding is a line for the user: what is there, what it will do, and what to do about it.
The page of `styles check` is drawn here, and the landmarks to be corrected.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image, ImageDraw
from scipy import ndimage

from ..arrays import Float32, Float64, UInt8
from ..capture import Camera
from ..color import to_uint8
from ..demo import demo_landmarks
from ..errors import UserError
from ..example import FRONTAL, PROFILE, Exemplar, Regions, frontal_view, head_mesh, shut_eyes
from ..face import FacePose, detect_faces, face_pose, mouth_opening, read_landmarks, write_landmarks
from ..files import write_image
from ..lightfield import Display, EncodeConfig
from ..media.pictures import read_image
from ..stylize import PARTED, StylizeConfig, stylize_with_figures
from .made_from import hand_at_face
from .photo_check import BAD, FAIR, GOOD, INK, PAPER, font, wrapped
from .session import preview_head

SMALL = 300
"""A face of so many pixels from chin to brows, or less, has coarse strokes on any panel."""
HALF = 45.0  # From so many degrees on about half of a face is its mirror image.
CORNER, GRAIN, LIKE = 0.04, 4.0, (8.0, 24.0)
"""Size of the corners that a frame is looked for in, over the picture's shorter side. A pixel is of
their color if it is no further from it than their grain (`GRAIN` of its deviations), within
limits, of 255."""
OVAL, FILLED = 0.95, (0.72, 0.85)
"""How much of an ellipse and what is inside a frame must overlap, over both together; and the share
of its box that an ellipse fills, about."""
SHADE, DEEP = 0.52, 75.0
"""A half of a face is in deep shadow if it is darker than this share of the other, and than this
luma of 255."""
UNSURE, NEITHER = 0.36, (0.3, 0.7)
"""A hair matte is unsure if so much of it lies between hair and none."""
HAND = 0.04  # Share of the face that must be skin of the body for a hand to be there.


@dataclass(frozen=True)
class Finding:
    """One thing that will show."""

    name: str  # For ``--json``.
    text: str  # A line for the user.
    value: Any = True  # A figure of it.
    grade: tuple[int, int, int] = FAIR  # Color of the line's grade.


def findings(exemplar: Exemplar, yaw: float, rows: int) -> list[Finding]:
    """What is found in a painting besides its pose.

    Its face is turned by ``yaw`` degrees; a 4K panel shows ``rows`` of it from chin to brows.
    """
    image, points = exemplar.image, exemplar.landmarks
    regions = exemplar.regions()
    found = [_coarse(points, rows), _oval(image, exemplar.mask is not None), _half(yaw),
             _shadow(image, points), _hair(regions), _eyes(points, image), _mouth(points),
             _hand(image, points)]
    return [one for one in found if one is not None]


def _coarse(points: Float64, rows: int) -> Finding | None:
    pixels = float(np.ptp(points[:, 1]))
    if pixels > SMALL:
        return None
    times = rows / max(pixels, 1.0)
    return Finding("coarse", f"Small face ({pixels:.0f} pixels from chin to brows): on a 4K panel "
                   f"its strokes are {times:.1f} times coarser than the panel's pixels; use a "
                   "larger picture of it", round(times, 2), BAD if times > 4 else FAIR)


def oval_frame(image: UInt8) -> tuple[int, int, int, int] | None:
    """Box (left, top, right, bottom) of an oval or round frame with plain corners, or None.

    In a picture uint8 [H, W, 3].
    """
    height, width = image.shape[:2]
    factor = max(1, round(max(height, width) / 500))
    small = image[::factor, ::factor].astype(np.float32)
    rows, columns = small.shape[:2]
    side = max(3, round(CORNER * min(rows, columns)))
    corners = np.stack([small[y, x].reshape(-1, 3) for y in (slice(side), slice(-side, None))
                        for x in (slice(side), slice(-side, None))])
    middles = np.median(corners, axis=1)
    like = float(np.clip(GRAIN * corners.std(axis=1).max(), *LIKE))
    if np.ptp(middles, axis=0).max() > like:
        return None
    color = np.median(middles, axis=0)
    framed = ndimage.binary_fill_holes(np.abs(small - color).max(axis=-1) > like)
    framed = ndimage.binary_opening(framed, np.ones((3, 3)), iterations=2)
    there = np.argwhere(framed)
    if not len(there):
        return None
    (top, left), (bottom, right) = there.min(axis=0), there.max(axis=0) + 1
    box = framed[top:bottom, left:right]
    if not FILLED[0] < box.mean() < FILLED[1] or box.sum() < 0.25 * framed.size:
        return None
    y, x = ((np.arange(n) + 0.5) / n * 2 - 1 for n in box.shape)
    ellipse = np.hypot(x[None], y[:, None]) < 1
    if (box & ellipse).sum() < OVAL * (box | ellipse).sum():
        return None
    left, top, right, bottom = (int(one) * factor for one in (left, top, right, bottom))
    return left, top, min(right, width), min(bottom, height)


def _oval(image: UInt8, masked: bool) -> Finding | None:
    box = oval_frame(image)
    if box is None or masked:
        return None
    left, top, right, bottom = box
    # The largest box of the same shape within an ellipse.
    x, y = (0.5 * (1 - 0.5 ** 0.5) * n for n in (right - left, bottom - top))
    inner = [round(n) for n in (left + x, top + y, right - x, bottom - y)]
    return Finding("oval", "An oval frame: its plain corners become background of photos, and its "
                   f"edge shows there. Crop it to what lies inside, for example from {inner[0]} "
                   f"{inner[1]} to {inner[2]} {inner[3]}", list(box))


def _half(yaw: float) -> Finding | None:
    """A face of which half is a mirror image; profiles are refused."""
    if not HALF < abs(yaw) <= PROFILE:
        return None
    return Finding("half_mirrored", f"Turned by {abs(yaw):.0f} degrees: the far half of the face "
                   "is made of the near one; one that is turned less gives more of the painter's "
                   "own", round(abs(yaw), 1))


def _shadow(image: UInt8, points: Float64) -> Finding | None:
    middle = points[[27, 28, 29, 30]]
    sides = []
    for jaw, brow in ((points[1:7], points[17:21]), (points[15:9:-1], points[26:22:-1])):
        outline = np.concatenate([jaw, points[[57]], middle[::-1], brow[::-1]])
        inside = np.zeros(image.shape[:2], np.uint8)
        cv2.fillPoly(inside, [np.round(outline).astype(np.int32)], 1)
        light = image[inside > 0] @ np.array([0.299, 0.587, 0.114])
        sides.append(float(np.median(light)) if len(light) else np.nan)
    dark, light = min(sides), max(sides)
    if not (dark < SHADE * light and dark < DEEP):
        return None
    side = "left" if sides[0] == dark else "right"
    return Finding("half_in_shadow", f"The half of the face on the picture's {side} lies in deep "
                   "shadow: portraits have it, too, and landmarks there may be off: look at them "
                   "with `styles add`", round(dark / max(light, 1.0), 2))


def _hair(regions: Regions) -> Finding | None:
    if regions.hair is None:
        return Finding("hair_unsure", "Its hair can't be distinguished from its skin: hair may be "
                       "painted with skin, and skin with hair", "none")
    there, sure = ((regions.hair > limit).sum() for limit in NEITHER)
    share = 1 - float(sure) / max(float(there), 1.0)
    if share < UNSURE:
        return None
    return Finding("hair_unsure", f"Where its hair ends is unsure for {100 * share:.0f} % of it: "
                   "strokes of skin may lie in hair and of hair on skin; a larger or sharper "
                   "picture helps", round(share, 2))


def _eyes(points: Float64, image: UInt8) -> Finding | None:
    shut = shut_eyes(points, image)
    if not any(shut):
        return None
    what = "The eyes are" if all(shut) else "One eye is"
    return Finding("eyes_closed", f"{what} closed: open eyes of a sitter are painted with lids; "
                   "--keep eyes leaves the photo's", list(shut))


def _mouth(points: Float64) -> Finding | None:
    opening = mouth_opening(points)
    if not opening > PARTED:
        return None
    return Finding("mouth_open", "The mouth is open: teeth or a gap are pressed between closed "
                   "lips; --keep lips leaves the photo's", round(opening, 2))


def _hand(image: UInt8, points: Float64) -> Finding | None:
    """A hand at the face, where the network of parts is at hand."""
    share = hand_at_face(image, points)
    if share < HAND:
        return None
    return Finding("hand", "A hand seems to lie at the face: it is painted as skin of the face; "
                   "use a picture without it", round(share, 3))


DISPLAYS = ("lookingglass-go", "generic-4k", "lookingglass-16", "generic-8k")
"""Displays that a face's size is compared with."""
BENT = 0.12
"""Residual over the face's size from which on landmarks are doubtful; usual is 0.04 to 0.08."""
PLAIN = 8.0
"""Deviation of colors (of 255) from one line from light to dark, below which they are one."""
SIDES = {"cheek": (0.27, -0.15), "temple": (0.33, 0.16), "jaw": (0.26, -0.42),
         "eye": (0.17, 0.03), "ear": (0.42, -0.02)}
"""Places on the generic head, on the picture's right."""
VIEWS = (-45.0, 0.0, 45.0)


@dataclass
class StyleCheck:
    """What `check_style` found."""

    exemplar: Exemplar  # The painting, its landmarks those of the face that was chosen.
    # float64 [68, 2] each, all faces that were found, the largest first; empty if landmarks were
    # given.
    faces: list[Float64]
    pose: FacePose  # Of the face.
    # frontal, mirrored: uint8 [h, w, 3], the frontal picture that is painted from, and float32 [h,
    # w] in [0, 1], what of it is a mirror image; None for a face that is taken as it is.
    frontal: UInt8 | None = None
    mirrored: Float32 | None = None
    # uint8 [H, W, 3]: the embedded head from the left, the front and the right.
    preview: UInt8 | None = None
    # Lines, each with the color of its grade.
    facts: list[tuple[tuple[int, int, int], str]] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)  # For ``--json``.


def chosen_face(path: Path, image: UInt8, face: int = 0,
                at: tuple[float, float] | None = None) -> tuple[Float64, list[Float64]]:
    """Landmarks [68, 2] of the one face of a picture that is meant, and of all that were found.

    By its number, the largest is 1 (0, too), or by a place (x, y) in pixels on it. Raises
    `UserError` if there is no such face.
    """
    faces = detect_faces(image, at)
    if not faces:
        where = f"at {at[0]:g} {at[1]:g} in {path}" if at else f"in {path}"
        more = "" if at else "; give its position with --at X Y, or"
        raise UserError(f"no face found {where}{more or ';'} write its 68 landmarks into "
                        f"{path.with_suffix('.landmarks.txt').name} beside it, one 'x y' a line "
                        "(a full profile can't be used: both eyes must show)")
    if face > len(faces):
        raise UserError(f"{path} shows {len(faces)} face{'s' if len(faces) > 1 else ''}; there is "
                        f"no face {face}")
    return faces[max(face, 1) - 1], faces


def check_style(style: str | Path, face: int = 0, at: tuple[float, float] | None = None, *,
                preview: bool = True) -> StyleCheck:
    """Check a painting, or a built-in exemplar by its name.

    Landmarks beside it are used, unless a face is chosen (`chosen_face`).
    """
    path = Path(style)
    faces: list[Float64] = []
    if not path.exists() or (path.with_suffix(".landmarks.txt").exists() and not face
                             and at is None):
        exemplar = Exemplar.load(style)
    else:
        image = np.ascontiguousarray(read_image(path)[..., :3])
        points, faces = chosen_face(path, image, face, at)
        exemplar = Exemplar.load(path, points)
    check = StyleCheck(exemplar, faces, exemplar.pose())
    _turn(check)
    _size(check)
    if len(faces) > 1:
        number, other = max(face, 1), 1 if face > 1 else 2
        which = f"number {number}, the largest" if number == 1 else f"number {number}"
        check.facts.append((FAIR, f"{len(faces)} faces: this is {which}; `lfportrait styles add "
                                  f"{path.name} --face {other}` takes another"))
    found = findings(exemplar, check.pose.yaw, check.figures["rows_shown"]["generic-4k"])
    check.facts += [(one.grade, one.text) for one in found]
    check.figures["findings"] = {one.name: one.value for one in found}
    values = exemplar.image[::3, ::3].reshape(-1, 3).astype(np.float64)
    if np.sqrt(np.linalg.eigvalsh(np.cov(values.T))[:2].sum()) < PLAIN:
        check.facts.append((GOOD, "Drawn in one color: `restyle --keep-colors` gives a portrait "
                                  "the photo's own"))
    if abs(check.pose.yaw) <= PROFILE and preview:
        _paint(check)
    return check


def _turn(check: StyleCheck) -> None:
    """How the face is turned, and what is taken from its mirror image."""
    pose = check.pose
    words = [f"turned {abs(pose.yaw):.0f} degrees to the picture's "
             f"{'right' if pose.yaw > 0 else 'left'}"]
    if abs(pose.pitch) >= 8:
        words.append(f"looks {abs(pose.pitch):.0f} degrees {'up' if pose.pitch > 0 else 'down'}")
    if abs(pose.roll) >= 5:
        words.append(f"leans {abs(pose.roll):.0f} degrees to the picture's "
                     f"{'left' if pose.roll > 0 else 'right'}")
    bent = pose.residual / check.exemplar.size
    check.figures.update(pose=pose.angles, residual=round(bent, 4))
    if abs(pose.yaw) > PROFILE:
        check.facts.append((BAD, f"The face is {', '.join(words)}: nearly a profile, which "
                                 f"is refused. Use one with both eyes, turned by {PROFILE:.0f} "
                                 "degrees at most"))
        return
    if abs(pose.yaw) < FRONTAL:
        check.facts.append((GOOD, f"The face is {', '.join(words)}: used unchanged"))
    else:
        found = frontal_view(check.exemplar, pose)
        check.frontal, check.mirrored = found.image, found.mirrored
        side = "left" if pose.yaw < 0 else "right"
        sign = -1.0 if pose.yaw < 0 else 1.0
        parts = [name for name, (x, y) in SIDES.items() if _mirrored_at(check, sign * x, y)]
        check.figures["mirrored"] = {"side": side, "parts": parts}
        check.facts.append((FAIR, f"The face is {', '.join(words)}: a frontal picture is made of "
                                  f"it"))
        if parts:
            check.facts.append((FAIR, f"Mirrored on the picture's {side}: {', '.join(parts)}"))
    if bent > BENT:
        check.facts.append((FAIR, f"The landmarks differ from a face by {100 * bent:.0f} % of its "
                                  "size (usual: 4 to 8): look at them with `styles add`"))


def _mirrored_at(check: StyleCheck, x: float, y: float) -> bool:
    """Whether a place of the generic head is taken from its mirror image."""
    assert check.mirrored is not None
    height, width = check.mirrored.shape
    column = int(np.clip(width / 2 + check.pose.scale * x, 0, width - 1))
    row = int(np.clip(check.pose.shift[1] - check.pose.scale * y, 0, height - 1))
    return bool(check.mirrored[row, column] > 0.5)


def _size(check: StyleCheck) -> None:
    """How large the face is beside what displays show of it."""
    points = check.exemplar.landmarks
    pixels = float(np.nanmax(points[:, 1]) - np.nanmin(points[:, 1]))
    # The head's frame is 2 high, and takes `size` of the panel's height.
    face = float(np.ptp(demo_landmarks()[:, 1])) / 2 * EncodeConfig().size
    shown = {}
    for name in DISPLAYS:
        shown[name] = round(face * Display.preset(name).height)
    check.figures.update(face_pixels=round(pixels), rows_shown=shown)
    enough = [name for name, rows in shown.items() if pixels >= 0.8 * rows]
    less = [f"{name} {rows}" for name, rows in shown.items() if name not in enough]
    text = f"The face is {pixels:.0f} pixels high from chin to brows"
    if enough:
        text += f": enough for {', '.join(enough)}"
    if less:
        text += f"; shown with more rows, so that strokes are coarse: {', '.join(less)}"
    check.facts.append((GOOD if enough else FAIR if pixels > 200 else BAD, text))


def _paint(check: StyleCheck) -> None:
    """Paint the embedded head, and list the materials that were used."""
    config = StylizeConfig(preview=True, pixels=320.0)
    head, capture, skin = preview_head(config.pixels)
    styled, figures = stylize_with_figures(head, capture, check.exemplar, config, skin=skin)
    known = figures["materials"]
    check.figures.update(materials=known, notices=figures["notices"])
    instead = {"hair": "skin's", "neck": "the face's", "clothes": "the neck's"}
    missing = [name for name in instead if name not in known]
    if missing:
        check.facts.append((FAIR, "Not painted, so made of other paint: " + ", ".join(
            f"{name} (of {instead[name]})" for name in missing)))
    else:
        check.facts.append((GOOD, "Hair, neck and clothes are painted from its own"))
    side = 560
    views = Camera.arc(np.array(VIEWS), distance=4.4, width=side, height=side, focal=1.9 * side,
                       target=(0.0, -0.02, 0.0))
    check.preview = np.concatenate([to_uint8(styled.render(views, view).color)
                                    for view in range(len(VIEWS))], axis=1)


_WIDTH, _TALL, _GAP = 1680, 620, 24
_MESH, _TINT = (0, 200, 255), np.array([255.0, 120.0, 40.0])


def draw_mesh(draw: ImageDraw.ImageDraw, check: StyleCheck, factor: float) -> None:
    """The generic head's mesh in the face's pose, on a picture ``factor`` times as large."""
    for line in head_mesh(check.exemplar.landmarks, check.pose):
        draw.line([(float(x) * factor, float(y) * factor) for x, y in line], fill=_MESH, width=1)


def draw_faces(draw: ImageDraw.ImageDraw, check: StyleCheck, factor: float) -> None:
    """A numbered frame around each face, where there are several."""
    if len(check.faces) < 2:
        return
    for number, points in enumerate(check.faces, start=1):
        low, high = points.min(axis=0) * factor, points.max(axis=0) * factor
        color = GOOD if np.array_equal(points, check.exemplar.landmarks) else FAIR
        draw.rectangle((*low, *high), outline=color, width=3)
        draw.text((float(low[0]) + 6, float(low[1]) + 4), str(number), color, font(26),
                  stroke_width=2, stroke_fill=(0, 0, 0))


def _fitted(image: UInt8, width: float) -> tuple[Image.Image, float]:
    """A picture as large as fits, and the factor."""
    factor = min(width / image.shape[1], _TALL / image.shape[0])
    size = max(1, round(image.shape[1] * factor)), max(1, round(image.shape[0] * factor))
    return Image.fromarray(image).resize(size, Image.Resampling.LANCZOS), factor


def style_picture(check: StyleCheck) -> UInt8:
    """Draw what `check_style` found, uint8 [H, W, 3].

    The painting with the mesh of its pose; for a turned face the frontal picture, mirrored places
    tinted; what is to be said; the embedded head in the painting's manner.
    """
    columns = 2 if check.frontal is not None else 1
    each = (_WIDTH * 0.68 - _GAP * (columns + 1)) / columns if columns > 1 else _WIDTH * 0.42
    painting, factor = _fitted(check.exemplar.image, each)
    draw = ImageDraw.Draw(painting)
    draw_mesh(draw, check, factor)
    draw_faces(draw, check, factor)
    pictures = [painting]
    if check.frontal is not None and check.mirrored is not None:
        share = 0.22 * check.mirrored[..., None]
        tinted = (1 - share) * check.frontal + share * _TINT
        pictures.append(_fitted(np.asarray(tinted + 0.5, np.uint8), each)[0])
    top = 64
    below = top + max(picture.height for picture in pictures) + _GAP
    preview = None if check.preview is None else Image.fromarray(check.preview)
    page = Image.new("RGB", (_WIDTH, below + (preview.height + _GAP if preview else 0)), PAPER)
    draw = ImageDraw.Draw(page)
    draw.text((_GAP, 18), check.exemplar.name, INK, font(30))
    left = _GAP
    for picture in pictures:
        page.paste(picture, (left, top))
        left += picture.width + _GAP
    y = top
    for grade, text in check.facts:
        rows = wrapped(draw, text, _WIDTH - left - 40, 18)
        draw.ellipse((left, y + 6, left + 10, y + 16), fill=grade)
        for row in rows:
            draw.text((left + 22, y), row, INK, font(18))
            y += 25
        y += 9
    if preview:
        page.paste(preview, ((_WIDTH - preview.width) // 2, below))
    return np.asarray(page)


_LINES = ((0, 17), (17, 22), (22, 27), (27, 31), (31, 36), (36, 42), (42, 48), (48, 60), (60, 68))
"""First and last point of each line through the 68 landmarks."""
_CLOSED = {36, 42, 48, 60}


def add_style(path: Path, face: int = 0, at: tuple[float, float] | None = None) -> dict[str, Any]:
    """Landmarks of a painting: found and written beside it, or read from there; and drawn.

    Which face, `chosen_face` knows. The figures are ``image``, ``landmarks`` and ``picture`` (the
    files), ``pose``, ``faces`` (how many were found) and ``said``: lines for the user. Raises
    `UserError` if there is no such face, or landmarks are there already and another face is asked
    for.
    """
    image = np.ascontiguousarray(read_image(path)[..., :3])
    beside, drawn = path.with_suffix(".landmarks.txt"), path.with_suffix(".landmarks.png")
    faces: list[Float64] = []
    if beside.exists():
        if face or at is not None:
            raise UserError(f"{beside} already exists; remove it to use another face")
        points = np.asarray(read_landmarks(beside), np.float64)
        said = [f"{beside} already exists and was drawn; remove it to detect the landmarks again"]
    else:
        points, faces = chosen_face(path, image, face, at)
        write_landmarks(beside, points)
        said = [f"wrote {beside}; look at {drawn.name}, and where points are off correct them "
                "there"]
        if len(faces) > 1:
            said.append(f"{len(faces)} faces, numbered in {drawn.name}: this is number "
                        f"{max(face, 1)}; remove {beside.name} and use --face N for another")
    pose = face_pose(points)
    check = StyleCheck(Exemplar(image, points, path.stem), faces, pose)
    write_image(drawn, draw_landmarks(check), sheet=True)
    return {"image": str(path), "landmarks": str(beside), "picture": str(drawn),
            "pose": pose.angles, "faces": max(len(faces), 1), "said": said}


def draw_landmarks(check: StyleCheck) -> UInt8:
    """The picture with mesh and numbered landmarks, large enough to read these, [H, W, 3]."""
    image, points = check.exemplar.image, check.exemplar.landmarks
    size = float(np.ptp(points, axis=0).max())
    factor = int(np.clip(np.ceil(900 / max(size, 1.0)), 1, 6))
    picture = Image.fromarray(image).resize((image.shape[1] * factor, image.shape[0] * factor))
    draw = ImageDraw.Draw(picture)
    draw_mesh(draw, check, factor)
    draw_faces(draw, check, factor)
    places = [(float(x) * factor, float(y) * factor) for x, y in points]
    for first, end in _LINES:
        line = places[first:end] + ([places[first]] if first in _CLOSED else [])
        draw.line(line, fill=(0, 160, 255), width=2)
    for number, (x, y) in enumerate(places):
        draw.ellipse((x - 3, y - 3, x + 3, y + 3), fill=(255, 40, 40))
        draw.text((x + 4, y - 5), str(number), fill=(0, 220, 0), stroke_width=2,
                  stroke_fill=(0, 0, 0))
    return np.asarray(picture, np.uint8)
