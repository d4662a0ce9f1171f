"""The depth that a photo keeps is laid over the fitted head."""

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.face.one_photo.depth import hair_before, hair_squares, middle_behind, sensed_depth
from lfportrait.face.one_photo.parts import Parts, parts_of
from lfportrait.media.depth import DepthMap

SIDE = 96


def camera() -> Camera:
    return Camera.arc([0.0], distance=4.0, width=SIDE, height=SIDE, focal=160.0)


def scene() -> tuple[Parts, np.ndarray, np.ndarray]:
    """Maps of a person; the depth of all of it on their grid; and that of the face alone.

    A ball is the face, above and below it hair and shoulders lie further back.
    """
    matte = np.zeros((SIDE, SIDE), np.float32)
    matte[8:, 20:76] = 1
    hair = np.zeros_like(matte)
    hair[8:24] = matte[8:24]
    parts = parts_of(camera(), matte, hair, 4.0)
    rays = parts.camera.rays(0)[1].reshape(*parts.inside.shape, 3)
    height, width = -rays[..., 1] / rays[..., 2] * 4, rays[..., 0] / rays[..., 2] * 4
    height = -height if height[0, 0] < 0 else height
    radius = np.hypot(height, width)
    ball = 4.0 - np.sqrt(np.maximum(0.7 ** 2 - radius ** 2, 0))
    true = np.where(radius < 0.55, ball, 4.1 + 0.1 * np.abs(height))
    return parts, true, np.where(radius < 0.55, ball, np.nan)


def written(parts: Parts, true: np.ndarray, **notes) -> DepthMap:
    """The photo's own depth map of a scene, of half its size."""
    factor = parts.camera.focal[0, 0] / 160.0
    pad = parts.camera.center[0, 0] - 48 * factor
    at = (2 * np.arange(SIDE // 2) + 1.0) * factor - 0.5
    rows = np.clip(np.rint(at), 0, true.shape[0] - 1).astype(int)
    columns = np.clip(np.rint(at + pad), 0, true.shape[1] - 1).astype(int)
    values = true[rows[:, None], columns]
    return DepthMap(np.asarray(notes.pop("change")(values), np.float32), **notes)


@pytest.mark.parametrize("notes", [
    {"kind": "distance", "metric": True, "change": lambda z: 0.2 * z},
    {"kind": "inverse", "metric": False, "change": lambda z: 3.0 / z - 0.4},
])
def test_scale_and_zero_follow_from_the_face(notes):
    parts, true, near = scene()
    sensed = sensed_depth(written(parts, true, **notes), camera(), parts, near)
    assert sensed is not None and sensed.off < 0.02
    known = np.isfinite(sensed.depth)
    beside = known & ~np.isfinite(near)
    assert beside.sum() > 1000
    assert np.median(np.abs(sensed.depth - true)[beside]) < 0.02
    # Nothing is said at the outline, where maps mix person and ground.
    assert not known[parts.inside <= 0].any()


def test_some_outliers_do_no_harm():
    parts, true, near = scene()
    wrong = np.random.default_rng(1).random((SIDE // 2, SIDE // 2)) < 0.05
    depth = written(parts, true, kind="inverse", metric=False,
                    change=lambda z: np.where(wrong, 0.9, 1 / z))
    sensed = sensed_depth(depth, camera(), parts, near)
    assert sensed is not None and sensed.off < 0.02


@pytest.mark.parametrize("change", [
    lambda z: np.full_like(z, 0.5), lambda z: z,
    lambda z: np.random.default_rng(2).random(z.shape), lambda z: np.full_like(z, np.nan)],
    ids=["flat", "turned over", "noise", "unknown"])
def test_a_depth_that_does_not_fit_the_face_is_none(change):
    parts, true, near = scene()
    depth = written(parts, true, kind="inverse", metric=False, change=change)
    assert sensed_depth(depth, camera(), parts, near) is None


def test_distances_along_rays_become_depths():
    parts, true, near = scene()
    slant = 1 / np.hypot(1, np.hypot(*np.meshgrid(*[(2 * np.arange(48) + 1 - 48) / 160.0] * 2)))
    depth = written(parts, true, kind="distance", metric=True, along="ray",
                    change=lambda z: z / slant)
    sensed = sensed_depth(depth, camera(), parts, near)
    assert sensed is not None
    known = np.isfinite(sensed.depth) & ~np.isfinite(near)
    assert np.median(np.abs(sensed.depth - true)[known]) < 0.02


def test_hair_and_body_lie_where_the_photo_says():
    parts, true, near = scene()
    sensed = sensed_depth(written(parts, true, kind="distance", metric=True, change=lambda z: z),
                          camera(), parts, near)
    assert sensed is not None
    middle = np.full(true.shape, 4.5)
    squares = hair_squares(sensed, middle, parts.hair, np.full(true.shape, np.nan), parts.cell)
    known = np.isfinite(squares)
    assert known.sum() > 200 and parts.hair[known].all()
    assert np.abs(middle - np.sqrt(squares) - true)[known].max() < 0.05
    before = hair_before(sensed, parts.hair)
    assert np.allclose(before[known], sensed.depth[known]) and before[~parts.hair].max() == 0
    # A body's front is moved to the depth as a whole; at the neck it stays.
    front = np.where(parts.inside > 0, 0.04, 0.0)
    neck = np.zeros(true.shape, bool)
    neck[:3] = True
    moved = middle_behind(sensed, front, middle, neck, parts.cell)
    low = np.isfinite(sensed.depth) & (np.arange(len(true)) * parts.cell > 0.4)[:, None]
    low &= ~np.isfinite(near)
    assert np.median(np.abs(moved - 0.2 - true)[low]) < 0.03
    assert np.allclose(moved[:3], 4.5)
