"""Pictures of a scene: rays that see through glass and are mirrored by metal, four by four a pixel.

A ray is not bent by glass but dimmed and tinted, and loses what the glass mirrors. Where it meets
nothing behind, the picture keeps the glass's opacity as alpha; what a tint holds back less in one
channel than in another is added as light, as if white paper lay behind.
"""

from __future__ import annotations

from math import exp, pi, sqrt

import numpy as np

from lfportrait.capture import Camera
from lfportrait.simd.decorators import kernel
from lfportrait.simd.threads import share_out

from .design import Design
from .grid import bake, march
from .materials import CLEAR, COLOR, METAL, ROUGH, noise, part
from .shading import environment, normal_of, occlusion_at, passing, shade
from .solids import CYLINDER, LATHE, distance, dot

__all__ = ["Scene"]

EVENTS, MIRRORS = 16, 2  # walls of glass and mirrors that a ray meets, mirrors among them


@part
def cross_glass(solids, number, profiles, origin, ray, start):
    """Walk on through a glass wall: (where it is left, how long the way inside was)."""
    t, inner, before, step = start, 0.0, 0.0, 0.0
    for tried in range(200):
        value = distance(solids, number, profiles, origin[0] + t * ray[0],
                         origin[1] + t * ray[1], origin[2] + t * ray[2])
        if value > 0.0 > before:  # the last step led out
            inner -= step * value / (value - before)
        if tried > 2 and value > 3e-4:
            break
        before, step = value, max(abs(value), 1.2e-3)
        if value < 0.0:
            inner += step
        t += step
    return t, inner


@part
def brushed(baked, solid, point, ray, normal, rough, color):
    """What metal turned on a lathe mirrors: a streak across its grooves."""
    axis = solid[10:13]
    grooves = np.cross(axis, normal)
    if abs(dot(axis, normal)) > 0.5:  # a disc: its grooves run about the axis
        grooves = np.cross(axis, point - solid[1:4])
    grooves /= sqrt(dot(grooves, grooves)) + 1e-9
    across = np.cross(grooves, normal)
    out = point - solid[1:4]
    along = dot(axis, out)
    ripple = noise(70.0 * sqrt(max(dot(out, out) - along * along, 0.0)), 70.0 * along, 0.0) - 0.5
    total = np.zeros(3)
    for tap in range(-3, 4):
        tilted = normal + rough * (0.6 * tap + 1.3 * ripple) * across
        tilted /= sqrt(dot(tilted, tilted))
        environment(baked.surroundings, ray - 2.0 * dot(ray, tilted) * tilted, 0.12, total)
    color += total / 7.0


@part
def trace(baked, origin, ray, start, out):
    """Color (coded, premultiplied), opacity and a number that tells solids apart, of one ray."""
    through, color = np.ones(3), np.zeros(3)
    covered, mirrors = False, 0
    for _ in range(EVENTS):
        # No glass is passed by here; a constant would have a walk of its own compiled.
        t, nearest, _, _ = march(baked, origin, ray, start, 1e9, 0.0, mirrors < 0)
        if t < 0.0:
            if covered:
                seen = np.zeros(3)
                environment(baked.surroundings, ray, 0.0, seen)
                color += through * seen
            break
        point = origin + t * ray
        solid = baked.solids[nearest]
        material = baked.materials[int(solid[17])]
        if not covered:
            out[4] = 7.0 * out[4] + nearest + 1.0
        normal = normal_of(baked.solids, nearest, baked.profiles, point)
        cosine = -dot(normal, ray)
        grazing = (1.0 - min(max(cosine, 0.0), 1.0))**5
        tint, seen = material[COLOR:COLOR + 3], np.zeros(3)
        if material[CLEAR] == 0.0 and material[METAL] == 0.0:
            covered = True
            shade(baked, point, ray, normal, nearest, seen)
            color += through * seen
            break
        bounced = ray + 2.0 * cosine * normal
        if material[CLEAR] > 0.0:
            fresnel = 0.05 + 0.85 * grazing
            environment(baked.surroundings, bounced, 0.0, seen)
            color += through * seen * (0.8 * fresnel)  # what stands near is not mirrored
            t, inner = cross_glass(baked.solids, nearest, baked.profiles, origin, ray, t)
            for channel in range(3):
                through[channel] *= ((1.0 - fresnel)
                                     * exp(-material[CLEAR] * (1.0 - tint[channel]) * inner))
            origin, start = origin + t * ray, 0.0
            continue
        covered = True
        metal, rough = material[METAL], material[ROUGH]
        if metal < 1.0:  # a lacquer over a color; only what it mirrors at flat angles is traced
            shade(baked, point, ray, normal, nearest, seen)
            mirrored = metal * max(grazing - 0.03, 0.0)
            color += through * seen * (1.0 - mirrored)
            if mirrored == 0.0:
                break
            through *= mirrored
        else:
            through *= tint**1.6 * (1.0 - grazing) + grazing
        if mirrors == MIRRORS or rough > 0.1:
            seen[:] = 0.0
            if rough > 0.1 and int(solid[0]) in (CYLINDER, LATHE):
                brushed(baked, solid, point, ray, normal, rough, seen)
            else:
                environment(baked.surroundings, bounced, rough, seen)
            open_ = passing(baked, point + 2e-3 * normal, bounced, 1e9, 1.0 / (0.03 + 0.5 * rough))
            occlusion = occlusion_at(baked, point, normal)
            color += through * (seen * open_ * occlusion + 0.12 * (1.0 - open_ * occlusion))
            break
        mirrors += 1
        origin, start, ray = point + 2e-3 * normal, 0.0, bounced
    alpha = 1.0
    if not covered:
        least = through.min()
        alpha = 1.0 - least
        color += through - least
    if alpha > 1e-6:
        for channel in range(3):
            out[channel] = alpha * min(color[channel] / alpha, 1.0)**(1 / 2.2)
    out[3] = alpha


@kernel
def cast(first, last, baked, camera, focal, rays, start, out):
    """Cast rays through picture points [K, 2]: out [K, 5] is color, opacity and the solid."""
    for number in range(first, last):
        local = np.array([(rays[number, 0]) / focal, rays[number, 1] / focal, 1.0])
        ray, origin = np.zeros(3), camera[:3, 3].copy()
        for axis in range(3):
            ray[axis] = (camera[axis, :3] * local).sum() / sqrt((local * local).sum())
        out[number] = 0.0
        trace(baked, origin, ray, start, out[number])


class Scene:
    """A design, baked."""

    def __init__(self, design: Design) -> None:
        self.design = design
        self.baked = bake(design)

    def focal(self, size: int) -> float:
        """Focal length in pixels of pictures of that size."""
        return 0.5 * size / np.tan(0.5 * self.design.angle_x)

    def picture(self, pose: np.ndarray, size: int) -> np.ndarray:
        """RGBA, uint8 [size, size, 4] with straight alpha, from an OpenCV pose."""
        def rays(points: np.ndarray) -> np.ndarray:
            out = np.zeros((len(points), 5))
            share_out(cast, len(points), self.baked, pose, self.focal(size), points - 0.5 * size,
                      self.design.start, out)
            return out

        finer = self.design.samples
        pixels = np.stack(np.meshgrid(np.arange(size), np.arange(size)), 2).reshape(-1, 2)
        first = rays(pixels + 0.5).reshape(size, size, 5)
        rough = np.zeros((size, size), bool)
        for axis in (0, 1):
            step = np.abs(np.diff(first, axis=axis))
            changed = (step[..., 4] > 0) | (step[..., :3].max(axis=2) > self.design.tolerance)
            lower, upper = [slice(None)] * 2, [slice(None)] * 2
            lower[axis], upper[axis] = slice(0, -1), slice(1, None)
            rough[tuple(lower)] |= changed
            rough[tuple(upper)] |= changed
        inner = np.stack(np.meshgrid(np.arange(finer), np.arange(finer)), 2).reshape(1, -1, 2)
        fine = rays((pixels[rough.ravel()][:, None] + (inner + 0.5) / finer).reshape(-1, 2))
        total = first[..., :4].copy()
        total[rough] = fine[:, :4].reshape(-1, finer**2, 4).mean(axis=1)
        total[..., :3] /= np.maximum(total[..., 3:], 1e-9)
        return np.uint8(np.clip(total, 0, 1) * 255 + 0.5)

    def cameras(self, count: int, size: int, seed: int) -> Camera:
        """Cameras at random on the upper half of the sphere, looking at the origin."""
        random = np.random.default_rng(seed)
        low, high = self.design.heights
        height, turn = random.uniform(low, high, count), random.uniform(0, 2 * pi, count)
        flat = np.sqrt(1 - height**2)
        away = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], 1)
        near, far = self.design.distances
        away *= near if near == far else random.uniform(near, far, count)[:, None]
        return Camera.look_at(away, np.zeros(3), width=size, height=size, focal=self.focal(size),
                              up=(0, 0, 1))
