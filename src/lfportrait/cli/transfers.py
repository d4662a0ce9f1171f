"""What ``transfer`` does to a photo, a folder and a video, and ``styles add`` to a painting."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from ..errors import UserError
from ..example import (
    Exemplar,
    MethodConfig,
    RegionStyle,
    Transfer,
    TransferConfig,
    VideoTransfer,
    face_landmarks,
    mix_regions,
    prepare,
    suited,
)
from ..files import read_image, write_image
from ..progress import Progress

__all__ = ["add_style", "transfer_folder", "transfer_photo", "transfer_video"]

_LINES = ((0, 17), (17, 22), (22, 27), (27, 31), (31, 36), (36, 42), (42, 48), (48, 60), (60, 68))
"""First and last point of each line through the 68 landmarks."""
_CLOSED = {36, 42, 48, 60}


class _Painter:
    """Exemplars prepared when they are first needed, and used for all photos."""

    def __init__(self, exemplar: Exemplar, config: MethodConfig,
                 choices: Sequence[RegionStyle]) -> None:
        self.exemplar, self.config, self.choices = exemplar, config, choices
        self.others = {choice.style: Exemplar.load(choice.style)
                       for choice in choices if choice.style}
        self.prepared: dict[tuple[str, bool], Any] = {}

    def _apply(self, style: str, photo: NDArray[np.uint8], points: NDArray[np.float64]) -> Any:
        exemplar = self.others[style] if style else self.exemplar
        # Rivals take a painting as it is.
        chosen = suited(exemplar, points) if isinstance(self.config, TransferConfig) else exemplar
        key = style, chosen is exemplar
        if key not in self.prepared:
            self.prepared[key] = prepare(chosen, self.config, own=[(photo, points)])
        return self.prepared[key].apply(photo, points)

    def paint(self, photo: NDArray[np.uint8]) -> tuple[NDArray[np.float32], Any]:
        """The picture, float32 [H, W, 3], and the result for the whole."""
        points = np.asarray(face_landmarks(photo), np.float64)
        result = self._apply("", photo, points)
        if not self.choices:
            return result.image, result
        others = {style: self._apply(style, photo, points).image for style in self.others}
        return mix_regions(photo, points, result.image, self.choices, others), result


def transfer_photo(path: Path, out: Path, exemplar: Exemplar, config: MethodConfig,
                   choices: Sequence[RegionStyle], dump: Path | None) -> dict[str, Any]:
    """Paint one photo; returns the seconds of the steps."""
    photo = read_image(path)[..., :3]
    image, result = _Painter(exemplar, config, choices).paint(photo)
    write_image(out, image)
    if dump is not None:
        result.dump(dump)
    return dict(result.seconds)


def transfer_folder(folder: Path, out: Path, exemplar: Exemplar, config: MethodConfig,
                    choices: Sequence[RegionStyle], progress: Progress) -> dict[str, Any]:
    """Paint all photos of a folder into another; those without a face are named and left out.

    Raises
    ------
    UserError
        If there are no pictures, or no face in any.
    """
    if out.suffix:
        raise UserError(f"{folder} is a folder: name a folder with --out, not {out}")
    pictures = sorted(path for path in folder.iterdir() if path.suffix.lower() in
                      (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff")
                      and not path.name.endswith((".mask.png", ".landmarks.png")))
    if not pictures:
        raise UserError(f"there are no pictures in {folder}")
    painter = _Painter(exemplar, config, choices)
    skipped: dict[str, str] = {}
    for number, path in enumerate(pictures):
        progress.update(number, path.name)
        try:
            image, _ = painter.paint(read_image(path)[..., :3])
        except UserError as error:
            skipped[path.name] = str(error)
            continue
        write_image(out / f"{path.stem}.png", image)
    if len(skipped) == len(pictures):
        raise UserError(f"no picture in {folder} could be painted: {next(iter(skipped.values()))}")
    return {"pictures": len(pictures) - len(skipped), "skipped": skipped}


def transfer_video(path: Path, out: Path, exemplar: Exemplar, config: TransferConfig,
                   progress: Progress) -> dict[str, Any]:
    """Paint a video frame by frame, strokes carried along; returns frames, seconds, flicker."""
    from ..capture import video_frames
    from ..share import write_video

    if out.suffix.lower() not in (".mp4", ".mov", ".mkv"):
        raise UserError(f"{path} is a video: name one with --out, for example out.mp4")
    rate, frames = video_frames(path)
    video = VideoTransfer(Transfer(exemplar, config))
    start = time.perf_counter()

    def painted() -> Iterator[NDArray[np.uint8]]:
        for number, frame in enumerate(video.frames(frames)):
            progress.update(number, f"frame {number + 1}")
            yield frame

    count = write_video(out, painted(), rate, quality=18, preset="superfast")
    seconds = time.perf_counter() - start
    flicker = float(np.mean(video.flicker)) if video.flicker else None
    return {"frames": count, "fps": rate, "seconds": seconds,
            "frames_per_second": count / seconds, "flicker": flicker}


def add_style(path: Path) -> dict[str, Any]:
    """Landmarks of a painting: found and written beside it, or read from there; and drawn."""
    from ..face import detect_landmarks, read_landmarks, write_landmarks

    image = np.ascontiguousarray(read_image(path)[..., :3])
    beside, drawn = path.with_suffix(".landmarks.txt"), path.with_suffix(".landmarks.png")
    if beside.exists():
        points = read_landmarks(beside)
        print(f"{beside} is there already and was drawn; remove it to have landmarks found anew")
    else:
        found = detect_landmarks(image)
        if found is None:
            raise UserError(f"no face found in {path}; write its 68 landmarks into {beside.name} "
                            "beside it, one 'x y' a line, and call this again")
        points = np.asarray(found, np.float64)
        write_landmarks(beside, points)
        print(f"wrote {beside}; look at {drawn.name}, and where points are off correct them there")
    write_image(drawn, draw_landmarks(image, points))
    return {"image": str(path), "landmarks": str(beside), "picture": str(drawn)}


def draw_landmarks(image: NDArray[np.uint8], points: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The picture with numbered landmarks, enlarged so that the numbers can be read."""
    size = float(np.ptp(points, axis=0).max())
    factor = int(np.clip(np.ceil(900 / max(size, 1.0)), 1, 6))
    picture = Image.fromarray(image).resize((image.shape[1] * factor, image.shape[0] * factor))
    draw = ImageDraw.Draw(picture)
    places = [(float(x) * factor, float(y) * factor) for x, y in points]
    for first, end in _LINES:
        line = places[first:end] + ([places[first]] if first in _CLOSED else [])
        draw.line(line, fill=(0, 160, 255), width=2)
    for number, (x, y) in enumerate(places):
        draw.ellipse((x - 3, y - 3, x + 3, y + 3), fill=(255, 40, 40))
        draw.text((x + 4, y - 5), str(number), fill=(0, 220, 0), stroke_width=2,
                  stroke_fill=(0, 0, 0))
    return np.asarray(picture, np.uint8)
