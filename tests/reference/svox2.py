"""svox2's checkpoint read and rendered as svox2 defines it: one ray at a time, plain NumPy."""

import numpy as np

from .raycast import sh_basis

C0 = 0.28209479177387814


class Checkpoint:
    """A ``ckpt.npz`` with svox2's own conventions: links [X, Y, Z], axes in the order x, y, z."""

    def __init__(self, path):
        with np.load(path) as file:
            if "data" in file:
                self.density, self.sh = file["data"][..., :1], file["data"][..., 1:]
            else:
                self.density, self.sh = file["density_data"], file["sh_data"]
            self.links = file["links"]
            self.radius = file["radius"] if "radius" in file else np.ones(3)
            self.center = file["center"] if "center" in file else np.zeros(3)
            self.behind = None
            if "background_data" in file:
                self.behind = file["background_links"], file["background_data"]
        self.size = np.array(self.links.shape, float)

    def _sample(self, place):
        """Density and coefficients at grid coordinates; empty points count as zeros."""
        low = np.minimum(np.maximum(place, 0).astype(int), self.links.shape - np.array(2))
        part = place - low
        density, sh = 0.0, np.zeros(self.sh.shape[1])
        for corner in np.ndindex(2, 2, 2):
            link = self.links[tuple(low + corner)]
            weight = np.prod(np.where(corner, part, 1 - part))
            if link >= 0:
                density += weight * float(self.density[link, 0])
                sh += weight * self.sh[link].astype(float)
        return density, sh

    def color(self, origin, direction, grey, step=0.5, shell_step=1.0):
        """Color of a world ray, on spheres (if any) and ``grey``."""
        direction = direction / np.linalg.norm(direction)
        basis = sh_basis(direction, self.sh.shape[1] // 3)
        # svox2: grid = world * scaling + offset, with these two.
        scaling = 0.5 / self.radius * self.size
        offset = 0.5 * (1 - self.center / self.radius) * self.size - 0.5
        start, along = origin * scaling + offset, direction * scaling
        world_step = step / np.linalg.norm(along)
        along = along / np.linalg.norm(along)
        with np.errstate(divide="ignore"):
            a, b = -start / along, (self.size - 1 - start) / along
        t, end = max(0.0, np.minimum(a, b).max()), np.maximum(a, b).min()
        found, log_light = np.zeros(3), 0.0
        while t <= end:
            sigma, sh = self._sample(np.clip(start + t * along, 0, self.size - 1))
            if sigma > 1e-10:
                shade = np.maximum(sh.reshape(3, -1) @ basis + 0.5, 0.0)
                found += np.exp(log_light) * (1 - np.exp(-sigma * world_step)) * shade
                log_light -= sigma * world_step
            t += step
        if self.behind is None:
            return found + np.exp(log_light) * grey
        return found + self._spheres(origin, direction, log_light, grey, shell_step)

    def _spheres(self, origin, direction, log_light, grey, step):
        links, data = self.behind
        reso, layers = links.shape[1], data.shape[1]
        origin, direction = (origin - self.center) / self.radius, direction / self.radius
        direction = direction / np.linalg.norm(direction)
        inner = max(1.0, np.linalg.norm(np.cross(origin, direction)) + 1e-3)
        last, found, count = 1 / inner, np.zeros(3), int(layers / step) + 2
        for number in range(count):
            r = count / (count - number - 0.5)
            half = origin @ direction
            root = half * half - origin @ origin + r * r
            if r < inner or root < 0:
                continue
            x, y, z = (origin + (-half + np.sqrt(root)) * direction) / r
            place = np.array([reso * 2 * (0.5 + np.arctan2(x, z) * 0.5 / np.pi),
                              reso * (0.5 - np.arcsin(np.clip(y, -1, 1)) / np.pi),
                              np.clip((1 - 1 / r) * layers - 0.5, 0, layers - 1)])
            low = np.minimum(place.astype(int), [2 * reso - 1, reso - 1, layers - 2])
            part = place - low
            value = np.zeros(4)
            for i, j, k in np.ndindex(2, 2, 2):
                link = links[(low[0] + i) % (2 * reso), min(low[1] + j, reso - 1)]
                if link >= 0:
                    value += (np.prod(np.where((i, j, k), part, 1 - part))
                              * data[link, low[2] + k].astype(float))
            if value[3] > 0:
                taken = value[3] * (last - 1 / r)
                found += np.exp(log_light) * (1 - np.exp(-taken)) * np.maximum(
                    C0 * value[:3] + 0.5, 0)
                log_light -= taken
            last = 1 / r
        return found + np.exp(log_light) * grey
