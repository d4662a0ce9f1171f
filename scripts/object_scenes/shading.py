"""Light on a point of a solid: soft shadows, occlusion, highlights, and what is mirrored from afar.

The surroundings that mirrors see - a studio with soft boxes, a sky, the dim rest of a room - are
never seen themselves.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from .design import INDOORS, STUDIO
from .grid import march, smooth_distance
from .materials import GLOSS, GLOW, ROUGH, SHARPNESS, THIN, paint, part
from .solids import distance, dot

__all__ = ["environment", "normal_of", "occlusion_at", "passing", "shade"]

# Soft boxes: direction [3], half width, half height (tangents), color [3].
BOXES = np.array([
    [0.45, -0.52, 0.73, 0.34, 0.24, 4.6, 4.3, 3.9],
    [-0.80, -0.45, 0.35, 0.16, 0.55, 2.5, 2.8, 3.3],
    [0.15, 0.90, 0.40, 0.70, 0.10, 1.9, 1.7, 1.4],
    [-0.30, 0.50, 0.85, 0.12, 0.12, 2.6, 2.6, 2.6],
    [0.95, 0.25, 0.20, 0.07, 0.45, 2.3, 2.6, 2.8],
    [-0.30, -0.95, 0.15, 0.10, 0.50, 2.4, 2.2, 1.9],
])


@part
def inside(value, size, edge):
    t = min(max(0.5 + 0.5 * (size - abs(value)) / edge, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@part
def environment(surroundings, ray, rough, color):
    """Add what lies in a direction, blurred by ``rough`` radians."""
    x, y, z = ray[0], ray[1], ray[2]
    if surroundings == INDOORS:
        color += 0.25
        return
    if surroundings != STUDIO:
        # Brightness of the sky; below lies a grey floor.
        value = 0.35 + 0.65 * min(max(0.5 + 1.5 * z, 0.0), 1.0)
        color[0] += 0.44 * value
        color[1] += 0.475 * value
        color[2] += 0.5 * value
        return
    above = min(max(0.5 + 0.5 * z / (0.03 + rough), 0.0), 1.0)
    turn = np.arctan2(y, x)
    wall = 0.42 + 0.20 * np.sin(3.0 * turn + 0.5) + 0.08 * np.sin(7.0 * turn) * (rough < 0.2)
    wall += 0.40 * max(z, 0.0)
    floor = 0.16 + 0.14 * (1.0 + min(z, 0.0))
    color[0] += above * 0.92 * wall + (1.0 - above) * 1.15 * floor
    color[1] += above * 0.97 * wall + (1.0 - above) * floor
    color[2] += above * 1.08 * wall + (1.0 - above) * 0.85 * floor
    edge = 0.02 + rough
    for box in range(len(BOXES)):
        a, b, c = BOXES[box, 0], BOXES[box, 1], BOXES[box, 2]
        length = sqrt(a * a + b * b + c * c)
        a, b, c = a / length, b / length, c / length
        facing = a * x + b * y + c * z
        if facing <= 0.05:
            continue
        flat = sqrt(a * a + b * b)
        across = (-b * x + a * y) / flat / facing
        up = (-a * c * x - b * c * y + flat * flat * z) / flat / facing
        wide, high = BOXES[box, 3], BOXES[box, 4]
        share = (inside(across, wide, edge) * inside(up, high, edge)
                 * min(1.0, wide / edge) * min(1.0, high / edge))
        for channel in range(3):
            color[channel] += share * BOXES[box, 5 + channel]


@part
def normal_of(solids, number, profiles, point):
    """Gradient of the distance, by the corners of a tetrahedron."""
    nx, ny, nz, h = 0.0, 0.0, 0.0, 3e-4
    for corner in range(4):
        a, b = 1.0 if corner in (0, 1) else -1.0, 1.0 if corner in (0, 2) else -1.0
        c = 1.0 if corner in (0, 3) else -1.0
        value = distance(solids, number, profiles, point[0] + a * h, point[1] + b * h,
                         point[2] + c * h)
        nx, ny, nz = nx + a * value, ny + b * value, nz + c * value
    length = sqrt(nx * nx + ny * ny + nz * nz) + 1e-12
    return np.array([nx / length, ny / length, nz / length])


@part
def occlusion_at(baked, point, normal):
    """How open the surroundings of a point are."""
    occlusion = 1.0
    for tap in range(1, 6):
        reach = 0.035 * tap
        clear = smooth_distance(baked.grid, baked.extent, point[0] + reach * normal[0],
                                point[1] + reach * normal[1], point[2] + reach * normal[2])
        occlusion -= max(reach - clear, 0.0) * 4.0 / tap**1.3
    return max(occlusion, 0.15)


@part
def passing(baked, point, direction, reach, softness):
    """How much light arrives from a direction; glass dims it a little."""
    _, _, light, dimmed = march(baked, point, direction, 2e-3, reach, softness, baked.glassy)
    return max(light, 0.0) * (0.62 + 0.38 * dimmed)


@part
def shade(baked, point, ray, normal, nearest, color):
    """Add the light, linear, that a point on a solid sends back along ``ray``."""
    solid = baked.solids[nearest]
    material = baked.materials[int(solid[17])]
    place, albedo, mirrored = np.zeros(3), np.zeros(3), np.zeros(3)
    for axis in range(3):
        for other in range(3):
            place[axis] += solid[4 + 3 * axis + other] * (point[other] - solid[1 + other])
    paint(material, solid, nearest, place, normal, albedo)
    for channel in range(3):
        albedo[channel] = max(albedo[channel], 0.0)**1.6
    occlusion = occlusion_at(baked, point, normal)
    cosine = -dot(normal, ray)
    fresnel = 0.04 + 0.6 * (1.0 - min(max(cosine, 0.0), 1.0))**4
    environment(baked.surroundings, ray + 2.0 * cosine * normal, material[ROUGH], mirrored)
    for channel in range(3):
        color[channel] += albedo[channel] * (
            material[GLOW] + baked.ambient[channel] * occlusion
            * (baked.ambient[3] + baked.ambient[4] * normal[2]))
        color[channel] += material[GLOSS] * fresnel * mirrored[channel] * occlusion
    for number in range(len(baked.lights)):
        row = baked.lights[number]
        towards, reach, strength = row[:3].copy(), 1e9, 1.0
        if row[3] > 0.0:
            towards -= point
            reach = sqrt(dot(towards, towards))
            towards /= reach
            strength = 1.0 / (0.05 + reach * reach)
        facing = dot(normal, towards)
        if facing > 0.0:
            light = strength * passing(baked, point + 2e-3 * normal, towards, reach, row[7])
            half = towards - ray
            mirrored_by = max(dot(normal, half) / sqrt(dot(half, half)), 0.0)
            highlight = mirrored_by**material[SHARPNESS] * light * facing**0.3
            for channel in range(3):
                color[channel] += row[4 + channel] * (
                    albedo[channel] * light * facing + material[GLOSS] * highlight * (0.8 / 1.05))
        elif material[THIN] > 0.0:  # what shines through a leaf
            light = strength * passing(baked, point - 1e-2 * normal, towards, reach, row[7])
            for channel in range(3):
                color[channel] -= (row[4 + channel] * material[THIN] * albedo[channel] * light
                                   * facing)
