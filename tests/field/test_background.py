"""Spheres behind the lattice: the kernels against plain NumPy, and a room that is learned."""

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.errors import UserError
from lfportrait.field import VoxelField
from lfportrait.field.background import Background, BackgroundTrainer, cube_rays
from lfportrait.field.kernels.shells import shells_backward
from tests.fields import shell_field

C0 = 0.28209479177387814


def rays_of(random, count, reach=2.0):
    rays = random.standard_normal((count, 6))
    rays[:, :3] *= reach
    rays[:, 3:] /= np.linalg.norm(rays[:, 3:], axis=1, keepdims=True)
    return rays


def shells_color(rays, links, data, grey):
    """The color behind the lattice in plain NumPy, one ray at a time."""
    wide, high = links.shape
    layers = data.shape[1]
    steps = layers + 2
    found = np.zeros((len(rays), 3))
    for ray, (origin, direction) in enumerate(zip(rays[:, :3], rays[:, 3:])):
        along = origin @ direction
        nearest = np.sqrt(max(0.0, origin @ origin - along ** 2))
        inner = max(1.0, nearest + 1e-3)
        last, through = 1.0 / inner, 1.0
        for number in range(steps):
            radius = steps / (steps - number - 0.5)
            if radius < inner:
                continue
            t = -along + np.sqrt(along ** 2 - origin @ origin + radius ** 2)
            if t <= 0:
                continue
            x, y, z = (origin + t * direction) / radius
            u = (0.5 + np.arctan2(x, z) / (2 * np.pi)) * wide
            v = (0.5 - np.arcsin(np.clip(y, -1, 1)) / np.pi) * high
            w = np.clip((1 - 1 / radius) * layers - 0.5, 0, layers - 1)
            i, j, k = min(int(u), wide - 1), min(int(v), high - 1), min(int(w), layers - 2)
            value = np.zeros(4)
            for di in (0, 1):
                for dj in (0, 1):
                    for dk in (0, 1):
                        link = links[(i + di) % wide, min(j + dj, high - 1)]
                        weight = (abs(1 - di - (u - i)) * abs(1 - dj - (v - j))
                                  * abs(1 - dk - (w - k)))
                        if link >= 0:
                            value += weight * data[link, k + dk]
            if value[3] > 0:
                fade = np.exp(-value[3] * (last - 1 / radius))
                found[ray] += through * (1 - fade) * np.maximum(C0 * value[:3] + 0.5, 0)
                through *= fade
            last = 1 / radius
        found[ray] += through * grey
    return found


def some_background(random, holes=True):
    links = np.full((16, 8), -1, np.int32)
    there = random.random((16, 8)) < (0.8 if holes else 2.0)
    links[there] = np.arange(there.sum())
    data = random.standard_normal((int(there.sum()), 5, 4)).astype(np.float32)
    data[..., 3] = np.abs(data[..., 3]) * 2
    return Background(links, data)


def test_colors_equal_the_reference():
    random = np.random.default_rng(3)
    background = some_background(random)
    rays = np.concatenate([rays_of(random, 40), rays_of(random, 20, 0.2),
                           [[0, 0, 0, 0, 1, 0], [0, 0, 3, 0, 0, 1], [5, 0, 0, 1, 0, 0]]])
    seen = background.color(rays.astype(np.float32), 0.3, stop=0.0)
    assert np.allclose(seen, shells_color(rays, background.links, background.data, 0.3), atol=2e-4)


def test_gradients_equal_finite_differences():
    random = np.random.default_rng(4)
    background = some_background(random)
    rays = rays_of(random, 30).astype(np.float32)
    slopes = random.standard_normal((30, 3)).astype(np.float32)
    color = background.color(rays, 0.3, stop=0.0)
    gradients = np.zeros((2, background.data.shape[0] * 5, 4), np.float32)
    shells_backward(rays, background.links, background.data.reshape(-1, 4), 5, 0.3, 0.0, color,
                    slopes, gradients)
    found = gradients.sum(0).ravel()
    double = rays.astype(np.float64)
    for place in np.argsort(-np.abs(found))[:60:6]:
        values = [background.data.astype(np.float64) for _ in range(2)]
        values[0].flat[place] += 1e-5
        values[1].flat[place] -= 1e-5
        loss = [(slopes * shells_color(double, background.links, value, 0.3)).sum()
                for value in values]
        assert np.isclose((loss[0] - loss[1]) / 2e-5, found[place], rtol=2e-3, atol=1e-5)


def test_a_room_is_learned():
    cameras = Camera.arc(np.linspace(-150, 180, 12), distance=0.5, width=24, height=18, focal=20.0)
    center, radius = np.zeros(3), np.ones(3)
    rays = [cube_rays(cameras, view, center, radius) for view in range(12)]
    everything = np.concatenate(rays)
    walls = 0.5 + 0.4 * np.sin(6 * everything[:, 3:]).astype(np.float32)
    trainer = BackgroundTrainer(Background.seen(rays, 32, 8, 1.0), 2, 0.5)
    before = np.mean((trainer.background.color(everything, 0.5) - walls) ** 2)
    for _ in range(60):
        color = trainer.background.color(everything, 0.5)
        trainer.step(everything, color, (color - walls) / len(color), 0.1, 0.5)
    after = np.mean((trainer.background.color(everything, 0.5) - walls) ** 2)
    assert after < 0.1 * before


def test_a_field_with_a_room_is_saved_and_read(tmp_path):
    random = np.random.default_rng(5)
    field = shell_field(basis=1, size=12)
    field.background = some_background(random)
    camera = Camera.arc([20.0], distance=3.0, width=20, height=16, focal=14.0)
    seen = field.render(camera).color
    assert abs(seen - shell_field(basis=1, size=12).render(camera).color).max() > 0.1
    field.save(tmp_path / "field.npz")
    found = VoxelField.load(tmp_path / "field.npz")
    assert np.array_equal(found.background.links, field.background.links)
    assert np.array_equal(found.background.data, field.background.data)
    assert abs(found.render(camera).color - seen).max() < 5e-3
    with np.load(tmp_path / "field.npz") as data:
        arrays = dict(data)
    arrays["background_data"] = arrays["background_data"][:3]
    np.savez(tmp_path / "damaged.npz", **arrays)
    with pytest.raises(UserError, match="background"):
        VoxelField.load(tmp_path / "damaged.npz")
