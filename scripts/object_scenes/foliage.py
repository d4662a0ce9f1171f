"""A small tree in a pot, a bird cage, springs, grass and a net about it: thin things in crowds.

Hundreds of leaves hide each other and leave gaps; wires and strings are thinner than a voxel.
"""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np

from .design import Design, sun
from .materials import BOARDS, BRICKS, CLOUDS, STRIPES, VEINS, material
from .solids import BOX, CYLINDER, Model, about_z, moved, upright

__all__ = ["foliage"]

LEAVES, YOUNG, BARK, CLAY, EARTH, STEEL, BRASS, ROPE, DECK, STONE, GRASS, PAINT, BIRD = range(13)
MATERIALS = np.array([
    material((0.13, 0.42, 0.12), 0.35, 30, (0.42, 0.62, 0.25), VEINS, 1.0, vary=0.35, thin=0.45),
    material((0.42, 0.60, 0.14), 0.35, 30, (0.70, 0.78, 0.35), VEINS, 1.0, vary=0.25, thin=0.55),
    material((0.42, 0.32, 0.24), 0.05, 10, (0.24, 0.17, 0.12), CLOUDS, 45.0),
    material((0.70, 0.36, 0.22), 0.10, 12, (0.55, 0.26, 0.16), CLOUDS, 14.0),
    material((0.20, 0.14, 0.10), 0.02, 10, (0.36, 0.26, 0.18), CLOUDS, 60.0),
    material((0.62, 0.64, 0.67), 0.80, 60),
    material((0.80, 0.60, 0.22), 0.80, 50),
    material((0.80, 0.74, 0.58), 0.05, 10, (0.55, 0.47, 0.32), STRIPES, 60.0),
    material((0.72, 0.54, 0.37), 0.12, 15, (0.50, 0.34, 0.22), BOARDS, 0.01, vary=0.25),
    material((0.62, 0.60, 0.57), 0.15, 20, (0.36, 0.35, 0.36), CLOUDS, 30.0, vary=0.45),
    material((0.52, 0.66, 0.20), 0.20, 20, vary=0.4),
    material((0.13, 0.33, 0.55), 0.50, 50, (0.90, 0.88, 0.80), BRICKS, 9.0),
    material((0.85, 0.25, 0.12), 0.30, 30, (0.95, 0.75, 0.20), CLOUDS, 20.0),
])
FLOOR = -0.62


def unit(vector) -> np.ndarray:
    vector = np.asarray(vector, float)
    return vector / np.linalg.norm(vector)


def leaf(model: Model, foot, out, up, length: float, number: int,
         random: np.random.Generator) -> None:
    """A leaf from its foot towards ``out``, its face turned up as far as it can be."""
    across = unit(np.cross(up, out) + 0.35 * random.normal(size=3))
    flat = unit(np.cross(out, across))
    axes = np.stack([out, np.cross(flat, out), flat])
    model.blade(np.asarray(foot) + 0.95 * length * out, (length, 0.42 * length, 0.0022), number,
                axes, 0.35 / length * random.uniform(0.3, 1.2), 0.28)


def twig(model: Model, start, direction, length: float, random: np.random.Generator) -> None:
    """A thin end of a branch with leaves at both sides."""
    count, turn = 22, random.uniform(0, 2 * pi)
    points = [np.asarray(start)]
    for _ in range(4):
        direction = unit(direction + 0.22 * random.normal(size=3) + (0, 0, -0.05))
        points.append(points[-1] + 0.25 * length * direction)
    model.chain(points, 0.0045, BARK)
    for number in range(count):
        along = 4.0 * (number + 1.0) / count
        piece = min(int(along), 3)
        foot = points[piece] + (along - piece) * (points[piece + 1] - points[piece])
        forward = unit(points[piece + 1] - points[piece])
        turn += 2.4
        x, y, _ = upright(forward)
        out = unit(0.75 * forward + cos(turn) * x + sin(turn) * y + (0, 0, -0.25))
        kind = YOUNG if random.uniform() < 0.12 + 0.2 * (number > count - 3) else LEAVES
        leaf(model, foot, out, (0, 0, 1.0), random.uniform(0.038, 0.062), kind, random)


def branch(model: Model, start, direction, length: float, radius: float, depth: int,
           random: np.random.Generator) -> None:
    points = [np.asarray(start)]
    for _ in range(3):
        direction = unit(direction + 0.16 * random.normal(size=3))
        points.append(points[-1] + length / 3 * direction)
    model.chain(points, radius, BARK)
    children = 3
    turn = random.uniform(0, 2 * pi)
    for child in range(children):
        x, y, z = upright(direction)
        angle = turn + 2 * pi * child / children + random.uniform(-0.4, 0.4)
        new = unit(z + 0.85 * (cos(angle) * x + sin(angle) * y) + (0, 0, 0.12))
        if depth == 0:
            twig(model, points[-1], new, random.uniform(0.24, 0.34), random)
        else:
            branch(model, points[-1 if child else -2], new, 0.78 * length, 0.62 * radius,
                   depth - 1, random)


def tree(model: Model, foot: np.ndarray) -> None:
    random = np.random.default_rng(11)
    model.lathe(foot, (0.0, 0.03, 0.30, 0.33, 0.40), (0.17, 0.18, 0.235, 0.27, 0.275), CLAY, 0.014)
    model.add(CYLINDER, moved(foot, 0, 0, 0.02), (0.165, 0.1, 0.02), CLAY)
    model.add(CYLINDER, moved(foot, 0, 0, 0.27), (0.222, 0.1, 0.06), EARTH, 0.03)
    for _ in range(26):
        angle, away = random.uniform(0, 2 * pi), 0.2 * random.uniform()**0.5
        model.ball(moved(foot, away * cos(angle), away * sin(angle), 0.335),
                   random.uniform(0.009, 0.02), STONE)
    for stem in range(3):  # braided
        points = []
        for step in range(13):
            angle = 2 * pi * stem / 3 + 0.42 * step
            away = 0.034 + 0.014 * (step == 0)
            points.append(moved(foot, away * cos(angle), away * sin(angle), 0.32 + 0.036 * step))
        model.chain(points, 0.017, BARK)
        angle += 0.5
        branch(model, points[-1], unit((cos(angle), sin(angle), 0.9)), 0.2, 0.012, 1, random)
    branch(model, moved(foot, 0, 0, 0.74), np.array([0.05, 0, 1.0]), 0.24, 0.012, 1, random)


def cage(model: Model, foot: np.ndarray) -> None:
    radius, height, wires = 0.27, 0.42, 26
    model.add(CYLINDER, moved(foot, 0, 0, 0.02), (radius + 0.02, 0.1, 0.02), PAINT)
    for number in range(wires):
        angle = 2 * pi * number / wires
        out = np.array([cos(angle), sin(angle), 0])
        model.rod(foot + radius * out + (0, 0, 0.03), foot + radius * out + (0, 0, height), 0.005,
                  STEEL)
        axes = np.stack([unit(moved(out, 0, 0, 1)), unit((0, 0, 1) - out),
                         np.cross(unit(moved(out, 0, 0, 1)), unit((0, 0, 1) - out))])
        model.arc(moved(foot, 0, 0, height), radius, 0.005, pi / 4, STEEL, axes)
    for level in (0.16, 0.29, height):
        model.ring(moved(foot, 0, 0, level), radius, 0.006, BRASS)
    model.ring(moved(foot, 0, 0, height + radius + 0.045), 0.04, 0.007, BRASS,
               upright(np.array([1.0, 0.4, 0])))
    # A swing with a bird on it.
    for side in (-0.07, 0.07):
        model.rod(moved(foot, side, 0, 0.22),
                  moved(foot, 0.3 * side, 0, height + radius - 0.01), 0.004, STEEL)
    model.rod(moved(foot, -0.08, 0, 0.22), moved(foot, 0.08, 0, 0.22), 0.007, ROPE)
    tilt = np.array([[0, -0.94, -0.342], [1.0, 0, 0], [0, -0.342, 0.94]])
    model.lathe(moved(foot, 0, 0.03, 0.27), (-0.075, -0.05, 0.0, 0.05, 0.085),
                (0.012, 0.035, 0.05, 0.035, 0.016), BIRD, axes=tilt[[1, 2, 0]] * [[1], [-1], [1]])
    model.ball(moved(foot, 0, -0.055, 0.325), 0.033, BIRD)


def spring(model: Model, foot, radius: float, wire: float, turns: int, height: float,
           number: int) -> None:
    angles = np.linspace(0, 2 * pi * turns, 22 * turns + 1)
    model.chain(np.asarray(foot) + np.stack(
        [radius * np.cos(angles), radius * np.sin(angles),
         wire + height * angles / angles[-1]], 1), wire, number)


def net(model: Model, left: np.ndarray, right: np.ndarray, height: float) -> None:
    """Strings in diamonds between two posts, sagging and bellied by wind."""
    for post in (left, right):
        model.rod(post, moved(post, 0, 0, height + 0.06), 0.018, DECK)
        model.ball(moved(post, 0, 0, height + 0.085), 0.034, PAINT)
    along = right - left
    aside = unit(np.cross(along, (0, 0, 1.0)))
    columns, rows = 22, 9

    def knot(column: int, row: int) -> np.ndarray:
        share, level = column / columns, row / rows
        hang = sin(pi * share)
        return (left + share * along + (0, 0, 0.06 + (height - 0.06) * level - 0.13 * hang * level)
                + 0.16 * hang * sin(pi * (0.15 + 0.8 * level)) * aside)

    for row in range(rows + 1):
        for column in range(row % 2, columns + 1, 2):
            for side in (-1, 1):
                if row < rows and 0 <= column + side <= columns:
                    model.rod(knot(column, row), knot(column + side, row + 1), 0.0042, ROPE)
    for row in (0, rows):
        model.chain([knot(column, row) for column in range(columns + 1)], 0.008, ROPE)


def grass(model: Model, foot: np.ndarray) -> None:
    random = np.random.default_rng(5)
    model.lathe(foot, (0.0, 0.02, 0.16), (0.09, 0.10, 0.13), PAINT, 0.01)
    model.add(CYLINDER, moved(foot, 0, 0, 0.07), (0.098, 0.1, 0.06), EARTH, 0.02)
    for _ in range(70):
        angle, away = random.uniform(0, 2 * pi), 0.07 * random.uniform()**0.5
        start = moved(foot, away * cos(angle), away * sin(angle), 0.12)
        radius, reach = random.uniform(0.2, 0.45), random.uniform(0.35, 0.6)
        # An arc that starts upwards and leans out.
        out = np.array([cos(angle), sin(angle), 0.0])
        middle = start + radius * out
        towards = cos(reach) * -out + sin(reach) * np.array([0, 0, 1.0])
        axes = np.stack([towards, sin(reach) * out + cos(reach) * np.array([0, 0, 1.0]),
                         np.cross(out, (0, 0, 1.0))])
        model.arc(middle, radius, random.uniform(0.003, 0.0048), reach, GRASS, axes)


def foliage() -> Design:
    model = Model()
    for slat in range(11):
        model.add(BOX, (0, -0.90 + 0.18 * slat, FLOOR - 0.03), (0.97, 0.08, 0.02), DECK, 0.006,
                  about_z(0.004 * (slat % 3 - 1)))
    for x in (-0.8, 0.0, 0.8):
        model.add(BOX, (x, 0, FLOOR - 0.075), (0.05, 0.97, 0.025), DECK)
    tree(model, np.array([-0.18, 0.08, FLOOR - 0.01]))
    cage(model, np.array([0.62, -0.42, FLOOR - 0.01]))
    spring(model, (-0.72, -0.62, FLOOR), 0.11, 0.0075, 9, 0.42, STEEL)
    spring(model, (-0.38, -0.78, FLOOR), 0.055, 0.005, 10, 0.3, BRASS)
    spring(model, (0.15, -0.78, FLOOR), 0.08, 0.01, 5, 0.2, PAINT)
    net(model, np.array([-0.95, 0.42, FLOOR]), np.array([0.55, 0.9, FLOOR]), 0.62)
    grass(model, np.array([0.72, 0.38, FLOOR - 0.01]))
    rows, profiles = model.arrays(0.89, 0.14)
    return Design(rows, profiles, MATERIALS, np.array([sun(1.25)]), extent=1.3, cells=160)
