"""Spectacles drawn onto a portrait through the pose of its face: positives whose mask is known."""

from dataclasses import dataclass

import cv2
import numpy as np

from lfportrait.face import face_pose

FINE = 4
"""Lines are drawn this many times finer than the picture and reduced."""


@dataclass(frozen=True)
class Worn:
    """A pair of spectacles, in units of the generic head (eyes are 0.36 apart).

    ``power`` 2 is an ellipse, 4 nearly a rectangle with round corners; ``cut`` is the height above
    the middle, in ``high``, where the rim is flat on top (half-moons).
    """

    wide: float = 0.15
    high: float = 0.15
    power: float = 2.0
    cut: float = 1.0
    apart: float = 0.38
    down: float = 0.01
    line: float = 0.016
    color: tuple = (45, 35, 35)
    shine: float = 0.4
    shadow: float = 0.2
    solid: float = 1.0
    gaps: int = 0
    temples: bool = True
    tilt: float = 0.0
    soft: float = 0.3
    wobble: float = 0.01


KINDS = {
    "round": Worn(),
    "small round": Worn(wide=0.105, high=0.11, apart=0.30, down=0.12, temples=False, line=0.014,
                        tilt=3.0),
    "oval": Worn(wide=0.15, high=0.115, apart=0.38, down=0.015, line=0.012, color=(60, 45, 40)),
    "golden": Worn(wide=0.14, high=0.135, apart=0.36, color=(225, 185, 95), line=0.014, shine=0.7,
                   shadow=0.45),
    "half-moon": Worn(wide=0.14, high=0.12, cut=0.05, apart=0.34, down=0.12, line=0.013),
    "square": Worn(wide=0.155, high=0.12, power=4.0, apart=0.385, line=0.02, color=(30, 28, 30)),
    "broken": Worn(gaps=3, color=(70, 50, 45), line=0.014, solid=0.85, wobble=0.02),
}


def _rim(worn, side, count=240):
    """The rim's curve [count, 3] on the head, from the lowest place on."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    away = (np.abs(np.cos(angle)) ** worn.power + np.abs(np.sin(angle)) ** worn.power) \
        ** (-1 / worn.power)
    x, y = worn.wide * away * np.cos(angle), worn.high * away * np.sin(angle)
    y = np.minimum(y, worn.cut * worn.high)
    return np.stack([x + side * worn.apart / 2, y, np.zeros(count)], axis=1)


def _placed(points, worn):
    """Points of the spectacles' plane on the head: tilted, down the nose, bent round the face."""
    turn = np.radians(worn.tilt)
    x = np.cos(turn) * points[:, 0] - np.sin(turn) * points[:, 1]
    y = np.sin(turn) * points[:, 0] + np.cos(turn) * points[:, 1]
    front = 0.555 + 0.8 * max(worn.down, 0) - 0.35 * x ** 2
    return np.stack([x, y - worn.down, front + points[:, 2]], axis=1)


def _curves(worn, pose):
    """Closed and open curves in the face's frame: rims, bridge, and the temples that are seen."""
    inner = worn.apart / 2 - worn.wide
    across = np.linspace(-1, 1, 30)
    rise = 0.3 * worn.high if worn.cut == 1 else worn.cut * worn.high
    bridge = np.stack([across * inner, rise + 0.03 * (1 - across ** 2), 0 * across], axis=1)
    open_ones = [_placed(bridge, worn)]
    for side in (-1, 1):
        start = _placed(np.array([[side * (worn.apart / 2 + worn.wide), 0.2 * worn.high, 0.0]]),
                        worn)[0]
        # A temple on the side that is turned away lies behind the head.
        if worn.temples and pose.rotation[2, 0] * side > -0.12:
            end = np.array([side * 0.43, 0.04, 0.12])
            share = np.linspace(0, 1, 40)[:, None]
            open_ones.append(start + share * (end - start))
    return [_placed(_rim(worn, side), worn) for side in (-1, 1)], open_ones


def put_on(image, landmarks, worn, seed=0):
    """The picture with spectacles, and their mask (rims, bridge, temples): uint8, float32 [H, W].

    The mask is of the lines themselves, without shine and shadow beside them.
    """
    rng = np.random.default_rng(seed)
    pose = face_pose(landmarks)
    rims, others = _curves(worn, pose)
    width = worn.line * pose.scale
    lines = []
    for rim in rims:
        count = len(rim)
        waves = rng.normal(size=(3, 2)) / np.arange(1, 4)[:, None]
        at = np.linspace(0, 2 * np.pi, count, endpoint=False)
        wave = sum(a * np.cos((n + 2) * at) + b * np.sin((n + 2) * at)
                   for n, (a, b) in enumerate(waves))
        middle = rim.mean(axis=0)
        rim = middle + (rim - middle) * (1 + worn.wobble * wave)[:, None]
        kept = np.ones(count, bool)
        for start in rng.integers(0, count, worn.gaps):
            kept[(start + np.arange(count // 12)) % count] = False
        lines.append((pose.project(rim), kept, True))
    lines += [(pose.project(one), np.ones(len(one), bool), False) for one in others]

    def drawn(shift, thick, soft):
        return _drawn(image.shape[:2], lines, shift, thick, soft)

    soft = worn.soft * width
    core = drawn((0, 0), width, max(soft, 0.4))
    shadow = drawn((0.5 * width, 1.1 * width), 1.2 * width, max(0.5 * width, 0.5))
    shine = drawn((-0.2 * width, -0.25 * width), 0.35 * width, max(0.6 * soft, 0.3))
    out = image.astype(np.float32)
    out *= 1 - worn.shadow * shadow[..., None]
    alpha = worn.solid * core[..., None]
    # A painted line is not of one tone.
    grain = cv2.GaussianBlur(rng.normal(size=image.shape[:2]).astype(np.float32), (0, 0),
                             max(width, 1.0))
    tone = np.float32(worn.color) * (1 + 0.6 * grain[..., None] * max(width, 1.0))
    out += alpha * (tone - out)
    light = np.clip(np.float32(worn.color) + 110, 0, 255)
    patchy = np.clip(0.5 + grain * 3 * max(width, 1.0), 0, 1)
    out += worn.shine * (patchy * shine)[..., None] * (light - out)
    return np.clip(out + 0.5, 0, 255).astype(np.uint8), core


def _drawn(shape, lines, shift, thick, soft):
    """Coverage [H, W] in [0, 1] of the curves, moved by ``shift``, as soft lines."""
    points = np.concatenate([one for one, _, _ in lines])
    room = int(4 * thick + 4 * soft) + 4
    low = np.maximum(np.floor(points.min(axis=0)).astype(int) - room, 0)
    high = np.minimum(np.ceil(points.max(axis=0)).astype(int) + room, shape[::-1])
    out = np.zeros(shape, np.float32)
    if (high <= low).any():
        return out
    size = (high - low) * FINE
    canvas = np.zeros(size[::-1], np.uint8)
    for places, kept, closed in lines:
        at = np.round(((places + shift - low) * FINE) * 16).astype(np.int32)
        count = len(at)
        for n in range(count if closed else count - 1):
            if kept[n] and kept[(n + 1) % count]:
                cv2.line(canvas, at[n].tolist(), at[(n + 1) % count].tolist(), 255,
                         max(round(thick * FINE), 1), cv2.LINE_AA, 4)
    small = cv2.resize(canvas.astype(np.float32) / 255, tuple((high - low).tolist()),
                       interpolation=cv2.INTER_AREA)
    out[low[1]:high[1], low[0]:high[0]] = cv2.GaussianBlur(small, (0, 0), soft)
    return np.clip(out, 0, 1)
