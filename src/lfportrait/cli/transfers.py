"""The command ``transfer`` on a photo, a folder and a video."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError
from ..example import (
    Exemplar,
    Lids,
    MethodConfig,
    Transfer,
    TransferConfig,
    VideoTransfer,
    as_painted,
    closed_words,
    face_landmarks,
    fitting,
    mix_regions,
    prepare,
    suited,
)
from ..example.worn import not_worn
from ..face import detect_landmarks, face_pose
from ..files import picture_format, write_image
from ..labels import RegionStyle
from ..media.folders import list_pictures, say_left_out
from ..media.pictures import read_image
from ..progress import Progress

__all__ = ["transfer_folder", "transfer_photo", "transfer_video"]

DOUBTFUL = 77.0
"""Degrees beyond which the landmarks of a turned photo are often wrong."""


class _Painter:
    """Exemplars prepared when they are first needed, and used for all photos."""

    def __init__(self, exemplar: Exemplar, config: MethodConfig,
                 choices: Sequence[RegionStyle]) -> None:
        self.exemplar, self.config, self.choices = exemplar, config, choices
        self.others = {choice.style: Exemplar.load(choice.style)
                       for choice in choices if choice.style}
        self.prepared: dict[tuple[str, bool, Lids], Any] = {}
        self.lids: Lids = (False, False)
        self._coming: Future[Any] | None = None

    def begin(self) -> None:
        """Prepare the exemplar as it is in another thread, while a face is looked for."""
        if isinstance(self.config, TransferConfig):
            _note_missing(self.exemplar, self.config)
            aside = ThreadPoolExecutor(1)
            self._coming = aside.submit(lambda: prepare(
                as_painted(self.exemplar, self.config.wear), self.config))
            aside.shutdown(wait=False)

    def _apply(self, style: str, photo: NDArray[np.uint8], points: NDArray[np.float64]) -> Any:
        exemplar = self.others[style] if style else self.exemplar
        # Other methods take a painting as it is.
        chosen = (fitting(exemplar, points, photo, self.config.eyes, self.config.wear)
                  if isinstance(self.config, TransferConfig) else exemplar)
        self.lids = chosen.lids
        own = np.array_equal((chosen.opened or chosen).landmarks, exemplar.landmarks)
        key = style, own, chosen.lids
        if key == ("", True, (False, False)) and self._coming is not None:
            self.prepared[key], self._coming = self._coming.result(), None
        if key not in self.prepared:
            self.prepared[key] = prepare(chosen, self.config, own=[(photo, points)])
        return self.prepared[key].apply(photo, points)

    def paint(self, photo: NDArray[np.uint8], points: NDArray[np.float64],
              ) -> tuple[NDArray[np.float32], Any]:
        """The picture of a photo with landmarks, float32 [H, W, 3], and the result as a whole."""
        result = self._apply("", photo, points)
        if not self.choices:
            return result.image, result
        others = {style: self._apply(style, photo, points).image for style in self.others}
        return mix_regions(photo, points, result.image, self.choices, others), result


def _note_missing(exemplar: Exemplar, config: TransferConfig) -> None:
    for note in not_worn(exemplar, config.wear):
        print(f"note: {note}", file=sys.stderr)


def transfer_photo(path: Path, out: Path, exemplar: Exemplar, config: MethodConfig,
                   choices: Sequence[RegionStyle], dump: Path | None) -> dict[str, Any]:
    """Paint one photo; returns the seconds of the steps."""
    picture_format(out)
    painter = _Painter(exemplar, config, choices)
    painter.begin()
    photo = read_image(path)[..., :3]
    points = np.asarray(face_landmarks(photo), np.float64)
    image, result = painter.paint(photo, points)
    write_image(out, image)
    turned = abs(face_pose(points).yaw)
    if turned > DOUBTFUL:
        print(f"note: the face in {path.name} is turned by {turned:.0f} degrees: landmarks of its "
              f"far side are guesses (reliable up to {DOUBTFUL:.0f} degrees)", file=sys.stderr)
    if any(painter.lids) and not any(one.region in ("eyes", "features") for one in choices):
        print(f"note: {closed_words(painter.lids)} closed, and painted so: --eyes painted opens "
              f"{'them' if all(painter.lids) else 'it'}, --region eyes=off leaves the photo's",
              file=sys.stderr)
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
    listing = list_pictures(folder)
    say_left_out(listing, folder)
    pictures = [path for path in listing.files
                if Path(path.stem).suffix not in (".mask", ".regions", ".landmarks", ".check")]
    if not pictures:
        raise UserError(f"there are no pictures in {folder}")
    painter = _Painter(exemplar, config, choices)
    skipped: dict[str, str] = {}
    for number, path in enumerate(pictures):
        progress.update(number, path.name)
        try:
            photo = read_image(path)[..., :3]
            image, _ = painter.paint(photo, np.asarray(face_landmarks(photo), np.float64))
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
    if config.wear:
        raise UserError(f"{path} is a video: --wear is for photos, leave it out")
    rate, frames = video_frames(path)
    frames, points = _first_face(frames)
    if points is not None:
        # Eyes blink in a video: they are painted open.
        exemplar = as_painted(suited(exemplar, points))
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


def _first_face(frames: Iterator[NDArray[np.uint8]], most: int = 30,
                ) -> tuple[Iterator[NDArray[np.uint8]], NDArray[np.float64] | None]:
    """All frames, and the landmarks of the first face among the first ``most``, or None."""
    looked_at: list[NDArray[np.uint8]] = []
    points = None
    for frame in islice(frames, most):
        looked_at.append(frame)
        points = detect_landmarks(frame)
        if points is not None:
            break
    return chain(looked_at, frames), points
