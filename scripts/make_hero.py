"""Draw the README's picture from a finished demo: photo, painting, stylised views, coded picture.

python scripts/make_hero.py demo-out docs/images/hero.jpg
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from lfportrait.capture import Camera, Capture
from lfportrait.demo import demo_exemplar
from lfportrait.field import VoxelField
from lfportrait.files import write_image
from lfportrait.media.pictures import read_image

HEIGHT = 420


def fitted(image: np.ndarray) -> np.ndarray:
    picture = Image.fromarray(np.uint8(np.clip(image, 0, 255)))
    width = round(picture.width * HEIGHT / picture.height)
    return np.asarray(picture.resize((width, HEIGHT), Image.Resampling.LANCZOS))


def main(folder: Path, out: Path) -> None:
    capture = Capture.load(folder / "capture")
    position = capture.cameras.position
    view = int(np.argmin(np.hypot(position[:, 0] + 0.8, position[:, 1] - 0.2)))
    photo = fitted(255 * capture.image_float(view))
    cut = (photo.shape[1] - 330) // 2
    styled = VoxelField.load(folder / "styled.npz")
    cameras = Camera.arc([-35, 0, 35], distance=4, width=330, height=HEIGHT, focal=780,
                         target=(0, 0.02, 0))
    views = [255 * styled.render(cameras, index).color for index in range(3)]
    coded = read_image(folder / "lightfield.png")
    height, width = coded.shape[:2]
    # An eye: there colors and contours meet.
    y, x = int(0.5 * height), int(0.535 * width)
    crop = np.repeat(np.repeat(coded[y:y + HEIGHT // 3, x:x + 80], 3, 0), 3, 1)
    parts = [photo[:, cut:cut + 330], fitted(demo_exemplar().image), *views, crop]
    gap = np.full((HEIGHT, 8, 3), 255.0)
    row = [piece for part in parts for piece in (part[:HEIGHT], gap)][:-1]
    write_image(out, np.uint8(np.clip(np.concatenate(row, axis=1) + 0.5, 0, 255)), quality=90)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
