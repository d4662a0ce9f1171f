"""Draw the README's picture from a finished demo: photo, painting, turning head, coded picture.

python scripts/make_hero.py demo-out docs/images/hero.webp
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lfportrait.capture import Capture
from lfportrait.demo import demo_exemplar
from lfportrait.field import VoxelField
from lfportrait.files import atomic_path
from lfportrait.lightfield import EncodeConfig
from lfportrait.media.pictures import read_image
from lfportrait.share import sweep_frames

HEIGHT, WIDTH, GAP = 360, 300, 8
FRAMES, MILLISECONDS, CONE = 40, 75, 80.0
"""There and back once in three seconds, over so many degrees."""
LARGEST = 600_000
"""Bytes of the file: the README's readers wait for it."""

Picture = NDArray[np.uint8]


def fitted(image: np.ndarray, width: int = WIDTH) -> Picture:
    """A picture at the row's height, its sides cut off."""
    picture = Image.fromarray(np.uint8(np.clip(image, 0, 255)))
    full = round(picture.width * HEIGHT / picture.height)
    picture = picture.resize((full, HEIGHT), Image.Resampling.LANCZOS)
    left = max(0, (full - width) // 2)
    return np.asarray(picture.crop((left, 0, left + min(width, full), HEIGHT)))


def still_parts(folder: Path) -> tuple[list[Picture], Picture]:
    """A photo and the painting; and a piece of the coded picture."""
    capture = Capture.load(folder / "capture")
    position = capture.cameras.position
    view = int(np.argmin(np.hypot(position[:, 0] + 0.8, position[:, 1] - 0.2)))
    coded = read_image(folder / "lightfield.png")
    # An eye: there colors and contours meet.
    y, x = int(0.5 * coded.shape[0]), int(0.535 * coded.shape[1])
    piece = coded[y:y + HEIGHT // 3, x:x + 50]
    return ([fitted(255 * capture.image_float(view)), fitted(demo_exemplar().image)],
            np.repeat(np.repeat(piece, 3, 0), 3, 1))


def rows(folder: Path) -> list[Picture]:
    """All frames; only the head differs from one to the next."""
    before, after = still_parts(folder)
    styled = VoxelField.load(folder / "styled.npz")
    gap = np.full((HEIGHT, GAP, 3), 255, np.uint8)
    heads = sweep_frames(styled, CONE, FRAMES, HEIGHT + 40, ground=EncodeConfig())
    return [np.concatenate([part for piece in (*before, fitted(head, WIDTH + 40), after)
                            for part in (piece, gap)][:-1], axis=1) for head in heads]


def write(frames: list[Picture], out: Path) -> None:
    """Write the animation as finely as its size allows."""
    pictures = [Image.fromarray(frame) for frame in frames]
    for quality in (80, 74, 68, 62, 56, 50):
        with atomic_path(out) as path:
            pictures[0].save(path, format="WEBP", save_all=True, append_images=pictures[1:],
                             duration=MILLISECONDS, loop=0, quality=quality, method=6,
                             minimize_size=True)
        if out.stat().st_size <= LARGEST:
            break
    print(f"{out}: {out.stat().st_size} bytes, quality {quality}")


if __name__ == "__main__":
    write(rows(Path(sys.argv[1])), Path(sys.argv[2]))
