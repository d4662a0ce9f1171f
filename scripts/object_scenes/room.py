"""A table in the middle of a furnished room, seen by someone who walks around it.

Everything is behind something: papered and brick walls with pictures, boards, shelves with books, a
window, a chair, lamps. What is near is sharp and moves fast, what is far moves little.
"""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np

from .design import INDOORS, Design, lamp
from .materials import (
    BANDS,
    BOARDS,
    BRICKS,
    CHECKS,
    CLOUDS,
    PAPER,
    POSTER,
    PRINT,
    SPECKLES,
    SPINE,
    VEINS,
    WEAVE,
    material,
)
from .solids import ACROSS, BOX, CYLINDER, TUBE, Model, about_z, moved, upright

__all__ = ["room"]

(FLOOR_, PAPERED, BRICKED, PLASTER, TILED, OAK, WALNUT, PRINT_, PICTURE, MODERN, RUG, WHITE, GREEN,
 CLAY, CHINA, APPLE, ORANGE, METAL, PANE, FRAME, SHADE, FABRIC, BULB, CEILING, LEAFY,
 *BOOKS) = range(35)
COLORS = ((0.62, 0.14, 0.12), (0.13, 0.25, 0.45), (0.15, 0.38, 0.25), (0.75, 0.62, 0.25),
          (0.35, 0.16, 0.35), (0.85, 0.82, 0.74), (0.15, 0.15, 0.17), (0.78, 0.42, 0.15),
          (0.30, 0.52, 0.56), (0.55, 0.36, 0.24))
MATERIALS = np.array([
    material((0.60, 0.42, 0.27), 0.15, 20, (0.36, 0.22, 0.13), BOARDS, 5.0),
    material((0.72, 0.76, 0.70), 0.02, 8, (0.40, 0.50, 0.46), PAPER, 3.2),
    material((0.66, 0.34, 0.26), 0.03, 8, (0.75, 0.72, 0.68), BRICKS, 3.4),
    material((0.82, 0.74, 0.60), 0.02, 8, (0.74, 0.64, 0.50), CLOUDS, 2.2),
    material((0.88, 0.90, 0.88), 0.45, 40, (0.32, 0.50, 0.56), CHECKS, 4.0),
    material((0.72, 0.52, 0.32), 0.20, 25, (0.48, 0.31, 0.17), BOARDS, 4.5),
    material((0.42, 0.27, 0.18), 0.20, 25, (0.26, 0.15, 0.09), BOARDS, 3.0),
    material((0.88, 0.86, 0.80), 0.04, 10, (0.14, 0.14, 0.16), PRINT, 55.0),
    material((0.5, 0.5, 0.5), 0.10, 20, None, POSTER, 3.0),
    material((0.5, 0.5, 0.5), 0.10, 20, None, POSTER, 9.0),
    material((0.56, 0.18, 0.16), 0.01, 8, (0.86, 0.76, 0.55), PAPER, 4.5),
    material((0.90, 0.89, 0.86), 0.20, 25, (0.86, 0.85, 0.82), CLOUDS, 6.0),
    material((0.24, 0.42, 0.34), 0.50, 50, (0.82, 0.80, 0.70), BANDS, 6.0),
    material((0.70, 0.38, 0.25), 0.08, 12, (0.58, 0.30, 0.19), CLOUDS, 14.0),
    material((0.90, 0.90, 0.92), 0.55, 60, (0.20, 0.32, 0.62), SPECKLES, 42.0),
    material((0.68, 0.12, 0.10), 0.40, 40, (0.80, 0.62, 0.20), CLOUDS, 14.0, vary=0.25),
    material((0.92, 0.52, 0.10), 0.20, 25, (0.86, 0.44, 0.06), SPECKLES, 90.0, vary=0.15),
    material((0.58, 0.58, 0.60), 0.80, 60),
    material((0.80, 0.90, 1.00), 0.0, 10, (0.96, 0.98, 1.00), CLOUDS, 1.2, glow=1.3),
    material((0.90, 0.90, 0.88), 0.20, 25),
    material((0.93, 0.84, 0.62), 0.03, 10, (0.85, 0.72, 0.48), BANDS, 9.0, glow=0.45, thin=0.4),
    material((0.28, 0.36, 0.52), 0.02, 8, (0.78, 0.74, 0.62), WEAVE, 34.0),
    material((1.00, 0.95, 0.80), 0.0, 10, glow=1.6),
    material((0.90, 0.89, 0.86), 0.0, 8, (0.84, 0.83, 0.80), CLOUDS, 3.0),
    material((0.14, 0.42, 0.16), 0.25, 25, (0.45, 0.62, 0.30), VEINS, 1.0, vary=0.3, thin=0.3),
    *(material(color, 0.08, 15, (0.92, 0.84, 0.58) if sum(color) < 1.6 else (0.2, 0.1, 0.1), SPINE,
               1.0, vary=0.2) for color in COLORS)])
LOW, HIGH, TOP = -0.86, 1.75, -0.16  # floor, ceiling, table
WEST, EAST, SOUTH, NORTH = -3.0, 2.7, -2.6, 3.3


def walls(model: Model) -> None:
    middle = (0.5 * (WEST + EAST), 0.5 * (SOUTH + NORTH), 0.5 * (LOW + HIGH))
    half = (0.5 * (EAST - WEST), 0.5 * (NORTH - SOUTH), 0.5 * (HIGH - LOW))
    wide = half[0] + 0.1, half[1] + 0.1
    model.add(BOX, (middle[0], middle[1], LOW - 0.05), (*wide, 0.05), FLOOR_, 0.0)
    model.add(BOX, (middle[0], middle[1], HIGH + 0.05), (*wide, 0.05), CEILING, 0.0)
    for x, side, number in ((WEST, -1, PAPERED), (EAST, 1, BRICKED)):
        model.add(BOX, (x + 0.05 * side, middle[1], middle[2]), (0.05, wide[1], half[2] + 0.1),
                  number, 0.0)
        model.add(BOX, (x - 0.01 * side, middle[1], LOW + 0.07), (0.012, half[1], 0.07), WHITE)
    for y, side, number in ((SOUTH, -1, PLASTER), (NORTH, 1, PAPERED)):
        model.add(BOX, (middle[0], y + 0.05 * side, middle[2]), (wide[0], 0.05, half[2] + 0.1),
                  number, 0.0)
        model.add(BOX, (middle[0], y - 0.01 * side, LOW + 0.07), (half[0], 0.012, 0.07), WHITE)
    # Tiles behind a washstand, beams, a rug.
    model.add(BOX, (-1.9, SOUTH, LOW + 0.6), (0.9, 0.02, 0.6), TILED)
    for x in (-1.9, -0.2, 1.5):
        model.add(BOX, (x, middle[1], HIGH - 0.06), (0.08, half[1], 0.07), WALNUT)
    model.add(BOX, (0.1, 0.1, LOW + 0.006), (1.5, 1.15, 0.008), RUG, 0.004, about_z(0.12))


def hangings(model: Model) -> None:
    """Pictures, posters, a clock and a window."""
    along_x, along_y = np.array([[0, 1.0, 0], [0, 0, 1.0], [1.0, 0, 0]]), \
        np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
    for y, z, a, b, number in ((-1.6, 0.55, 0.42, 0.55, PICTURE), (-0.5, 0.75, 0.34, 0.26, MODERN),
                               (0.45, 0.5, 0.36, 0.5, MODERN), (1.4, 0.72, 0.3, 0.3, PICTURE),
                               (-0.5, 0.18, 0.3, 0.2, PICTURE), (2.4, 0.55, 0.42, 0.32, MODERN)):
        model.add(BOX, (WEST + 0.02, y, z), (a, b, 0.02), number, 0.0, along_x)
    for y, z, a, b, number in ((-1.9, 0.6, 0.4, 0.4, MODERN), (2.6, 0.6, 0.36, 0.5, PICTURE)):
        model.add(BOX, (EAST - 0.02, y, z), (a, b, 0.02), number, 0.0, along_x)
    for x, z, a, b, number in ((-1.9, 0.95, 0.5, 0.36, PICTURE), (-0.5, 0.6, 0.32, 0.45, PRINT_),
                               (0.4, 0.7, 0.36, 0.36, MODERN)):
        model.add(BOX, (x, SOUTH + 0.02, z), (a, b, 0.02), number, 0.0, along_y)
    model.add(TUBE, (1.3, SOUTH + 0.03, 0.9), (0.24, 0.02, 0.03), WALNUT, 0.01, ACROSS)
    model.add(CYLINDER, (1.3, SOUTH + 0.015, 0.9), (0.23, 0, 0.015), WHITE, 0.0, ACROSS)
    for angle, length in ((0.6, 0.13), (-1.4, 0.19)):
        model.rod((1.3, SOUTH + 0.04, 0.9),
                  (1.3 + length * sin(angle), SOUTH + 0.04, 0.9 + length * cos(angle)), 0.009,
                  BOOKS[6])
    # The window: a bright pane with bars, a sill and curtains.
    model.add(BOX, (EAST, 0.35, 0.6), (0.02, 0.95, 0.7), PANE, 0.0)
    for y in (-0.62, 0.03, 0.67, 1.32):
        model.add(BOX, (EAST - 0.02, y, 0.6), (0.03, 0.035, 0.74), FRAME)
    for z in (-0.12, 0.62, 1.32):
        model.add(BOX, (EAST - 0.02, 0.35, z), (0.03, 1.0, 0.035), FRAME)
    model.add(BOX, (EAST - 0.1, 0.35, -0.17), (0.12, 1.1, 0.02), OAK)
    for side in (-1, 1):
        for fold in range(6):
            y = 0.35 + side * (0.98 + 0.07 * fold)
            model.add(CYLINDER, (EAST - 0.09 - 0.02 * (fold % 2), y, 0.45), (0.05, 0, 0.98),
                      FABRIC, 0.01)


def books(model: Model, start, along, deep, width: float, height: float,
          random: np.random.Generator) -> None:
    """A row of books that stand on a board, some leaning or missing."""
    place, along, deep = 0.0, np.asarray(along, float), np.asarray(deep, float)
    axes = np.stack([along, deep, np.cross(along, deep)])
    while place < width - 0.06:
        thick = random.uniform(0.012, 0.034)
        tall, reach = height * random.uniform(0.55, 0.92), random.uniform(0.09, 0.125)
        if random.uniform() < 0.9:
            center = np.asarray(start) + (place + thick) * along + (reach - 0.11) * deep
            model.add(BOX, moved(center, 0, 0, 0.5 * tall), (thick, reach, 0.5 * tall),
                      BOOKS[random.integers(len(BOOKS))], 0.004, axes)
        place += 2 * thick + (0.12 if random.uniform() < 0.06 else 0.003)


def shelves(model: Model) -> None:
    random = np.random.default_rng(21)
    for x, width in ((-1.6, 1.5), (1.2, 1.3)):  # against the north wall
        for side in (0, width):
            model.add(BOX, (x + side, NORTH - 0.16, 0.0), (0.02, 0.16, 0.84), WALNUT)
        for z in (-0.8, -0.4, 0.0, 0.4, 0.8):
            model.add(BOX, (x + 0.5 * width, NORTH - 0.16, z), (0.5 * width, 0.16, 0.016), WALNUT)
            if z < 0.8:
                books(model, (x + 0.04, NORTH - 0.16, z + 0.016), (1.0, 0, 0), (0, -1.0, 0),
                      width - 0.08, 0.36, random)
    for x, number in ((-1.3, CHINA), (-0.7, GREEN), (1.6, CLAY), (2.1, CHINA)):
        model.lathe((x, NORTH - 0.16, 0.815), (0.0, 0.08, 0.2, 0.3), (0.06, 0.11, 0.09, 0.06),
                    number, 0.012)


def chair(model: Model, place, turn: float, number: int) -> None:
    place = np.asarray(place, float)
    axes = about_z(turn)
    seat = LOW + 0.44

    def at(x: float, y: float, z: float) -> np.ndarray:
        return place + np.array([x, y, 0]) @ axes + (0, 0, z)

    model.add(BOX, at(0, 0, seat), (0.2, 0.2, 0.018), number, 0.01, axes)
    model.add(BOX, at(0, 0, seat + 0.03), (0.18, 0.18, 0.022), FABRIC, 0.02, axes)
    for x in (-0.17, 0.17):
        model.rod(at(x, -0.17, LOW), at(x, -0.17, seat), 0.018, number)
        model.rod(at(x, 0.18, LOW), at(x, 0.22, seat + 0.42), 0.018, number)
    for z in (0.2, 0.3, 0.4):
        model.add(BOX, at(0, 0.2 + 0.02 * z / 0.4, seat + z), (0.17, 0.01, 0.028), number, 0.006,
                  axes)
    model.rod(at(-0.17, 0, LOW + 0.2), at(0.17, 0, LOW + 0.2), 0.011, number)


def furniture(model: Model) -> None:
    """The table, chairs under it, a cupboard, a stool, lamps."""
    model.add(BOX, (0, 0, TOP - 0.025), (0.68, 0.46, 0.022), OAK, 0.01)
    model.add(BOX, (0, 0, TOP - 0.09), (0.6, 0.38, 0.04), OAK)
    for x in (-0.6, 0.6):
        for y in (-0.38, 0.38):
            model.lathe((x, y, LOW), (0.0, 0.1, 0.3, 0.5, 0.62), (0.022, 0.03, 0.024, 0.038, 0.034),
                        OAK)
    chair(model, (-0.2, 0.5, 0.0), 0.1, WALNUT)
    chair(model, (0.22, -0.46, 0.0), pi - 0.15, WALNUT)
    chair(model, (-2.3, 2.2, 0.0), 0.8, OAK)
    model.add(BOX, (WEST + 0.28, -0.6, LOW + 0.36), (0.26, 0.9, 0.36), WALNUT, 0.01)
    for y in (-1.2, -0.6, 0.0):
        model.add(BOX, (WEST + 0.545, y, LOW + 0.38), (0.012, 0.27, 0.28), OAK, 0.006)
        model.ball((WEST + 0.575, y + 0.2, LOW + 0.4), 0.022, METAL)
    model.lathe((WEST + 0.3, -1.1, LOW + 0.72), (0.0, 0.1, 0.28, 0.4), (0.08, 0.15, 0.11, 0.07),
                GREEN, 0.014)
    model.rod((WEST + 0.3, 0.0, LOW + 0.73), (WEST + 0.3, 0.0, LOW + 1.05), 0.014, METAL)
    model.lathe((WEST + 0.3, 0.0, LOW + 1.0), (0.0, 0.26), (0.19, 0.1), SHADE, 0.006)
    model.lathe((0.0, 0.0, 1.36), (0.0, 0.12, 0.2), (0.3, 0.17, 0.04), GREEN, 0.01)
    model.ball((0.0, 0.0, 1.43), 0.05, BULB)
    model.rod((0, 0, 1.5), (0, 0, HIGH), 0.008, METAL)
    model.add(BOX, (-1.9, SOUTH + 0.25, LOW + 0.38), (0.6, 0.25, 0.02), OAK)
    for x in (-2.4, -1.4):
        model.rod((x, SOUTH + 0.4, LOW), (x, SOUTH + 0.4, LOW + 0.37), 0.025, WALNUT)
    model.lathe((-1.7, SOUTH + 0.25, LOW + 0.4), (0.0, 0.05, 0.16), (0.1, 0.2, 0.26), CHINA, 0.014)
    random = np.random.default_rng(8)
    foot = np.array([2.15, -2.0, LOW])
    model.lathe(foot, (0.0, 0.2, 0.4), (0.16, 0.22, 0.24), CLAY, 0.016)
    model.add(CYLINDER, moved(foot, 0, 0, 0.2), (0.2, 0, 0.14), WALNUT)
    for stem in range(14):
        plant_leaf(model, moved(foot, 0, 0, 0.34), 2.4 * stem, random.uniform(0.35, 0.9),
                   random.uniform(0.2, 0.34))


def plant_leaf(model: Model, foot: np.ndarray, turn: float, height: float, length: float) -> None:
    out = np.array([cos(turn), sin(turn), 0.55])
    out /= np.linalg.norm(out)
    knee = moved(foot, 0.25 * height * cos(turn), 0.25 * height * sin(turn), height)
    model.rod(foot, knee, 0.08 * length**1.5, LEAFY)
    across = np.array([-sin(turn), cos(turn), 0.0])
    flat = np.cross(out, across)
    model.blade(knee + 0.9 * length * out, (length, 0.42 * length, 0.012 * length), LEAFY,
                np.stack([out, across, flat]), 0.5 / length, 0.2)


def still_life(model: Model) -> None:
    """What lies on the table: this is what the cameras look at."""
    model.add(BOX, (0.08, 0.02, TOP + 0.001), (0.3, 0.2, 0.004), FABRIC, 0.002, about_z(0.25))
    model.lathe((0.05, 0.02, TOP + 0.01), (0.0, 0.02, 0.07, 0.13), (0.07, 0.11, 0.17, 0.2), CHINA,
                0.012)
    model.add(CYLINDER, (0.05, 0.02, TOP + 0.02), (0.08, 0, 0.01), CHINA)
    for x, y, z, number in ((0.0, 0.06, 0.09, APPLE), (0.11, 0.05, 0.09, ORANGE),
                            (0.05, -0.06, 0.09, ORANGE), (0.06, 0.02, 0.16, APPLE),
                            (-0.06, -0.03, 0.11, APPLE), (0.14, -0.04, 0.11, APPLE)):
        model.ball((x, y, TOP + z), 0.056, number)
        model.rod((x, y, TOP + z + 0.05), (x + 0.01, y, TOP + z + 0.072), 0.004, WALNUT)
    for number, (turn, half) in enumerate(((0.3, 0.12), (0.1, 0.11), (0.55, 0.1), (0.2, 0.085))):
        model.add(BOX, (-0.42, 0.16, TOP + 0.018 + 0.034 * number), (half, 0.75 * half, 0.015),
                  BOOKS[2 * number], 0.003, about_z(turn))
    model.lathe((-0.42, 0.16, TOP + 0.137), (0.0, 0.03, 0.075), (0.028, 0.036, 0.036), GREEN, 0.005)
    model.arc((-0.378, 0.16, TOP + 0.174), 0.024, 0.005, 0.55 * pi, GREEN,
              np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]))
    # A teapot, cups on saucers, a newspaper, a candlestick, building bricks, a plant.
    pot = np.array([0.42, 0.16, TOP])
    model.lathe(pot, (0.0, 0.04, 0.11, 0.16, 0.175, 0.19), (0.055, 0.095, 0.1, 0.05, 0.018, 0.022),
                WHITE)
    model.arc(moved(pot, 0.12, 0, 0.1), 0.05, 0.011, 0.62 * pi, WHITE,
              np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]))
    model.chain([moved(pot, -0.08 - 0.11 * s, 0, 0.07 + 0.09 * s * s)
                 for s in np.linspace(0, 1, 7)], 0.016, WHITE)
    for x, y in ((0.3, -0.24), (-0.1, 0.32)):
        model.lathe((x, y, TOP), (0.0, 0.008, 0.018), (0.045, 0.065, 0.08), CHINA, 0.006)
        model.lathe((x, y, TOP + 0.012), (0.0, 0.02, 0.065), (0.025, 0.04, 0.045), CHINA, 0.005)
        model.add(CYLINDER, (x, y, TOP + 0.045), (0.038, 0, 0.004), WALNUT)
    model.add(BOX, (-0.3, -0.22, TOP + 0.004), (0.2, 0.14, 0.005), PRINT_, 0.002, about_z(-0.35))
    stick = np.array([-0.02, -0.3, TOP])
    model.lathe(stick, (0.0, 0.012, 0.03, 0.12, 0.14, 0.15),
                (0.055, 0.05, 0.014, 0.012, 0.03, 0.02), METAL)
    model.rod(moved(stick, 0, 0, 0.15), moved(stick, 0, 0, 0.27), 0.012, WHITE)
    for number, (x, y, z) in enumerate(((0.52, -0.16, 0), (0.585, -0.15, 0), (0.55, -0.155, 1),
                                        (0.5, -0.28, 0), (0.58, -0.31, 0))):
        model.add(BOX, (x, y, TOP + 0.03 + 0.06 * z), (0.03,) * 3, BOOKS[(3 * number) % 8], 0.004,
                  about_z(0.3 * number))
    model.lathe((-0.55, -0.1, TOP), (0.0, 0.06, 0.11), (0.045, 0.06, 0.065), CLAY, 0.007)
    model.add(CYLINDER, (-0.55, -0.1, TOP + 0.05), (0.055, 0, 0.04), WALNUT)
    for stem in range(16):
        plant_leaf(model, np.array([-0.55, -0.1, TOP + 0.09]), 2.4 * stem, 0.03 + 0.011 * stem,
                   0.05 + 0.012 * (stem % 3))
    model.add(CYLINDER, (0.22, 0.33, TOP + 0.006), (0.09, 0, 0.006), TILED, 0.004)
    model.ring((0.2, -0.06, TOP + 0.015), 0.03, 0.006, METAL, upright(np.array([0, 0, 1.0])))


def room() -> Design:
    model = Model()
    walls(model)
    hangings(model)
    shelves(model)
    furniture(model)
    still_life(model)
    rows, profiles = model.arrays()
    lights = np.array([lamp((2.2, 0.35, 1.0), (4.2, 4.4, 4.8), 5.0),
                       lamp((0.0, 0.0, 1.34), (1.5, 1.25, 0.9), 8.0)])
    return Design(rows, profiles, MATERIALS, lights, np.array([0.34, 0.33, 0.32, 0.8, 0.2]),
                  INDOORS, extent=3.5, cells=128, angle_x=1.15, distances=(1.05, 2.0),
                  heights=(0.05, 0.72), start=0.02, samples=3, tolerance=0.06,
                  closed=True)
