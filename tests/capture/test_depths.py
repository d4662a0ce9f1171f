"""Depth stays over its picture: read from data sets, straightened, turned, saved and read again."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lfportrait.capture import Capture, Lens, read_photos
from lfportrait.capture.formats.assembly import assemble
from lfportrait.files import write_image
from lfportrait.media.depth import DepthMap

from .depth_files import encoded, gdepth
from .test_camera import rig
from .test_capture import make_capture, spot
from .test_phones import polycam
from .test_programs import centred

RANGE = {"Format": "RangeLinear", "Near": "1", "Far": "3", "Units": "m"}


def with_depth(picture: np.ndarray, orientation: int = 1) -> bytes:
    """A JPEG of a spot whose depth, at half the size, is 1 m there and 3 m elsewhere."""
    exif = Image.Exif()
    exif[0x0112] = orientation
    depth = np.where(picture[..., 0] > 128, 0, 255).astype(np.uint8)[::2, ::2]
    return gdepth(encoded(np.ascontiguousarray(picture), "JPEG", quality=98, exif=exif.tobytes()),
                  encoded(np.ascontiguousarray(depth)), RANGE)


def spot_of(weight: np.ndarray) -> np.ndarray:
    """Centre of what is bright, over the size of the array."""
    rows, columns = np.indices(weight.shape) + 0.5
    return np.array([(weight * columns).sum() / weight.shape[1],
                     (weight * rows).sum() / weight.shape[0]]) / weight.sum()


def over_pictures(capture: Capture) -> float:
    """Largest distance between a picture's spot and its depth's, over the picture's size."""
    worst = 0.0
    for image, depth in zip(capture.images, capture.depths, strict=True):
        near = np.nan_to_num(3.0 - depth.distance()[0], nan=0.0)
        assert near.max() > 1.5
        red = np.clip(image[..., 0].astype(float) - 60, 0, None)
        worst = max(worst, float(np.abs(spot_of(near) - spot_of(red)).max()))
    return worst


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_photos_keep_their_depth(tmp_path, orientation):
    cameras = rig(3, 2)
    for view in range(2):
        (tmp_path / f"{view}.jpg").write_bytes(with_depth(spot(cameras, view), orientation))
    write_image(tmp_path / "2.jpg", spot(cameras, 0))
    photos = read_photos(tmp_path, 40)
    assert photos[2].depth is None
    for photo in photos[:2]:
        near = photo.depth.distance()[0] < 2.0
        assert near.shape == ((30, 40) if orientation < 5 else (40, 30))
        red = photo.image[..., 0] > 128
        assert np.abs(spot_of(near) - spot_of(red)).max() < 0.02
    assert (photos[0].image.shape[:2] == (30, 40)) is (orientation < 5)


@pytest.mark.parametrize("sideways", [False, True])
def test_data_sets_keep_their_photos_depth(tmp_path, sideways):
    """Pictures that are turned by the world's up take their depth along."""
    cameras = centred()
    polycam(tmp_path, cameras, sideways)
    for view, path in enumerate(sorted(tmp_path.rglob("*.jpg"))):
        picture = spot(cameras, view)
        path.write_bytes(with_depth(np.rot90(picture) if sideways else picture))
    capture = Capture.load(tmp_path)
    assert capture.depths[0].values.shape == (30, 40)
    assert over_pictures(capture) < 0.02


def test_one_photo_with_depth_among_others(tmp_path):
    cameras = centred()
    polycam(tmp_path, cameras, False)
    assert Capture.load(tmp_path).depths is None
    first = min(tmp_path.rglob("*.jpg"))
    first.write_bytes(with_depth(spot(cameras, 0)))
    depths = Capture.load(tmp_path).depths
    assert depths[0] is not None and all(depth is None for depth in depths[1:])


def test_straightened_with_the_picture():
    """A strong lens moves the spot; picture and depth move alike, what no photo shows is unknown.

    Beside an unknown region distances are not pulled to zero.
    """
    lens = Lens(80, 60, (70.0, 70.0), (40.0, 30.0), "opencv", (0.35,))
    cameras = rig(3, 6)
    pictures = [np.roll(spot(cameras, view), (12, 18), (0, 1)) for view in range(6)]
    depths = []
    for picture in pictures:
        near = (picture[..., 0] > 128).reshape(30, 2, 40, 2).mean((1, 3))
        values = (3.0 - 2.0 * near).astype(np.float32)
        values[:, :3] = np.nan
        depths.append(DepthMap(values, "distance", True, confidence=np.ones_like(values)))
    views = assemble(cameras.pose, [lens] * 6, pictures, [f"{view}" for view in range(6)], None,
                     0, depths=depths)
    moved = Capture(**views._asdict())
    assert over_pictures(moved) < 0.008
    before = spot_of((pictures[0][..., 0] > 128).astype(float))
    after = spot_of((moved.images[0][..., 0] > 128).astype(float))
    assert np.abs(before - after).max() > 0.018
    for depth in moved.depths:
        known = depth.values[np.isfinite(depth.values)]
        assert known.min() >= 0.999 and known.max() <= 3.001
        assert np.isnan(depth.values).any() and depth.confidence.max() == 1.0


def test_a_corner_outside_the_photo_is_unknown():
    lens = Lens(80, 60, (70.0, 70.0), (40.0, 30.0), "opencv", (0.0, 0.0, 60.0))
    depth = DepthMap(np.full((30, 40), 2.0, np.float32), "inverse", False,
                     confidence=np.ones((30, 40), np.float32))
    views = assemble(rig(3, 1).pose, [lens], [np.zeros((60, 80, 3), np.uint8)], ["a"], None, 0,
                     depths=[depth])
    flat = views.depths[0]
    assert np.isnan(flat.values[0, 0]) and flat.confidence[0, 0] == 0.0
    assert flat.values[15, 20] == 2.0 and flat.confidence[15, 20] == 1.0
    assert flat.kind == "inverse" and not flat.metric


def deep_capture() -> Capture:
    values = np.random.default_rng(0).uniform(0.2, 3.0, (15, 20)).astype(np.float32)
    values[3:5] = np.nan
    depths: list[DepthMap | None] = [None] * 10
    depths[1] = DepthMap(values, "inverse", True, "ray", 1 / 3, 5.0, np.abs(np.sin(values)),
                         "gdepth")
    depths[4] = DepthMap(values, "distance", False, source="heic")
    return replace(make_capture(), depths=depths)


def test_saved_depth_comes_back_exactly(tmp_path: Path):
    capture = deep_capture()
    similarity = np.diag([2.0, 2.0, 2.0, 1.0])
    capture.reframed(similarity).save(tmp_path / "capture")
    back = Capture.load(tmp_path / "capture")
    assert [depth is not None for depth in back.depths] == [view in (1, 4) for view in range(10)]
    for view in (1, 4):
        wanted, found = capture.depths[view], back.depths[view]
        np.testing.assert_array_equal(found.values, wanted.values)
        for name in ("kind", "metric", "along", "near", "far", "source"):
            assert getattr(found, name) == getattr(wanted, name)
    np.testing.assert_array_equal(back.depths[1].confidence, capture.depths[1].confidence)
    assert back.depths[4].confidence is None


def test_damaged_depth_leaves_a_saved_capture_whole(tmp_path: Path):
    deep_capture().save(tmp_path / "capture")
    first, second = sorted((tmp_path / "capture" / "depth").iterdir())
    first.write_bytes(second.read_bytes()[:200])
    second.unlink()
    with pytest.warns(UserWarning, match="depth map"):
        back = Capture.load(tmp_path / "capture")
    assert back.depths is None and len(back) == 10


def test_captures_without_depth_are_saved_as_before(tmp_path: Path):
    make_capture().save(tmp_path / "capture")
    assert not (tmp_path / "capture" / "depth").exists()
    assert "depth" not in json.loads((tmp_path / "capture" / "transforms.json").read_text()
                                     )["frames"][0]


def test_a_depth_a_view():
    capture = make_capture()
    with pytest.raises(ValueError, match="depths"):
        replace(capture, depths=[None])
