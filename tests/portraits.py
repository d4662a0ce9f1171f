"""A face drawn with a few shapes and a ball of a head: small inputs whose truth is known."""

import functools
from dataclasses import replace

import numpy as np

from lfportrait.example import Exemplar


def _arc(count, x, y, rx, ry, start, end):
    angle = np.radians(np.linspace(start, end, count))
    return np.stack([x + rx * np.cos(angle), y + ry * np.sin(angle)], axis=1)


def _canonical():
    """68 landmarks of a frontal face in a square of side 2: x right, y down, brows near -0.3."""
    jaw = _arc(17, 0, -0.15, 0.62, 1.0, 175, 5)
    brows = np.concatenate([np.stack([np.linspace(-0.47, -0.12, 5),
                                      [-0.30, -0.36, -0.38, -0.37, -0.34]], axis=1),
                            np.stack([np.linspace(0.12, 0.47, 5),
                                      [-0.34, -0.37, -0.38, -0.36, -0.30]], axis=1)])
    bridge = np.stack([np.zeros(4), np.linspace(-0.18, 0.15, 4)], axis=1)
    base = np.stack([np.linspace(-0.13, 0.13, 5), [0.21, 0.23, 0.25, 0.23, 0.21]], axis=1)
    eyes = [_arc(7, side * 0.28, -0.17, 0.11, 0.05, 180, 540)[:6] for side in (-1, 1)]
    outer = _arc(13, 0, 0.47, 0.24, 0.10, 180, 540)[:12]
    inner = _arc(9, 0, 0.47, 0.17, 0.03, 180, 540)[:8]
    return np.concatenate([jaw, brows, bridge, base, *eyes, outer, inner])


CANONICAL = _canonical()


def drawn_face(height, width, seed=0, skin=(225, 180, 150), hair=(60, 40, 30),
               ground=(90, 130, 170)):
    """An exemplar of the given size: flat colors with a little grain, its mask known."""
    image, landmarks, mask = _drawn(height, width, seed, tuple(skin), tuple(hair), tuple(ground))
    return Exemplar(image.copy(), landmarks.copy(), "drawn", mask.copy())


@functools.lru_cache(maxsize=32)  # a fiftieth of a second, and many tests draw the same
def _drawn(height, width, seed, skin, hair, ground):
    scale = 0.36 * min(width / 1.15, height / 1.55)
    centre = np.array([width / 2, height * 0.52])
    y, x = np.mgrid[:height, :width] + 0.5
    x, y = (x - centre[0]) / scale, (y - centre[1]) / scale
    face = np.hypot(x / 0.62, (y + 0.15) / np.where(y > -0.15, 1.0, 0.65)) < 1
    head = np.hypot(x / 0.78, (y + 0.2) / np.where(y > -0.2, 0.7, 1.05)) < 1
    body = (np.abs(x) < 0.35 + np.clip(y - 1.1, 0, 9) * 2) & (y > 0.4)
    image = np.empty((height, width, 3))
    image[:] = ground
    image[body] = (160, 60, 50)
    image[head & ~face] = hair
    image[face] = skin
    landmarks = CANONICAL * scale + centre
    for part, color in ((slice(36, 42), (250, 250, 250)), (slice(42, 48), (250, 250, 250)),
                         (slice(48, 60), (190, 60, 70))):
        points = CANONICAL[part]
        middle, half = points.mean(axis=0), np.ptp(points, axis=0) / 2
        image[np.hypot((x - middle[0]) / half[0], (y - middle[1]) / half[1]) < 1] = color
    for part in (slice(17, 22), slice(22, 27)):
        points = CANONICAL[part]
        line = np.interp(x, points[:, 0], points[:, 1])
        image[(np.abs(y - line) < 0.04) & (x > points[0, 0]) & (x < points[-1, 0])] = hair
    image += np.random.default_rng(seed).normal(0, 6, image.shape)
    mask = (face | head | body).astype(np.float32)
    return np.clip(image, 0, 255).astype(np.uint8), landmarks, mask


def with_lines(exemplar, step):
    """The exemplar in one color, with dark lines across."""
    image = np.empty_like(exemplar.image)
    image[:] = 230, 180, 150
    for row in range(3):
        image[row::step] = 30, 20, 20
    return replace(exemplar, image=image)


def _on_ball(points, radius=0.6):
    """Landmarks of the square lifted onto a ball: frontal projection keeps them in place."""
    x, y = 1.58 * radius * points[:, 0], -0.7 * radius * (points[:, 1] + 0.3)
    z = np.sqrt(np.maximum(radius ** 2 - x ** 2 - y ** 2, 0))
    return np.stack([x, y, z], axis=1)


HEAD_LANDMARKS = _on_ball(CANONICAL)


def ball_head(angles, heights, radius=0.6):
    """Points [len(heights), len(angles), 3]: a ball above -0.75 radius, a neck and body below.

    ``angles`` are yaws in radians (0 = the face), ``heights`` in units of ``radius``, from the
    lowest; rows run from the top down as in a picture.
    """
    y = np.sort(np.asarray(heights, float))[::-1] * radius
    ring = np.where(y > -0.75 * radius, np.sqrt(np.maximum(radius ** 2 - y ** 2, 1e-6)),
                    0.66 * radius + np.maximum(-y - 1.3 * radius, 0))
    return np.stack([ring[:, None] * np.sin(angles), np.repeat(y[:, None], len(angles), 1),
                     ring[:, None] * np.cos(angles)], axis=-1)
