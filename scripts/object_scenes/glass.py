"""Mirrors and glass in a studio: chrome, brass, cymbals, goblets, a red box, balls of all glosses.

What is seen in them moves with the camera, and what stands behind glass is seen through it.
"""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np

from .design import STUDIO, Design, sun
from .materials import BOARDS, CHECKS, CLOUDS, SPECKLES, STRIPES, material
from .solids import ARC, BOX, CASE, CYLINDER, Model, about_z, moved, upright

__all__ = ["glass"]

(CHROME, BRASS, CYMBAL, STEEL, CLEAR, BLUE, RED, GREEN, TILE, RIM, GOLD, COPPER, LACQUER, SATIN,
 PEARL, DICE, WOOD, SKIN, SHELL, STRIPED, RUBBER, AMBER) = range(22)
MATERIALS = np.array([
    material((0.93, 0.94, 0.96), metal=1.0),
    material((0.98, 0.82, 0.46), metal=1.0, rough=0.15),
    material((0.99, 0.85, 0.50), metal=1.0, rough=0.18),
    material((0.78, 0.80, 0.83), metal=1.0, rough=0.12),
    material((0.84, 0.93, 0.91), clear=30.0),
    material((0.25, 0.45, 0.92), clear=40.0),
    material((0.95, 0.16, 0.12), clear=34.0),
    material((0.20, 0.80, 0.42), clear=45.0),
    material((0.84, 0.82, 0.77), 0.5, 60, (0.20, 0.23, 0.28), CHECKS, 5.5, metal=0.75),
    material((0.34, 0.20, 0.12), 0.3, 30, (0.55, 0.36, 0.22), BOARDS, 4.0),
    material((0.98, 0.80, 0.36), metal=1.0, rough=0.04),
    material((0.93, 0.58, 0.42), metal=1.0, rough=0.4),
    material((0.66, 0.05, 0.07), 0.9, 120, metal=0.9),
    material((0.10, 0.36, 0.40), 0.9, 30, rough=0.25),
    material((0.88, 0.84, 0.80), 0.8, 25, (0.80, 0.72, 0.80), CLOUDS, 9.0, rough=0.35),
    material((0.93, 0.90, 0.82), 0.4, 40, (0.12, 0.30, 0.62), SPECKLES, 34.0, rough=0.1),
    material((0.58, 0.36, 0.18), 0.25, 25, (0.38, 0.20, 0.09), BOARDS, 16.0),
    material((0.92, 0.90, 0.85), 0.1, 12, (0.80, 0.78, 0.72), CLOUDS, 7.0),
    material((0.10, 0.24, 0.55), 0.7, 70, (0.30, 0.55, 0.85), SPECKLES, 70.0, metal=0.9),
    material((0.95, 0.78, 0.12), 0.8, 80, (0.15, 0.10, 0.30), STRIPES, 14.0, metal=0.6),
    material((0.06, 0.06, 0.07), 0.3, 20, rough=0.2),
    material((0.95, 0.62, 0.15), clear=40.0),
])
FLOOR = -0.62


def drum(model: Model, foot, radius: float, height: float) -> None:
    """A shell of glittering lacquer between chrome hoops, with lugs and tuning rods."""
    foot = np.asarray(foot, float)
    model.add(CYLINDER, moved(foot, 0, 0, 0.5 * height), (radius, 0, 0.5 * height), SHELL, 0.0)
    model.add(CYLINDER, moved(foot, 0, 0, height), (0.96 * radius, 0, 0.012), SKIN, 0.006)
    for level in (0.035, height - 0.012):
        model.ring(moved(foot, 0, 0, level), radius + 0.008, 0.014, CHROME)
    for number in range(8):
        angle = 2 * pi * number / 8
        out = np.array([cos(angle), sin(angle), 0])
        model.rod(foot + (radius + 0.022) * out + (0, 0, 0.03),
                  foot + (radius + 0.022) * out + (0, 0, height), 0.006, CHROME)
        model.add(BOX, foot + (radius + 0.012) * out + (0, 0, 0.5 * height),
                  (0.02, 0.014, 0.045), STEEL, 0.008, about_z(angle))


def cymbal(model: Model, foot, height: float, radius: float, tilt: np.ndarray) -> None:
    """A thin bell of bronze on a stand with three legs."""
    foot = np.asarray(foot, float)
    axis = tilt / np.linalg.norm(tilt)
    top = moved(foot, 0, 0, height)
    model.rod(moved(foot, 0, 0, 0.06), moved(top, 0, 0, 0.05), 0.011, CHROME)
    model.rod(moved(foot, 0, 0, 0.06), moved(foot, 0, 0, 0.45 * height), 0.018, STEEL)
    for number in range(3):
        angle = 2 * pi * number / 3 + 0.5
        model.rod(moved(foot, 0, 0, 0.2),
                  moved(foot, 0.2 * cos(angle), 0.2 * sin(angle), 0.015), 0.009, CHROME)
    model.lathe(top, (-0.03, -0.02, 0.0, 0.012, 0.03), (radius, 0.8 * radius, 0.3 * radius,
                                                        0.25 * radius, 0.015), CYMBAL, 0.02,
                axes=upright(axis))
    model.add(CYLINDER, top + 0.05 * axis, (0.022, 0, 0.016), RUBBER, 0.006, upright(axis))


def goblet(model: Model, foot, scale: float, number: int) -> None:
    """A drinking glass: a shell on a stem."""
    foot = np.asarray(foot, float)
    model.lathe(foot, scale * np.array([0.0, 0.02, 0.06, 0.18, 0.25]),
                scale * np.array([0.12, 0.10, 0.02, 0.016, 0.03]), number)
    model.lathe(moved(foot, 0, 0, 0.255 * scale), scale * np.array([0.0, 0.03, 0.1, 0.2, 0.34]),
                scale * np.array([0.025, 0.085, 0.135, 0.145, 0.115]), number, 0.006)


def vase(model: Model, foot, number: int, heights, radii) -> None:
    model.lathe(foot, heights, radii, number, 0.008)
    model.add(CYLINDER, moved(foot, 0, 0, 0.008), (radii[0] - 0.01, 0, 0.007), number,
              0.003)


def box_of_things(model: Model, center, angle: float) -> None:
    """A closed red box; what it holds is seen through it."""
    center, axes = np.asarray(center, float), about_z(angle)
    model.add(CASE, center, (0.23, 0.17, 0.17), RED, 0.03, axes, 0.006)
    for place, radius, number in (((-0.12, -0.05, -0.105), 0.055, PEARL),
                                  ((0.11, 0.07, -0.1), 0.06, STRIPED)):
        model.ball(center + np.asarray(place) @ axes, radius, number)
    model.add(BOX, center + np.array([0.02, -0.06, -0.115]) @ axes, (0.045,) * 3, DICE, 0.012,
              about_z(angle + 0.6))
    model.ring(center + np.array([-0.07, 0.07, -0.13]) @ axes, 0.055, 0.012, GOLD,
               upright(np.array([0.3, 0.2, 1.0])))
    model.rod(center + np.array([-0.19, -0.12, -0.15]) @ axes,
              center + np.array([0.18, 0.1, 0.12]) @ axes, 0.01, WOOD)


def glass() -> Design:
    model = Model()
    model.add(BOX, (0, 0, FLOOR - 0.03), (0.98, 0.98, 0.03), TILE, 0.006)
    for side in (-1, 1):
        model.add(BOX, (side * 0.99, 0, FLOOR - 0.025), (0.025, 1.015, 0.045), RIM, 0.008)
        model.add(BOX, (0, side * 0.99, FLOOR - 0.025), (1.015, 0.025, 0.045), RIM, 0.008)
    model.ball((-0.3, -0.52, FLOOR + 0.24), 0.24, CHROME)
    model.add(CYLINDER, (0.12, -0.72, FLOOR + 0.2), (0.11, 0, 0.2), BRASS, 0.012)
    model.add(CYLINDER, (0.12, -0.72, FLOOR + 0.42), (0.06, 0, 0.025), CHROME, 0.01)
    drum(model, (-0.05, 0.38, FLOOR), 0.32, 0.36)
    drum(model, (-0.62, 0.12, FLOOR), 0.2, 0.24)
    cymbal(model, (-0.52, 0.66, FLOOR), 0.92, 0.33, np.array([0.28, -0.3, 1.0]))
    cymbal(model, (0.62, 0.62, FLOOR), 0.74, 0.27, np.array([-0.3, -0.25, 1.0]))
    goblet(model, (0.32, -0.36, FLOOR), 1.0, CLEAR)
    goblet(model, (0.52, -0.1, FLOOR), 0.82, GREEN)
    vase(model, (0.72, -0.72, FLOOR), BLUE, (0.0, 0.1, 0.24, 0.36, 0.46),
         (0.1, 0.15, 0.12, 0.055, 0.085))
    vase(model, (-0.74, -0.74, FLOOR), AMBER, (0.0, 0.12, 0.3), (0.08, 0.12, 0.15))
    for number in range(5):  # straws in the vase
        angle = 1.3 * number
        model.rod((0.72 + 0.04 * cos(angle), -0.72 + 0.04 * sin(angle), FLOOR + 0.03),
                  (0.72 - 0.1 * cos(angle), -0.72 - 0.1 * sin(angle), FLOOR + 0.75), 0.008,
                  (LACQUER, STRIPED, SATIN, WOOD, COPPER)[number])
    box_of_things(model, (0.72, 0.2, FLOOR + 0.175), 0.35)
    for x, y, radius, number in ((-0.72, -0.38, 0.11, LACQUER), (-0.45, -0.84, 0.085, SATIN),
                                 (-0.16, -0.86, 0.07, GOLD), (0.42, -0.86, 0.08, COPPER),
                                 (-0.86, -0.14, 0.075, PEARL), (0.9, -0.36, 0.07, STRIPED),
                                 (0.14, -0.18, 0.06, STEEL), (-0.12, -0.08, 0.075, DICE),
                                 (-0.06, -0.26, 0.05, LACQUER), (0.35, 0.86, 0.09, SATIN)):
        model.ball((x, y, FLOOR + radius), radius, number)
    model.add(ARC, (-0.9, 0.5, FLOOR), (0.16, 0.02, 1.0), CHROME, 0.0,
              np.array([[0, 0, 1.0], [0.3, 0.954, 0], [0.954, -0.3, 0]]), 0.0)
    model.add(BOX, (-0.86, 0.86, FLOOR + 0.06), (0.06, 0.06, 0.06), GOLD, 0.01, about_z(0.5))
    model.add(BOX, (0.9, 0.86, FLOOR + 0.12), (0.05, 0.05, 0.12), GREEN, 0.012,
              about_z(0.4))
    rows, profiles = model.arrays(0.88, 0.17)
    return Design(rows, profiles, MATERIALS, np.array([sun(0.95, 8.0)]),
                  np.array([0.42, 0.44, 0.47, 0.55, 0.45]), STUDIO, cells=128)
