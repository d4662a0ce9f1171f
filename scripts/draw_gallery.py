"""Draw the gallery: the head of a finished demo in all built-in styles, and mixtures of them.

    python scripts/draw_gallery.py demo-out docs/images/gallery

For each style it writes ``STYLE.jpg``: the painting, and the head from -40, 0 and +40 degrees. Two
more show mixtures of photo and paintings (``mixes.jpg``) and strokes from close by
(``strokes.jpg``).
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import lfportrait as lf
from lfportrait.demo import demo_exemplar, demo_styles
from lfportrait.files import write_image
from lfportrait.progress import Progress
from lfportrait_eval.metrics import arc_cameras

GAP = 8
HEIGHT = 440
QUALITY = 88


def fitted(image: np.ndarray, height: int) -> np.ndarray:
    """A picture, float in [0, 1] or uint8, at another height; uint8 [H, W, 3]."""
    if image.dtype != np.uint8:
        image = np.uint8(255 * np.clip(image, 0, 1) + 0.5)
    width = round(image.shape[1] * height / image.shape[0])
    return np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.LANCZOS))


def strip(pictures: Sequence[np.ndarray], height: int) -> np.ndarray:
    """Pictures side by side on white, all of one height; uint8 [H, W, 3]."""
    gap = np.full((height, GAP, 3), 255, np.uint8)
    row = [part for picture in pictures for part in (fitted(picture, height), gap)]
    return np.concatenate(row[:-1], axis=1)


def seen(field: lf.VoxelField, degrees: Sequence[float], height: int = HEIGHT) -> list[np.ndarray]:
    """Views of a whole bust on white; 0 degrees is the front."""
    # Rendered twice as large: outlines are smooth then. A sweep's frame touches the shoulders.
    cameras = arc_cameras(field, degrees, 2 * height)
    cameras = dataclasses.replace(cameras, focal=0.93 * cameras.focal)
    views = [fitted(field.render(cameras, view, background=1.0).color, height)
             for view in range(len(degrees))]
    # Nothing but white is left and right of a bust that is turned away from the front.
    ink = np.flatnonzero((np.min(views, axis=(0, 3)) < 250).any(axis=0))
    first, last = max(int(ink[0]) - GAP, 0), int(ink[-1]) + GAP
    return [view[:, first:last] for view in views]


def close(field: lf.VoxelField, height: int = HEIGHT) -> np.ndarray:
    """Eyes and brows from close by."""
    camera = lf.Camera.look_at((0.3, 0.15, 4.0), (0.02, 0.06, 0.7), width=2 * height,
                               height=2 * height, focal=12.5 * height)
    return field.render(camera, 0, background=1.0).color


def mixtures(styled: lf.StyledField) -> list[lf.VoxelField]:
    """Photo, half painted, painted, the photo's colors, the hair and the face in two styles."""
    _, second, third = styled.styles[:3]
    return [styled.mix(strength=0.0), styled.mix(strength=0.5), styled.mix(),
            styled.mix(style=third, keep_colors=True), styled.mix(regions={"hair": second})]


def folders(what: str, arguments: list[str] | None) -> tuple[Path, Path]:
    """Folders of a finished demo and for the pictures, from the command line."""
    parser = argparse.ArgumentParser(description=what)
    parser.add_argument("demo", type=Path, help="folder of a finished demo")
    parser.add_argument("out", type=Path, help="folder for the pictures")
    options = parser.parse_args(arguments)
    return options.demo, options.out


def write_all(out: Path, drawn: dict[str, NDArray[np.uint8]]) -> None:
    """Write pictures, uint8 [H, W, 3], by their names as JPEG files."""
    for name, picture in drawn.items():
        write_image(out / f"{name}.jpg", picture, quality=QUALITY)
        print(f"{name}.jpg: {picture.shape[1]} x {picture.shape[0]}")


def main(arguments: list[str] | None = None) -> int:
    demo, out = folders(__doc__.splitlines()[0], arguments)

    capture = lf.Capture.load(demo / "capture")
    field = lf.VoxelField.load(demo / "field.npz")
    exemplars = [demo_exemplar(name) for name in demo_styles()]
    with Progress("stylize") as progress:
        styled = lf.stylize(field, capture, exemplars, progress=progress)

    drawn = {}
    for exemplar in exemplars:
        painted = styled.mix(style=exemplar.name)
        drawn[exemplar.name] = strip([exemplar.image, *seen(painted, (-40, 0, 40))], HEIGHT)
    drawn["mixes"] = strip([seen(mix, (20,))[0] for mix in mixtures(styled)], HEIGHT)
    drawn["strokes"] = strip([close(styled.mix(style=one.name)) for one in exemplars], HEIGHT)
    write_all(out, drawn)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
