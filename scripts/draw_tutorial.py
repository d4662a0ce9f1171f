"""Draw the pictures of the tutorial (docs/first-portrait.md) from a finished demo.

    python scripts/draw_tutorial.py demo-out docs/images/first-portrait

``photos.jpg``: some of the photos. ``capture.jpg``: landmarks, matte, and the cameras from above.
``field.jpg``: a photo, the field from there, its depth. ``style.jpg``: the painting, and the head
at three strengths. ``display.jpg``: a piece of the coded picture, and what three eyes see.
"""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw

import lfportrait as lf
from draw_gallery import folders, seen, strip, write_all
from lfportrait.demo import demo_exemplar
from lfportrait.field import Rendering
from lfportrait.job.photo_check import GOOD, INK, PAPER
from lfportrait.media.pictures import read_image

HEIGHT = 320


def nearest(capture: lf.Capture, degrees: float, height: float = 0.2) -> int:
    """The photo taken nearest to a side, with the camera at a height."""
    x, y, z = capture.cameras.position.T
    return int(np.argmin(np.hypot(np.degrees(np.arctan2(x, z)) - degrees, 20 * (y - height))))


def photos(capture: lf.Capture) -> np.ndarray:
    """Five photos from side to side."""
    shots = [capture.image_float(nearest(capture, angle)) for angle in (-80, -40, 0, 40, 80)]
    return strip(shots, 260)


def from_above(capture: lf.Capture, size: int) -> np.ndarray:
    """Where the photos were taken, seen from above: the person looks down the picture."""
    scale = 2  # drawn twice as large, for smooth lines
    picture = Image.new("RGB", (scale * size, scale * size), PAPER)
    draw = ImageDraw.Draw(picture)
    place = capture.cameras.position[:, [0, 2]]
    zoom = 0.43 * scale * size / float(np.abs(place).max())
    middle = np.array([0.5, 0.4]) * scale * size
    for x, y in middle + zoom * place:
        draw.line((x, y, *middle), (222, 219, 212), scale)
    head, dot = 0.75 * zoom, 4 * scale
    draw.ellipse((*(middle - head), *(middle + head)), (236, 226, 212), INK, 2 * scale)
    nose = middle + np.array([0.0, head])
    draw.ellipse((*(nose - 2 * dot), *(nose + 2 * dot)), (236, 226, 212), INK, 2 * scale)
    for point in middle + zoom * place:
        draw.ellipse((*(point - dot), *(point + dot)), GOOD)
    return np.asarray(picture.resize((size, size), Image.Resampling.LANCZOS))


def cameras_and_mattes(capture: lf.Capture) -> np.ndarray:
    """A photo with its landmarks, its matte, and all cameras from above."""
    assert capture.landmarks is not None and capture.alphas is not None
    view = nearest(capture, 25)
    photo = Image.fromarray(np.uint8(255 * capture.image_float(view) + 0.5))
    zoom = 2 * HEIGHT / photo.height
    photo = photo.resize((round(zoom * photo.width), 2 * HEIGHT), Image.Resampling.LANCZOS)
    draw = ImageDraw.Draw(photo)
    for x, y in zoom * capture.cameras.project(capture.landmarks)[0][view]:
        draw.ellipse((x - 3, y - 3, x + 3, y + 3), (255, 60, 40))
    matte = np.repeat(capture.alphas[view][..., None], 3, axis=-1)
    return strip([np.asarray(photo), matte, from_above(capture, HEIGHT)], HEIGHT)


def depth_picture(shot: Rendering) -> np.ndarray:
    """Near is light, far is dark, nothing is white."""
    solid = shot.alpha > 0.5
    near, far = np.quantile(shot.depth[solid], [0.01, 0.99])
    grey = 0.95 - 0.75 * np.clip((shot.depth - near) / (far - near), 0, 1)
    return np.repeat(np.where(solid, grey, 1.0)[..., None], 3, axis=-1)


def field_and_depth(field: lf.VoxelField, capture: lf.Capture) -> np.ndarray:
    """A photo, the field seen from the same place, and its depth."""
    view = nearest(capture, 25)
    shot = field.render(capture.cameras, view, background=1.0)
    return strip([capture.image_float(view), shot.color, depth_picture(shot)], HEIGHT)


def strengths(styled: lf.StyledField) -> np.ndarray:
    """The painting, then the head as photographed, half painted and painted."""
    painting = demo_exemplar(styled.styles[0]).image
    mixes = [styled.mix(strength=strength) for strength in (0.0, 0.5, 1.0)]
    return strip([painting, *(seen(mix, (20,), HEIGHT)[0] for mix in mixes)], HEIGHT)


def coded_and_seen(coded: np.ndarray, display: lf.Display) -> np.ndarray:
    """Sub-pixels of the coded picture, enlarged, and what the left, middle and right eye sees."""
    height, width = coded.shape[:2]
    y, x, side = int(0.505 * height), int(0.441 * width), HEIGHT // 4  # about one eye
    parts = [np.repeat(np.repeat(coded[y:y + side, x:x + side], 4, 0), 4, 1)]
    eyes = display.eyes()
    for eye in (eyes[0], eyes[len(eyes) // 2], eyes[-1]):
        view = lf.simulate(coded, display, (float(eye),))
        tall, wide = view.shape[:2]
        top, left, part = int(0.12 * tall), int(0.5 * wide - 0.42 * tall), int(0.84 * tall)
        parts.append(view[top:top + part, left:left + part])
    return strip(parts, HEIGHT)


def main(arguments: list[str] | None = None) -> int:
    demo, out = folders(__doc__.splitlines()[0], arguments)

    capture = lf.Capture.load(demo / "capture")
    styled = lf.StyledField.load(demo / "styled.npz")
    drawn = {
        "photos": photos(capture),
        "capture": cameras_and_mattes(capture),
        "field": field_and_depth(lf.VoxelField.load(demo / "field.npz"), capture),
        "style": strengths(styled),
        "display": coded_and_seen(read_image(demo / "lightfield.png"),
                                  lf.Display.preset("generic-4k")),
    }
    write_all(out, drawn)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
