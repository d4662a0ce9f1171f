"""A toy bulldozer, a potted plant, a fence and balls on a plate with studs.

Thin rods, treads with gaps, a hollow blade, stripes: as hard for a reconstruction as the bulldozer
that everybody reconstructs.
"""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np

from .design import Design
from .materials import material
from .solids import ACROSS, BOX, CYLINDER, LEAF, TUBE, Model, about_y

__all__ = ["bricks"]

MATERIALS = np.array([
    material((0.14, 0.42, 0.16), gloss=0.15, sharpness=30),  # 0 plate, green
    material((0.93, 0.66, 0.05), gloss=0.25, sharpness=40),  # 1 brick, yellow
    material((0.06, 0.06, 0.07), gloss=0.20, sharpness=20),  # 2 rubber
    material((0.45, 0.46, 0.48), gloss=0.45, sharpness=50),  # 3 grey plastic
    material((0.90, 0.70, 0.06), gloss=0.25, sharpness=40, second=(0.05, 0.05, 0.05),
             frequency=5.5),  # 4 warning stripes
    material((0.70, 0.10, 0.06), gloss=0.60, sharpness=60),  # 5 red ball
    material((0.10, 0.22, 0.65), gloss=0.60, sharpness=60, second=(0.85, 0.85, 0.85),
             frequency=9.0),  # 6 striped ball
    material((0.80, 0.80, 0.82), gloss=0.70, sharpness=80),  # 7 white ball
    material((0.12, 0.50, 0.10), gloss=0.20, sharpness=25, second=(0.20, 0.62, 0.14),
             frequency=14.0),  # 8 leaf
    material((0.60, 0.27, 0.14), gloss=0.10, sharpness=15),  # 9 clay
    material((0.55, 0.36, 0.20), gloss=0.08, sharpness=15),  # 10 wood
])


def bulldozer(model: Model) -> None:
    for side in (-1, 1):
        for x in (-0.42, -0.14, 0.14, 0.42):
            model.add(CYLINDER, (x, side * 0.37, -0.38), (0.125, 0.1, 0.08), 3, 0.015, ACROSS)
            model.add(TUBE, (x, side * 0.46, -0.38), (0.06, 0.012, 0.02), 2, 0.004, ACROSS)
        straight, bend = 0.84, pi * 0.17
        for tread in range(34):
            s = tread / 34 * 2 * (straight + bend)
            turn, s = divmod(s, straight + bend)
            if s < straight:
                x, z, angle = s - 0.42, 0.17, 0.0
            else:
                angle = (s - straight) / 0.17
                x, z = 0.42 + 0.17 * sin(angle), 0.17 * cos(angle)
            x, z, angle = (x, z, angle) if turn == 0 else (-x, -z, angle + pi)
            model.add(BOX, (x, side * 0.37, z - 0.38), (0.032, 0.13, 0.02), 2, 0.006,
                      about_y(angle))
        model.rod((0.1, side * 0.53, -0.34), (0.87, side * 0.53, -0.40), 0.025, 1)
        model.rod((0.35, side * 0.17, -0.12), (0.86, side * 0.3, -0.2), 0.018, 3)
    model.add(BOX, (0, 0, -0.3), (0.46, 0.23, 0.09), 1)
    model.add(BOX, (0.24, 0, -0.08), (0.25, 0.19, 0.14), 1)
    model.studs((0.03, -0.14), (0.45, 0.14), 0.075, 1)
    for slat in range(6):
        model.add(BOX, (0.505, 0, -0.19 + 0.045 * slat), (0.02, 0.15, 0.011), 2, 0.003)
    model.add(TUBE, (0.38, -0.13, 0.19), (0.032, 0.008, 0.15), 3, 0.003)
    model.add(BOX, (-0.25, 0, -0.19), (0.24, 0.22, 0.02), 3)
    corners = [(-0.46, -0.2), (-0.46, 0.2), (-0.04, 0.2), (-0.04, -0.2)]
    for (x, y), (a, b) in zip(corners, corners[1:] + corners[:1]):
        model.rod((x, y, -0.18), (x, y, 0.42), 0.016, 2)
        model.rod((x, y, 0.1), (a, b, 0.1), 0.012, 2)
    model.add(BOX, (-0.25, 0, 0.44), (0.26, 0.25, 0.02), 1)
    model.studs((-0.46, -0.21), (-0.04, 0.21), 0.475, 1)
    model.add(BOX, (-0.31, 0, -0.1), (0.09, 0.1, 0.03), 5, 0.02)
    model.add(BOX, (-0.4, 0, 0.0), (0.02, 0.1, 0.12), 5, 0.02)
    model.add(TUBE, (-0.12, 0, 0.05), (0.07, 0.008, 0.008), 2, 0.004, about_y(-0.6))
    model.rod((-0.05, 0, -0.05), (-0.12, 0, 0.05), 0.01, 3)
    for plate in range(9):  # the blade, hollow towards the front
        angle = (plate - 4) * 0.26
        center = (1.24 - 0.36 * cos(angle), 0, -0.3 + 0.27 * sin(angle))
        model.add(BOX, center, (0.012, 0.62, 0.048), 4 if plate in (0, 8) else 1, 0.005,
                  about_y(angle * 0.9))
    for y in (-0.62, 0.62):
        model.add(BOX, (0.95, y, -0.3), (0.08, 0.012, 0.25), 4, 0.005)
    for y in (-0.16, 0.0, 0.16):  # the ripper
        model.rod((-0.45, y, -0.28), (-0.68, y, -0.25), 0.02, 3)
        model.rod((-0.68, y, -0.25), (-0.76, y, -0.54), 0.015, 3)


def surroundings(model: Model) -> None:
    model.add(BOX, (0, 0, -0.62), (1.05, 0.91, 0.03), 0)
    model.studs((-1.05, -0.91), (1.05, 0.91), -0.58, 0)
    for post in range(19):
        model.rod((-0.98 + 0.108 * post, 0.8, -0.59), (-0.98 + 0.108 * post, 0.8, -0.16), 0.012, 10)
    for z in (-0.45, -0.24):
        model.rod((-1.0, 0.8, z), (0.98, 0.8, z), 0.011, 10)
    for x, y, radius, number in ((0.62, -0.74, 0.12, 5), (0.2, -0.72, 0.1, 6),
                                 (-0.12, -0.77, 0.075, 7), (-0.9, 0.48, 0.1, 7)):
        model.ball((x, y, radius - 0.56), radius, number)
    pot = np.array([-0.75, -0.55, -0.46])
    model.add(TUBE, pot, (0.16, 0.012, 0.13), 9, 0.005)
    model.add(CYLINDER, pot - (0, 0, 0.05), (0.155, 0.1, 0.06), 10, 0.01)
    random = np.random.default_rng(3)
    for stem in range(9):
        angle = 2.4 * stem
        away = np.array([cos(angle), sin(angle), 0.0])
        foot = pot + 0.05 * away
        knee = foot + 0.1 * away + (0, 0, 0.2 + 0.035 * stem)
        tip = knee + 0.09 * away + (0, 0, 0.08 + 0.02 * stem)
        model.rod(foot, knee, 0.009, 8)
        model.rod(knee, tip, 0.008, 8)
        for place, turn in ((knee, 0.9), (0.5 * (knee + tip), -0.9), (tip, 0.0)):
            out = np.array([cos(angle + turn), sin(angle + turn), random.uniform(-0.5, 0.4)])
            out /= np.linalg.norm(out)
            flat = np.cross(out, (-sin(angle + turn), cos(angle + turn), 0.0))
            axes = np.stack([out, np.cross(flat, out), flat])
            model.add(LEAF, place + 0.1 * out, (0.11, 0.05, 0.005), 8, 0.0, axes)
            model.rows[-1][16] = 2.5


def bricks() -> Design:
    """All solids, inside a sphere of about 1.3 about the origin."""
    model = Model()
    bulldozer(model)
    surroundings(model)
    rows, profiles = model.arrays(0.9, 0.13)
    return Design(rows, profiles, MATERIALS)
