"""The people: one for the demo's photos, one for its paintings, and more."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .head_model import HeadModel
from .kernels.head import lid_lines, mouth_lines
from .kernels.head_points import drop, silhouette
from .kernels.head_skin import brow_line

__all__ = ["PAINTED", "PEOPLE", "SITTER", "landmarks"]

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


PEOPLE: dict[str, HeadModel] = {
    "sitter": SITTER,
    "painted": PAINTED,
    # A girl with a fringe and long straight hair.
    "girl": HeadModel(
        jaw_width=0.88, chin_drop=-0.050, chin_width=0.80, chin_forward=-0.012, cheekbone=0.9,
        nose_width=0.80, nose_length=-0.030, nose_out=-0.022, eye_size=1.20, eye_tilt=0.008,
        brow_ridge=0.4, brow_width=0.75, brow_arch=1.0, lip_upper=1.0, lip_lower=0.95,
        mouth_width=0.90, smile=0.010, ear_size=0.55, neck_width=0.80, hair_top=0.075,
        hair_side=0.055, hair_pole_y=0.66, hair_pole_z=-0.24, hair_relief=0.7, hair_fringe=0.045,
        hair_length=0.80, hair_front=0.21, skin=(0.78, 0.53, 0.42), blush=(0.76, 0.33, 0.27),
        lips=(0.60, 0.22, 0.20), iris=(0.10, 0.17, 0.28), brow=(0.10, 0.060, 0.032),
        hair=(0.17, 0.085, 0.034), hair_light=(0.50, 0.30, 0.13), cloth=(0.40, 0.20, 0.04)),
    # A woman of dark skin with short curly hair.
    "curly": HeadModel(
        jaw_width=0.90, chin_width=0.92, chin_drop=-0.008, face_width=0.98, cheekbone=1.2,
        nose_width=1.20, nose_out=-0.016, nose_length=-0.004, nose_hump=-0.4, eye_size=1.06,
        eye_tilt=0.014, brow_ridge=0.7, brow_arch=1.2, brow_width=0.95, lip_upper=1.35,
        lip_lower=1.25, mouth_width=1.04, smile=0.004, ear_size=0.92, neck_width=0.86,
        hairline=-0.01, hair_top=0.20, hair_side=0.15, hair_curl=0.055, skin=(0.155, 0.070, 0.040),
        blush=(0.16, 0.050, 0.032), lips=(0.17, 0.050, 0.042), iris=(0.035, 0.018, 0.010),
        brow=(0.010, 0.007, 0.006), hair=(0.010, 0.007, 0.006), hair_light=(0.060, 0.040, 0.030),
        cloth=(0.55, 0.33, 0.03)),
    # An old man with a full white beard, whose hair has gone back.
    "bearded": HeadModel(
        skull_width=1.02, face_width=1.02, jaw_width=1.04, chin_drop=0.01, cheekbone=1.2,
        cheek_hollow=0.8, nose_width=1.18, nose_length=0.022, nose_out=0.014, nose_hump=0.5,
        eye_size=0.94, eye_open=0.80, eye_tilt=-0.004, brow_height=-0.012, brow_width=1.5,
        brow_arch=0.7, brow_ridge=1.6, lip_upper=0.7, lip_lower=0.85, ear_size=1.16,
        neck_width=1.06, folds=1.0, hair_recede=0.22, hair_top=0.030, hair_side=0.050,
        hair_pole_y=0.58, hair_pole_z=-0.40, hair_relief=1.0, beard=0.25, beard_full=0.075,
        beard_length=0.11, skin=(0.70, 0.44, 0.34), blush=(0.68, 0.27, 0.21),
        lips=(0.50, 0.21, 0.18), iris=(0.12, 0.20, 0.30), brow=(0.30, 0.28, 0.26),
        hair=(0.50, 0.48, 0.45), hair_light=(0.80, 0.79, 0.76), cloth=(0.05, 0.07, 0.16)),
    # A man with spectacles.
    "spectacles": HeadModel(
        face_width=0.99, jaw_width=1.02, chin_drop=0.012, chin_width=1.0, nose_length=0.010,
        nose_out=0.006, nose_hump=0.3, eye_size=0.98, eye_open=0.92, brow_width=1.2,
        brow_height=0.006, brow_ridge=1.2, brow_arch=0.7, lip_upper=0.8, lip_lower=0.9,
        neck_width=1.04, folds=0.35, hairline=0.01, hair_top=0.10, hair_side=0.040,
        hair_quiff=0.03, hair_pole_y=0.60, hair_pole_z=-0.45, hair_twist=0.3, hair_relief=1.3,
        beard=0.18, spectacles=0.012, skin=(0.72, 0.46, 0.34), blush=(0.70, 0.30, 0.22),
        lips=(0.52, 0.20, 0.17), iris=(0.09, 0.06, 0.03), brow=(0.050, 0.030, 0.020),
        hair=(0.055, 0.030, 0.017), hair_light=(0.22, 0.13, 0.075), cloth=(0.06, 0.14, 0.08)),
    # A woman of pale skin with long wavy hair.
    "wavy": HeadModel(
        jaw_width=0.88, chin_width=0.86, chin_drop=-0.006, face_width=0.97, cheekbone=1.15,
        cheek_hollow=0.3, nose_width=0.88, nose_length=0.002, eye_size=1.05, eye_tilt=0.012,
        brow_ridge=0.6, brow_arch=1.4, brow_width=0.85, lip_upper=1.1, lip_lower=1.1,
        mouth_width=1.0, smile=0.002, ear_size=0.55, neck_width=0.85, hairline=0.0, hair_top=0.10,
        hair_side=0.085, hair_pole_y=0.46, hair_pole_z=0.44, hair_relief=1.1, hair_length=0.93,
        hair_front=0.17, hair_wave=0.07, hair_parting=0.025, skin=(0.88, 0.69, 0.60),
        blush=(0.84, 0.45, 0.40), lips=(0.62, 0.17, 0.17), iris=(0.14, 0.24, 0.24),
        brow=(0.16, 0.085, 0.045), hair=(0.28, 0.15, 0.055), hair_light=(0.72, 0.50, 0.25),
        cloth=(0.10, 0.02, 0.06)),
    # A man of East Asian looks with short black hair.
    "short": HeadModel(
        skull_width=1.02, face_width=1.06, jaw_width=1.03, chin_width=0.98, chin_drop=-0.004,
        cheekbone=1.35, nose_width=1.06, nose_out=-0.014, nose_length=-0.004, nose_hump=-0.9,
        eye_size=1.0, eye_open=0.72, eye_tilt=0.024, lid_fold=0.25, eye_space=0.006,
        brow_ridge=0.5, brow_arch=0.8, brow_width=1.15, brow_height=0.010, lip_upper=0.95,
        lip_lower=1.0, neck_width=1.0, hairline=-0.01, hair_top=0.105, hair_side=0.030,
        hair_quiff=0.035, hair_pole_y=0.60, hair_pole_z=-0.42, hair_relief=1.5,
        skin=(0.72, 0.49, 0.34), blush=(0.70, 0.34, 0.23), lips=(0.54, 0.22, 0.18),
        iris=(0.030, 0.016, 0.008), brow=(0.016, 0.013, 0.012), hair=(0.012, 0.010, 0.010),
        hair_light=(0.075, 0.070, 0.072), cloth=(0.30, 0.31, 0.33)),
    # A woman whose eyes are closed.
    "asleep": HeadModel(
        jaw_width=0.92, chin_width=0.90, face_width=0.98, nose_width=0.95, nose_hump=0.35,
        nose_length=0.006, eye_size=1.04, eye_open=-0.70, eye_tilt=0.006, brow_ridge=0.7,
        brow_arch=1.1, brow_width=1.05, lip_upper=1.05, lip_lower=1.05, mouth_width=0.97,
        smile=0.006, neck_width=0.88, hairline=-0.005, hair_top=0.07, hair_side=0.045,
        hair_knot=0.14, hair_pole_y=0.20, hair_pole_z=-0.72, hair_relief=0.7,
        skin=(0.56, 0.33, 0.21), blush=(0.56, 0.23, 0.15), lips=(0.44, 0.15, 0.12),
        brow=(0.030, 0.018, 0.012), hair=(0.030, 0.017, 0.011), hair_light=(0.15, 0.085, 0.05),
        cloth=(0.45, 0.42, 0.36)),
}
"""All of them by name, as a painter's trials and `scripts/film_head.py` use them."""


def landmarks(model: HeadModel) -> NDArray[np.float64]:
    """The 68 landmarks of a modelled head.

    Brows, nose, eyes and mouth are points of the model's own curves, dropped onto the face along
    the view axis; the line of the chin is the outline of the face seen from the front, divided
    into 16 equal lengths.

    Parameters
    ----------
    model : The head.

    Returns
    -------
    landmarks : float64 [68, 3], iBUG order, world units, on the surface of skin or eyeballs.
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
