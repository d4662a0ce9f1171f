"""Photographs of the modelled head: sphere tracing with a baked distance grid.

The distance field is baked once into a grid (exact near the surface, a lower bound elsewhere).
Rays, shadows and occlusion march through the grid; only the point where a ray arrives is refined
with the exact field, and shaded with its exact normal. Light is soft and stands still in the world:
a warm key from the upper left, a fill from the right, a rim from behind and a sky, each dimmed by
occlusion. Light that wanders under the skin is imitated by a smoother normal, a wider wrap and
lighter shadows for red than for blue.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from lfportrait.simd.decorators import kernel, lean

from .head import scene, surfaces
from .head_skin import cloth_albedo, eye_albedo, hair_albedo, hair_tangent, skin_albedo
from .head_worn import worn_distance

__all__ = ["bake", "render"]

_EXTENT = 1.06
_BLOCK = 4


@kernel
def bake(m, grid, first, last):
    """Bake layers of blocks ``first`` to ``last`` of ``grid``, float32 [N, N, N] (z, y, x).

    The grid spans the cube [-1.06, 1.06]^3: point i lies at -1.06 + 2.12 i / (N - 1), and N - 1
    must be a multiple of 4, the side of a block. Blocks that the surface can't touch hold a lower
    bound of the distance instead of the distance.
    """
    count = grid.shape[0]
    blocks = (count - 1) // _BLOCK
    cell = 2.0 * _EXTENT / (count - 1)
    reach = 0.5 * _BLOCK * cell * sqrt(3.0)
    for task in range(first * blocks, last * blocks):
        bz, by = task // blocks, task % blocks
        last_z = _BLOCK + (1 if bz == blocks - 1 else 0)
        last_y = _BLOCK + (1 if by == blocks - 1 else 0)
        for bx in range(blocks):
            last_x = _BLOCK + (1 if bx == blocks - 1 else 0)
            x0, y0, z0 = bx * _BLOCK, by * _BLOCK, bz * _BLOCK
            middle = scene(m, -_EXTENT + (x0 + 2) * cell, -_EXTENT + (y0 + 2) * cell,
                           -_EXTENT + (z0 + 2) * cell)
            far = abs(middle) > 2.0 * reach + 0.02
            bound = middle - reach if middle > 0.0 else middle + reach
            for k in range(last_z):
                for j in range(last_y):
                    for i in range(last_x):
                        value = bound
                        if not far:
                            value = scene(m, -_EXTENT + (x0 + i) * cell, -_EXTENT + (y0 + j) * cell,
                                          -_EXTENT + (z0 + k) * cell)
                        grid[np.uintp(z0 + k), np.uintp(y0 + j), np.uintp(x0 + i)] = value


@lean
def _lookup(grid, x, y, z):
    """Trilinear distance in the grid; far outside, the distance to its cube."""
    count = grid.shape[0]
    scale = (count - 1) / (2.0 * _EXTENT)
    top = count - 1.000001
    u, v, w = (x + _EXTENT) * scale, (y + _EXTENT) * scale, (z + _EXTENT) * scale
    u, v, w = min(max(u, 0.0), top), min(max(v, 0.0), top), min(max(w, 0.0), top)
    i, j, k = np.uintp(u), np.uintp(v), np.uintp(w)
    u, v, w = u - i, v - j, w - k
    one = np.uintp(1)
    a = grid[k, j, i] * (1.0 - u) + grid[k, j, i + one] * u
    b = grid[k, j + one, i] * (1.0 - u) + grid[k, j + one, i + one] * u
    c = grid[k + one, j, i] * (1.0 - u) + grid[k + one, j, i + one] * u
    d = grid[k + one, j + one, i] * (1.0 - u) + grid[k + one, j + one, i + one] * u
    return (a * (1.0 - v) + b * v) * (1.0 - w) + (c * (1.0 - v) + d * v) * w


@lean
def _enter(o, d):
    """Interval of a ray inside the cube [-1, 1]^3: entry (at least 0) and exit."""
    near, far = 0.0, 1e9
    for axis in range(3):
        start, step = o[axis], d[axis]
        if abs(step) < 1e-9:
            step = 1e-9
        a, b = (-1.02 - start) / step, (1.02 - start) / step
        near, far = max(near, min(a, b)), min(far, max(a, b))
    return near, far


@lean
def _march(grid, o, d, near, far, width):
    """First hit of a ray through the grid, or -1. ``width`` = size of a pixel at distance 1."""
    t = near
    for _ in range(160):
        h = _lookup(grid, o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2])
        if h < 0.12 * width * t + 2e-4:
            return t
        t += 0.80 * h
        if t > far:
            break
    return -1.0


@lean
def _refine(m, o, d, t):
    """Move a hit of the grid onto the exact surface."""
    for _ in range(3):
        h = scene(m, o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2])
        t += min(max(h, -0.01), 0.01)
        if abs(h) < 2e-4:
            break
    return t


@lean
def _unit(x, y, z):
    s = 1.0 / sqrt(x * x + y * y + z * z + 1e-20)
    return x * s, y * s, z * s


@lean
def _normal(m, x, y, z, e):
    """Unit normal from four samples of the exact field at the corners of a tetrahedron."""
    a, b = scene(m, x + e, y - e, z - e), scene(m, x - e, y - e, z + e)
    c, d = scene(m, x - e, y + e, z - e), scene(m, x + e, y + e, z + e)
    return _unit(a - b - c + d, -a - b + c + d, -a + b - c + d)


@lean
def _soft_normal(grid, x, y, z, e):
    """Unit normal of the surface smoothed over ``e``."""
    return _unit(_lookup(grid, x + e, y, z) - _lookup(grid, x - e, y, z),
                 _lookup(grid, x, y + e, z) - _lookup(grid, x, y - e, z),
                 _lookup(grid, x, y, z + e) - _lookup(grid, x, y, z - e))


@lean
def _shadow(grid, x, y, z, lx, ly, lz, softness):
    """Share of a broad light that reaches a point, from the narrowest gap along the ray."""
    light, t = 1.0, 0.03
    for _ in range(22):
        h = _lookup(grid, x + t * lx, y + t * ly, z + t * lz)
        light = min(light, 0.5 + 0.5 * softness * h / t)
        if light < 0.0:
            break
        t += min(max(0.9 * h, 0.02), 0.12)
        if t > 1.1:
            break
    light = max(light, 0.0)
    return light * light * (3.0 - 2.0 * light)


@lean
def _occlusion(grid, x, y, z, nx, ny, nz):
    """Openness of a point towards its surroundings, in [0, 1], fine and coarse scale."""
    closed, weight, t = 0.0, 0.85, 0.014
    for _ in range(5):
        h = _lookup(grid, x + t * nx, y + t * ny, z + t * nz)
        closed += weight * max(t - h, 0.0) / t * 0.36
        t *= 1.95
        weight *= 0.86
    return max(1.0 - closed, 0.0) ** 1.25


# Directions towards the lights (unit length) and their colors, linear RGB.
_KEY, _KEY_RGB = (-0.470, 0.490, 0.734), (2.35, 2.16, 1.93)
_FILL, _FILL_RGB = (0.862, 0.100, 0.497), (0.48, 0.44, 0.42)
_RIM, _RIM_RGB = (0.560, 0.420, -0.714), (0.75, 0.78, 0.85)
_SKY, _GROUND = (0.47, 0.44, 0.43), (0.36, 0.27, 0.22)


@lean
def _gloss(nx, ny, nz, vx, vy, vz, light, sharp):
    """Blinn-Phong highlight of one light, energy normalised, with Schlick's Fresnel term."""
    hx, hy, hz = _unit(light[0] + vx, light[1] + vy, light[2] + vz)
    nh = max(nx * hx + ny * hy + nz * hz, 0.0)
    vh = max(vx * hx + vy * hy + vz * hz, 0.0)
    nl = max(nx * light[0] + ny * light[1] + nz * light[2], 0.0)
    return nh ** sharp * (sharp + 8.0) / 25.0 * nl * (1.0 + 25.0 * (1.0 - vh) ** 5)


@lean
def _strand_gloss(tangent, vx, vy, vz, light, shift, n, sharp):
    """Kajiya-Kay highlight of a strand whose tangent is tilted by ``shift`` towards normal n."""
    tx, ty, tz = _unit(tangent[0] + shift * n[0], tangent[1] + shift * n[1],
                       tangent[2] + shift * n[2])
    hx, hy, hz = _unit(light[0] + vx, light[1] + vy, light[2] + vz)
    th = tx * hx + ty * hy + tz * hz
    facing = n[0] * light[0] + n[1] * light[1] + n[2] * light[2]
    return max(1.0 - th * th, 0.0) ** (0.5 * sharp) * min(max(1.6 * facing + 0.3, 0.0), 1.0)


@lean
def _shade(m, grid, x, y, z, vx, vy, vz, pixel):
    """Linear color, surface number (0 skin, 1 hair, 2 cloth, 3 eye, 4 worn) and normal of a point.

    (vx, vy, vz) points to the camera; ``pixel`` is the size of a pixel there.
    """
    skin, hair, cloth, eye = surfaces(m, x, y, z)
    kind = 0
    if hair < skin and hair < eye:
        kind = 1
    if cloth < min(skin, hair):
        kind = 2
    if eye < min(skin, hair):
        kind = 3
    if m.spectacles > 0.0 and worn_distance(m, x, y, z) < min(min(skin, hair), min(cloth, eye)):
        kind = 4
    n = _normal(m, x, y, z, max(0.0011, 0.30 * pixel))
    nx, ny, nz = n
    sx, sy, sz = _soft_normal(grid, x, y, z, 0.022)
    px, py, pz = x + 0.012 * sx, y + 0.012 * sy, z + 0.012 * sz
    occlusion = _occlusion(grid, x, y, z, sx, sy, sz)
    key_open = _shadow(grid, px, py, pz, _KEY[0], _KEY[1], _KEY[2], 3.6)
    rim_open = _shadow(grid, px, py, pz, _RIM[0], _RIM[1], _RIM[2], 5.0)
    gloss, sharp, oil = 0.0, 26.0, 0.0
    if kind == 0:
        red, green, blue, oil = skin_albedo(m, x, y, z)
        gloss = 0.034 * (0.5 + oil)
    elif kind == 1:
        red, green, blue = hair_albedo(m, x, y, z)
    elif kind == 2:
        red, green, blue = cloth_albedo(m, x, y, z)
        gloss, sharp = 0.006, 8.0
    elif kind == 4:
        red, green, blue = m.worn
        gloss, sharp = 0.05, 60.0
    else:
        red, green, blue, shade = eye_albedo(m, x, y, z)
        occlusion *= shade
        # The cornea bulges: its normal turns faster than the eyeball's.
        cx = (0.184 + m.eye_space) * (1.0 if x > 0.0 else -1.0)
        ex = x - cx
        if ex * ex + y * y < (0.046 * m.eye_size) ** 2:
            nx, ny, nz = _unit(nx + 8.0 * ex, ny + 8.0 * (y + 0.004), nz)
        gloss, sharp = 0.05, 420.0
    albedo = (red, green, blue)
    # Per channel: how far light wraps round, how much of the soft normal is used.
    under = 1.0 if kind == 0 else (0.45 if kind == 3 else 0.0)
    up = 0.5 + 0.5 * sy
    r = g = b = 0.0
    glint_key = glint_fill = 0.0
    if kind != 1:
        glint_key = gloss * _gloss(nx, ny, nz, vx, vy, vz, _KEY, sharp)
        if kind == 3:
            glint_key = min(4.0 * glint_key, 1.5)
            key_open *= shade
        glint_fill = gloss * _gloss(nx, ny, nz, vx, vy, vz, _FILL, sharp)
    else:
        t = hair_tangent(m, x, y, z, nx, ny, nz)
        glint_key = 0.13 * _strand_gloss(t, vx, vy, vz, _KEY, 0.10, n, 90.0)
        glint_fill = 0.05 * _strand_gloss(t, vx, vy, vz, _FILL, 0.10, n, 60.0)
    edge = (1.0 - max(nx * vx + ny * vy + nz * vz, 0.0)) ** 3
    for c in range(3):
        wrap = under * (0.30, 0.13, 0.08)[c] + (0.22 if kind == 1 else 0.04)
        soft = under * (0.62, 0.30, 0.18)[c]
        ax, ay, az = _unit(nx + soft * (sx - nx), ny + soft * (sy - ny), nz + soft * (sz - nz))
        key = max((ax * _KEY[0] + ay * _KEY[1] + az * _KEY[2] + wrap) / (1.0 + wrap), 0.0)
        fill = max((ax * _FILL[0] + ay * _FILL[1] + az * _FILL[2] + 0.3) / 1.3, 0.0)
        rim = max((ax * _RIM[0] + ay * _RIM[1] + az * _RIM[2] + 0.1) / 1.1, 0.0)
        power = 1.0 - under * (0.24, 0.08, 0.0)[c]
        bounce = _GROUND[c] + (_SKY[c] - _GROUND[c]) * up
        # Light that leaves a crease has met its color more than once.
        open_sky = occlusion / (occlusion + (1.0 - occlusion) * (1.0 - 0.5 * albedo[c]))
        direct = (_KEY_RGB[c] * key * key_open ** power * (0.55 + 0.45 * occlusion ** power)
                  + _RIM_RGB[c] * rim * rim_open)
        soft_light = (_FILL_RGB[c] * fill + bounce) * open_sky ** (1.0 - 0.3 * under * (c == 0))
        tint = albedo[c] if kind != 1 else 0.35 + 0.65 * albedo[c] * 4.0
        value = albedo[c] * (direct + soft_light)
        if kind == 1:
            value += tint * (_KEY_RGB[c] * glint_key * key_open + _FILL_RGB[c] * glint_fill
                             * occlusion + 0.05 * edge * _RIM_RGB[c] * occlusion)
        else:
            value += _KEY_RGB[c] * glint_key * key_open + _FILL_RGB[c] * glint_fill * occlusion
            value += under * 0.05 * edge * (_RIM_RGB[c] * rim_open + 0.4 * bounce) * occlusion
        # After three turns each channel has its own.
        r, g, b = g, b, value
    return r, g, b, kind, nx, ny, nz


@lean
def _encode(value):
    """Gentle filmic shoulder, then the sRGB curve."""
    value *= 0.62
    value = value * (1.0 + value / 7.0) / (1.0 + value * 0.62)
    value = min(max(value, 0.0), 1.0)
    return 12.92 * value if value <= 0.0031308 else 1.055 * value ** (1.0 / 2.4) - 0.055


@lean
def _direction(pose, focal, center, px, py):
    """Unit direction, in the world, of the ray through image point (px, py)."""
    cx, cy = (px - center[0]) / focal[0], (py - center[1]) / focal[1]
    return _unit(pose[0, 0] * cx + pose[0, 1] * cy + pose[0, 2],
                 pose[1, 0] * cx + pose[1, 1] * cy + pose[1, 2],
                 pose[2, 0] * cx + pose[2, 1] * cy + pose[2, 2])


_OFFSETS = ((-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125))


@kernel
def render(m, grid, pose, focal, center, image, aux, first, last):
    """Photograph the head with one camera, four rays a pixel.

    Parameters
    ----------
    m : The `HeadModel`.
    grid : What `bake` made of it.
    pose, focal, center : float64 [4, 4], [2], [2]: a pinhole in the OpenCV frame.
    image : uint8 [H, W, 4], written: sRGB with straight alpha (coverage of the pixel).
    aux : float32 [H, W, 5], written where a pixel is hit: normal x, y, z, surface number, depth
        along the ray. An empty array [0, 0, 5] leaves it out.
    """
    width = image.shape[1]
    origin = (pose[0, 3], pose[1, 3], pose[2, 3])
    size = 1.0 / focal[0]
    for row in range(first, last):
        place = np.empty(4)
        for column in range(width):
            d = _direction(pose, focal, center, column + 0.5, row + 0.5)
            near, far = _enter(origin, d)
            hits, low, high = 0, 1e9, -1e9
            if near < far:
                start = near
                for s in range(4):
                    d = _direction(pose, focal, center, column + 0.5 + _OFFSETS[s][0],
                                   row + 0.5 + _OFFSETS[s][1])
                    t = _march(grid, origin, d, start, far, size)
                    place[s] = t
                    if t > 0.0:
                        hits += 1
                        low, high = min(low, t), max(high, t)
                        start = max(near, t - 0.06)
                    else:
                        start = near
            red = green = blue = 0.0
            if hits > 0:
                used, shaded = 4, 0
                pixel = size * low
                if hits == 4 and high - low < 2.0 * pixel:
                    used = 1
                for s in range(used):
                    if place[s] <= 0.0:
                        continue
                    t = place[s]
                    px, py = _OFFSETS[s]
                    if used == 1:
                        px, py = 0.0, 0.0
                        t = 0.5 * (low + high)
                    d = _direction(pose, focal, center, column + 0.5 + px, row + 0.5 + py)
                    t = _refine(m, origin, d, t)
                    r, g, b, kind, nx, ny, nz = _shade(
                        m, grid, origin[0] + t * d[0], origin[1] + t * d[1], origin[2] + t * d[2],
                        -d[0], -d[1], -d[2], pixel)
                    # Average encoded values: highlights don't leave stairs at edges.
                    red, green, blue = red + _encode(r), green + _encode(g), blue + _encode(b)
                    shaded += 1
                    if shaded == 1 and aux.shape[0] > 0:
                        aux[row, column, 0], aux[row, column, 1] = nx, ny
                        aux[row, column, 2], aux[row, column, 3] = nz, kind
                        aux[row, column, 4] = t
                red, green, blue = red / shaded, green / shaded, blue / shaded
            image[row, column, 0] = np.uint8(red * 255.0 + 0.5)
            image[row, column, 1] = np.uint8(green * 255.0 + 0.5)
            image[row, column, 2] = np.uint8(blue * 255.0 + 0.5)
            image[row, column, 3] = np.uint8(hits * 63.75 + 0.5)
