"""Files for frames and flat screens: parameters, names that ask for a kind, pictures, side files.

Pictures are PNG, JPEG or WebP; what these formats can't hold is said before the work. Looking Glass
Studio's packages (.hop) are zips with the quilt and its settings. Looking Glass's programs look for
a quilt's layout in its name, in ``NAME.png.json`` beside it, or, the older ones, in a JSON text in
the EXIF tag UserComment. (`lfportrait.lightfield.layout_of_file` reads all of them.)
"""

from __future__ import annotations

import io
import json
import math
import re
import unicodedata
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from PIL import Image

from ...arrays import UInt8
from ...errors import UserError
from ...files import DEVICES, atomic_write, write_bytes
from ...lightfield import QuiltHint, QuiltLayout, quilt_part
from ...png import write_png


@dataclass(frozen=True)
class FrameConfig:
    """Parameters of quilts, pairs, RGB-D pictures, anaglyphs and flat videos."""

    display: str = ""
    """Quilts: the display, a preset or a file; by default the one that the name's columns, rows and
    aspect fit. Pairs, RGB-D, anaglyphs: the screen, for its size and viewing distance."""
    pixels: tuple[int, int] = (0, 0)
    """Width and height in pixels: of the quilt, of one eye's picture, of the color half, of the
    flat video. By default the quilt's tiles have the display's customary size, at most 8192 pixels
    a side; one eye's picture has 1536 x 2048, a flat video 2160 x 3840."""
    eye_distance: float = 63.0
    """Pairs and anaglyphs: distance between the eyes in millimetres; smaller is flatter."""
    view_distance: float = 550.0
    """Pairs and anaglyphs: distance of the eyes from the screen in millimetres, where no display of
    known size gives it."""
    backdrop: float | None = None
    """Grey level behind the head, 0 to 1, instead of a painted ground. Without either it is white
    in flat videos, as these panels add their own depth to what is bright, and that of the coding in
    all others."""
    frames: int = 0
    """Videos: number of frames of one loop; 0 = 120. A .hop file with frames holds a video."""
    fps: float = 30.0
    """Videos: frames per second."""
    sway: float = 12.0
    """Videos: how far the head turns to each side, in degrees."""
    codec: Literal["auto", "h264", "hevc", "vp9"] = "auto"
    """Videos: auto: H.264, or HEVC above 4096 pixels a side; VP9 in .webm files; HEVC for flat
    videos."""
    media_player: bool = False
    """Flat videos: turn the picture a quarter to the left, as the panel's own player wants it."""

    def __post_init__(self) -> None:
        def need(good: bool, text: str) -> None:
            if not good:
                raise UserError(text)

        need(self.pixels == (0, 0) or all(2 <= side <= 65536 for side in self.pixels),
             f"--pixels takes a width and a height of 2 to 65536, not {self.pixels[0]} "
             f"{self.pixels[1]}")
        need(0 <= self.eye_distance <= 1000,
             f"--eye-distance must be 0 to 1000 mm, not {self.eye_distance:g}")
        need(100 <= self.view_distance <= 1e5,
             f"--view-distance must be 100 to 100000 mm, not {self.view_distance:g}")
        need(self.backdrop is None or 0 <= self.backdrop <= 1,
             f"--backdrop must be 0 (black) to 1 (white), not {self.backdrop}")
        need(0 <= self.frames <= 100_000, f"--frames must be 0 to 100000, not {self.frames}")
        need(math.isfinite(self.fps) and 0 < self.fps <= 1000,
             f"--fps must be more than 0 and at most 1000, not {self.fps:g}")
        need(0 <= self.sway <= 90, f"--sway must be 0 to 90 degrees, not {self.sway:g}")


PICTURES = (".png", ".jpg", ".jpeg", ".webp")
QUILTS = PICTURES
"""Endings of the formats that quilts are written in with all that goes with them."""
VIDEOS = (".mp4", ".mov", ".mkv", ".webm")
_MOST_VIEWS, _MOST_TILES = 108, 50
_LONGEST = 100  # Letters of a name on a drive, without what is put behind it.


@dataclass(frozen=True)
class QuiltName:
    """The layout that a quilt's name asks for, in part or whole."""

    # columns, rows: 0 where the name leaves them to the display.
    columns: int = 0
    rows: int = 0
    # Width over height of the views; 0 where the name leaves it to the display.
    aspect: float = 0.0

    @staticmethod
    def of(name: str) -> QuiltName:
        """What ``NAME_qs``, ``NAME_qs8x13`` or ``NAME_qs8x6a0.75`` ask for."""
        hint = QuiltHint.of_name(name)
        if hint is None:
            return QuiltName()
        columns, rows, aspect = hint.columns, hint.rows, hint.aspect
        good = (1 <= columns <= _MOST_TILES and 1 <= rows <= _MOST_TILES
                and 2 <= columns * rows <= _MOST_VIEWS)
        if not good:
            raise UserError(f"a quilt has 2 to {_MOST_VIEWS} views, in at most {_MOST_TILES} "
                            f"columns and rows, not {columns} x {rows}")
        if aspect and not 0.1 <= aspect <= 10:
            raise UserError(f"the aspect of a quilt's views must be 0.1 to 10, not {aspect:g}")
        return QuiltName(columns, rows, aspect)

    @staticmethod
    def completed(path: Path, layout: QuiltLayout) -> Path:
        """The path with a layout in its name; a name that has one already is left as it is."""
        found = quilt_part(path.name)
        if found is None:
            return path.with_name(f"{path.stem}{layout.suffix()}{path.suffix}")
        if found[3] is not None:
            return path
        name = path.name
        return path.with_name(f"{name[:found.start()]}{layout.suffix()}{name[found.end():]}")


def safe_names(titles: Iterable[str]) -> list[str]:
    """Names for files on any drive: FAT's forbidden characters and Unicode are left out.

    A frame's playlist has no stated encoding, so that only ASCII is safe. FAT does not tell
    capitals from small letters: names that differ in nothing else get a number.
    """
    taken: set[str] = set()
    names = []
    for title in titles:
        plain = unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode()
        base = re.sub(r"[^A-Za-z0-9._-]+", "-", plain).strip("-. ")[:_LONGEST].rstrip("-. ")
        base = base or "portrait"
        if base.split(".")[0].lower() in DEVICES:
            base = f"portrait-{base}"
        name, number = base, 2
        while name.lower() in taken:
            name, number = f"{base}-{number}", number + 1
        taken.add(name.lower())
        names.append(name)
    return names


SECONDS = 20.0
"""How long a frame shows a picture."""
_EXIF, _USER_COMMENT = 0x8769, 0x9286
_ASCII = b"ASCII\0\0\0"


def quilt_settings(layout: QuiltLayout, *, movie: bool = False, seconds: float = SECONDS,
                   ) -> dict[str, Any]:
    """Contents of a quilt's side file: the settings of Looking Glass Studio."""
    return {
        "movie": movie, "mediaType": "quilt",
        "quilt_settings": {"viewX": layout.columns, "viewY": layout.rows,
                           "viewTotal": layout.count, "invertViews": False,
                           "aspect": round(layout.aspect, 6)},
        "depthiness": 1.0, "depthInversion": False, "chromaDepth": False,
        "depthPosition": "right", "focus": 0.0, "viewOrderReversed": False, "zoom": 1.0,
        "position_x": 0.0, "position_y": 0.0, "duration": seconds}


def quilt_block(layout: QuiltLayout) -> str:
    """The older block, a JSON text."""
    return json.dumps({"LKGNumViews": layout.count, "LKGRows": layout.rows,
                       "LKGColumns": layout.columns, "LKGAspect": round(layout.aspect, 6),
                       "LKGType": "quilt"})


def quilt_exif(layout: QuiltLayout) -> Image.Exif:
    """The older block, to be saved with a PNG, JPEG or WebP file."""
    exif = Image.Exif()
    exif.get_ifd(_EXIF)[_USER_COMMENT] = _ASCII + quilt_block(layout).encode()
    return exif


_LARGEST = {".webp": 16383, ".jpg": 65500, ".jpeg": 65500}
"""Pixels a side. JPEG's format has 35 more; libjpeg, which all use, does not write them."""
_MOST = 2 << 30  # Bytes of a decoded picture: what is larger, most programs refuse to open.
_OPTIONS: dict[str, dict[str, int]] = {
    ".webp": {"quality": 92, "method": 4},
    # Colors at full size: a quilt's tiles are small, and anaglyphs and depth live in colors.
    ".jpg": {"quality": 94, "subsampling": 0}, ".jpeg": {"quality": 94, "subsampling": 0}}


def check_picture(path: Path, width: int, height: int) -> None:
    """Whether the format that a name gives holds a picture of this size."""
    suffix = path.suffix.lower()
    if suffix not in PICTURES:
        raise UserError(f"can't write a picture named {path.name}; end the name in .png, .jpg or "
                        ".webp")
    most = _LARGEST.get(suffix)
    if most is not None and max(width, height) > most:
        raise UserError(f"a {suffix} file holds at most {most} pixels a side, not {width} x "
                        f"{height}: use .png, or make it smaller with --pixels")
    if width * height * 3 > _MOST:
        raise UserError(f"a picture of {width} x {height} pixels would take "
                        f"{width * height * 3 / 2 ** 30:.1f} GiB; make it smaller with --pixels")


def picture_bytes(suffix: str, image: UInt8, exif: Image.Exif | None = None) -> bytes:
    """A picture [H, W, 3] as the contents of a file with this suffix."""
    suffix = suffix.lower()
    buffer = io.BytesIO()
    if suffix == ".png":
        # Before the pixels; Pillow puts EXIF behind them, where few look.
        blocks = () if exif is None else ((b"eXIf", exif.tobytes().removeprefix(b"Exif\0\0")),)
        write_png(buffer, image, blocks)
    else:
        more = {} if exif is None else {"exif": exif}
        Image.fromarray(image).save(buffer, format=Image.registered_extensions()[suffix],
                                    **_OPTIONS[suffix], **more)
    return buffer.getvalue()


def write_picture(path: Path, image: UInt8, exif: Image.Exif | None = None) -> None:
    """Write a picture [H, W, 3]; it appears when it is complete."""
    check_picture(path, image.shape[1], image.shape[0])
    contents = picture_bytes(path.suffix, image, exif)
    write_bytes(path, contents)


def write_hop(path: Path, media: str, contents: bytes | Path, layout: QuiltLayout, *,
              movie: bool = False) -> dict[str, Any]:
    """Write a package; returns its ``bytes``.

    ``media`` names the quilt in it, given as a file or its contents; its settings lie beside it as
    ``MEDIA.json``.
    """
    settings = json.dumps(quilt_settings(layout, movie=movie), indent=1) + "\n"
    with atomic_write(path) as stream, zipfile.ZipFile(stream, "w") as package:
        # Entries without a time of writing: the same quilt gives the same bytes. Pictures and
        # videos are small already, and are only stored.
        entry = zipfile.ZipInfo(media)
        entry.external_attr = 0o644 << 16
        if isinstance(contents, Path):
            with package.open(entry, "w", force_zip64=True) as target, open(contents, "rb") as file:
                while block := file.read(1 << 20):
                    target.write(block)
        else:
            package.writestr(entry, contents)
        side = zipfile.ZipInfo(f"{media}.json")
        side.external_attr = 0o644 << 16
        package.writestr(side, settings, zipfile.ZIP_DEFLATED)
    return {"bytes": path.stat().st_size}
