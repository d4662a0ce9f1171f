"""The people of the embedded data: one for the capture, another for the painted exemplars."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .head_model import HeadModel
from .kernels.head import lid_lines, mouth_lines
from .kernels.head_points import drop, silhouette
from .kernels.head_skin import brow_line

__all__ = ["PAINTED", "SITTER", "landmarks"]

SITTER = HeadModel(
    jaw_width=0.86, chin_width=0.84, chin_drop=-0.022, face_width=0.96, cheekbone=1.1,
    nose_width=0.85, nose_length=-0.010, eye_size=1.08, eye_tilt=0.014, eye_space=-0.004,
    brow_ridge=0.6, brow_height=0.004, brow_arch=1.3,
    lip_upper=1.05, mouth_width=0.96, smile=0.011, ear_size=0.95, neck_width=0.87, hairline=-0.03,
    hair_top=0.085, hair_side=0.05, hair_knot=0.17, hair_pole_y=0.74, hair_pole_z=-0.34,
    hair_relief=0.8, freckles=0.8, skin=(0.74, 0.47, 0.35), blush=(0.72, 0.28, 0.21),
    lips=(0.55, 0.16, 0.15), hair=(0.075, 0.022, 0.010), hair_light=(0.30, 0.105, 0.040),
    brow=(0.050, 0.022, 0.012))
"""A young woman with auburn hair in a knot, green eyes and freckles."""

PAINTED = HeadModel(
    skull_width=1.03, face_width=1.03, jaw_width=1.10, chin_drop=0.025, chin_width=1.15,
    chin_forward=0.012, cheekbone=1.25, cheek_hollow=0.6, nose_width=1.12, nose_length=0.020,
    nose_out=0.020, nose_hump=0.8, eye_size=0.97, eye_open=0.86, eye_tilt=0.002, brow_height=-0.016,
    brow_arch=0.5, brow_width=1.45, brow_ridge=1.7, lip_upper=0.75, lip_lower=0.85,
    mouth_width=1.08, smile=-0.003, ear_size=1.10, neck_width=1.12, folds=0.85, hairline=0.02,
    hair_top=0.095, hair_side=0.035, hair_quiff=0.06, hair_pole_y=0.50, hair_pole_z=-0.62,
    hair_twist=0.55, hair_relief=1.6, beard=0.40, skin=(0.66, 0.40, 0.28),
    blush=(0.62, 0.24, 0.17), lips=(0.46, 0.17, 0.14), iris=(0.10, 0.16, 0.24),
    brow=(0.030, 0.022, 0.018), hair=(0.030, 0.024, 0.022), hair_light=(0.22, 0.19, 0.17),
    cloth=(0.30, 0.05, 0.05))
"""A man of about fifty with swept-back hair, a strong nose and a shadow of a beard."""


def landmarks(model: HeadModel) -> NDArray[np.float64]:
    """The 68 landmarks of a modelled head.

    Brows, nose, eyes and mouth are points of the model's own curves, dropped onto the face along
    the view axis; the line of the chin is the outline of the face seen from the front, divided
    into 16 equal lengths.

    Parameters
    ----------
    model
        The head.

    Returns
    -------
    landmarks
        float64 [68, 3], iBUG order, world units, on the surface of skin or eyeballs.
    """
    return _landmarks(model).copy()


@lru_cache(maxsize=16)
def _landmarks(model: HeadModel) -> NDArray[np.float64]:
    """The same, kept: the outline of a face takes half a second."""
    points = np.zeros((68, 3))
    points[:17] = _chin_line(model)
    left = _left_side(model)
    middle = _middle(model)
    x = np.array([p[1] for p in left + middle])
    y = np.array([p[2] for p in left + middle])
    depth = drop(model, x, y)
    for (index, px, py), z in zip(left + middle, depth, strict=True):
        points[index] = px, py, z
        if index in _MIRROR:
            points[_MIRROR[index]] = -px, py, z
    return points


# Landmarks on the sitter's left (positive x) and their mirror images.
_MIRROR = {**{22 + i: 21 - i for i in range(5)},
           42: 39, 43: 38, 44: 37, 45: 36, 46: 41, 47: 40,
           34: 32, 35: 31,
           52: 50, 53: 49, 54: 48, 55: 59, 56: 58, 63: 61, 64: 60, 65: 67}


def _left_side(model: HeadModel) -> list[tuple[int, float, float]]:
    """(index, x, y) of the landmarks on the sitter's left."""
    found: list[tuple[int, float, float]] = []
    for i, t in enumerate((0.05, 0.30, 0.57, 0.84, 1.10)):
        ax = 0.066 + 0.5 * model.eye_space + 0.238 * t
        found.append((22 + i, ax, brow_line(model, ax)[0] + 0.012 * model.brow_width * (1.0 - t)))
    for index, t, upper in ((42, -0.97, True), (43, -0.36, True), (44, 0.36, True),
                            (45, 0.97, True), (46, 0.36, False), (47, -0.36, False)):
        ax = 0.184 + model.eye_space + 0.086 * model.eye_size * t
        lines = lid_lines(model, ax)
        found.append((index, ax, lines[0] if upper else lines[1]))
    base = -0.252 - model.nose_length
    found += [(34, 0.030 * model.nose_width, base - 0.006),
              (35, 0.071 * model.nose_width, base + 0.002)]
    half = 0.140 * model.mouth_width
    for index, t, line in ((52, 0.24, 0), (53, 0.62, 0), (54, 0.99, 1), (55, 0.62, 2),
                           (56, 0.28, 2), (63, 0.40, 1), (64, 0.86, 1), (65, 0.40, 1)):
        y = mouth_lines(model, half * t)[line]
        found.append((index, half * t, y - 0.004 * (index == 65)))
    return found


def _middle(model: HeadModel) -> list[tuple[int, float, float]]:
    """(index, x, y) of the landmarks in the middle of the face."""
    tip = -0.198 - model.nose_length
    found = [(27 + i, 0.0, 0.008 + (tip - 0.008) * f) for i, f in enumerate((0.0, 0.37, 0.69, 1.0))]
    found.append((33, 0.0, -0.262 - model.nose_length))
    upper, gap, lower, _ = mouth_lines(model, 0.0)
    return [*found, (51, 0.0, upper), (57, 0.0, lower), (62, 0.0, gap), (66, 0.0, gap - 0.004)]


def _chin_line(model: HeadModel) -> NDArray[np.float64]:
    """Landmarks 0 to 16, from the sitter's right ear over the chin to the left ear."""
    angles = np.radians(np.linspace(-90.0, 17.0, 200))
    outline = silhouette(model, angles, 0.0, -0.12)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(outline[:, :2], axis=0),
                                                             axis=1))])
    # Towards the ear the points of the convention lie closer together.
    wanted = length[-1] * (1.0 - np.linspace(1.0, 0.0, 9) ** 1.2)
    half = silhouette(model, np.interp(wanted, length, angles), 0.0, -0.12)
    half[0, 0] = 0.0
    mirrored = half[:0:-1] * (-1.0, 1.0, 1.0)
    return np.concatenate([mirrored, half])
