"""Vases, a bowl, a jug and plates on a cloth: large smooth surfaces with little to hold on to.

What can be seen inside a vase is a hollow; glazes are soft mirrors of a studio's lights.
"""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np

from .design import STUDIO, Design, sun
from .materials import BANDS, CLOUDS, SPECKLES, WEAVE, material
from .solids import CYLINDER, Model, moved, upright

__all__ = ["pottery"]

CLOTH_, CREAM, CELADON, COBALT, TERRA, WHITE, SLATE, OCHRE, ROSE, WOOD, PLUM, IVORY = range(12)
MATERIALS = np.array([
    material((0.80, 0.77, 0.70), 0.03, 8, (0.73, 0.68, 0.62), WEAVE, 30.0),
    material((0.90, 0.85, 0.74), 0.55, 50, (0.72, 0.58, 0.42), BANDS, 7.0, rough=0.12),
    material((0.62, 0.76, 0.68), 0.80, 70, (0.52, 0.68, 0.62), CLOUDS, 5.0, rough=0.08),
    material((0.14, 0.24, 0.50), 0.90, 80, (0.22, 0.38, 0.62), CLOUDS, 4.0, rough=0.06),
    material((0.76, 0.46, 0.32), 0.12, 14, (0.66, 0.38, 0.26), BANDS, 9.0, rough=0.4),
    material((0.93, 0.92, 0.90), 0.70, 60, (0.55, 0.65, 0.80), BANDS, 4.0, rough=0.1),
    material((0.36, 0.40, 0.44), 0.35, 25, (0.24, 0.26, 0.30), SPECKLES, 40.0, rough=0.25),
    material((0.82, 0.62, 0.26), 0.65, 45, (0.62, 0.38, 0.14), CLOUDS, 3.5, rough=0.12),
    material((0.84, 0.62, 0.58), 0.40, 30, (0.76, 0.50, 0.48), BANDS, 5.0, rough=0.2),
    material((0.62, 0.44, 0.28), 0.15, 15, (0.52, 0.35, 0.21), CLOUDS, 12.0, rough=0.4),
    material((0.36, 0.16, 0.26), 0.80, 60, (0.46, 0.22, 0.30), CLOUDS, 5.0, rough=0.1),
    material((0.90, 0.85, 0.74), 0.55, 50, rough=0.12),
])
FLOOR = -0.62


def pot(model: Model, foot, heights, radii, number: int, wall: float = 0.014) -> None:
    """A hollow thing with a bottom."""
    model.lathe(foot, heights, radii, number, wall)
    model.add(CYLINDER, moved(foot, 0, 0, 0.014), (radii[0] + 0.4 * wall, 0, 0.013), number,
              0.008)


def jug(model: Model, foot: np.ndarray, turn: float) -> None:
    """A jug with a handle and a spout."""
    pot(model, foot, (0.0, 0.08, 0.22, 0.36, 0.44, 0.52),
        (0.13, 0.19, 0.215, 0.15, 0.115, 0.14), CREAM)
    out = np.array([cos(turn), sin(turn), 0.0])
    up = np.array([0, 0, 1.0])
    points = [foot + out * (0.135 + 0.215 * sin(pi * s)**0.75 + 0.055 * s * (1 - s))
              + up * (0.475 - 0.32 * s) + 0.06 * s * out for s in np.linspace(0, 1, 29)]
    model.chain(points, 0.021, IVORY)
    # The spout is a drop that leans out of the neck.
    axis = -0.82 * out + 0.57 * up
    model.lathe(foot - 0.105 * out + 0.43 * up, (0.0, 0.04, 0.12, 0.16), (0.02, 0.06, 0.045, 0.02),
                IVORY, axes=upright(axis))


def pottery() -> Design:
    model = Model()
    model.cloth((0, 0, FLOOR - 0.045), 1.05, 0.012, 0.05, CLOTH_)
    model.add(CYLINDER, (0, 0, FLOOR - 0.16), (0.6, 0, 0.03), WOOD, 0.02)
    top = FLOOR - 0.01
    pot(model, (-0.36, 0.34, top), (0.0, 0.12, 0.42, 0.66, 0.78, 0.90, 0.98),
        (0.14, 0.22, 0.30, 0.20, 0.105, 0.10, 0.15), CELADON)
    pot(model, (0.34, 0.44, top), (0.0, 0.10, 0.30, 0.52, 0.60),
        (0.11, 0.20, 0.25, 0.17, 0.19), COBALT)
    jug(model, np.array([0.5, -0.22, top]), -0.6)
    pot(model, (-0.12, -0.42, top), (0.0, 0.03, 0.09, 0.17, 0.215),
        (0.10, 0.15, 0.24, 0.30, 0.315), WHITE, 0.017)
    pot(model, (-0.68, -0.16, top), (0.0, 0.06, 0.2, 0.3, 0.35), (0.1, 0.15, 0.17, 0.11, 0.125),
        TERRA)
    pot(model, (0.02, 0.02, top), (0.0, 0.08, 0.22, 0.36, 0.48), (0.07, 0.11, 0.085, 0.045, 0.07),
        SLATE, 0.01)
    pot(model, (0.0, 0.76, top), (0.0, 0.1, 0.2, 0.27), (0.09, 0.14, 0.12, 0.13), ROSE, 0.012)
    pot(model, (-0.55, -0.62, top), (0.0, 0.02, 0.035, 0.05), (0.13, 0.18, 0.215, 0.235), OCHRE,
        0.013)
    pot(model, (0.78, 0.2, top), (0.0, 0.06, 0.14), (0.07, 0.1, 0.11), OCHRE, 0.011)
    pot(model, (0.28, -0.76, top), (0.0, 0.05, 0.12, 0.17), (0.06, 0.095, 0.1, 0.085), PLUM, 0.011)
    # A lid with a knob beside its jar, eggs in the bowl, a pestle.
    model.lathe((0.62, -0.68, top + 0.01), (0.0, 0.012, 0.045, 0.06, 0.075, 0.1, 0.12),
                (0.115, 0.118, 0.07, 0.02, 0.018, 0.03, 0.012), ROSE)
    for x, y, number in ((-0.2, -0.45, WHITE), (-0.06, -0.34, CREAM), (-0.05, -0.5, OCHRE)):
        model.lathe((x, y, top + 0.075), (-0.075, -0.055, -0.01, 0.04, 0.072),
                    (0.012, 0.042, 0.056, 0.042, 0.012), number,
                    axes=upright(np.array([cos(9 * x), sin(9 * x), 0.3])))
    model.lathe((-0.52, -0.74, top + 0.075), (0.0, 0.05, 0.2, 0.3), (0.03, 0.034, 0.018, 0.022),
                SLATE, axes=upright(np.array([-0.3, 0.93, 0.2])))
    model.ring((-0.36, 0.34, top + 0.62), 0.222, 0.012, CELADON)
    rows, profiles = model.arrays(1.08, 0.18)
    return Design(rows, profiles, MATERIALS, np.array([sun(0.95, 5.0)]),
                  np.array([0.44, 0.46, 0.50, 0.6, 0.4]), STUDIO, cells=96)
