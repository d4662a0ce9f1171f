"""Blurred photos are found and sharp ones kept; videos give sharp frames at even parallax."""

import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy import ndimage

from lfportrait.capture import CalibrateConfig, calibrate, read_source
from lfportrait.capture.photos import blurred, fineness, read_photos, relative_sharpness
from lfportrait.capture.video import read_video
from lfportrait.errors import UserError
from lfportrait.files import write_image

from .test_calibrate import ROUGH, room_cameras, room_picture, texture

av = pytest.importorskip("av")


def moved(image: np.ndarray, length: float, degrees: float) -> np.ndarray:
    """A picture blurred by a straight movement of ``length`` pixels."""
    size = 2 * int(np.ceil(length / 2)) + 3
    kernel = np.zeros((size, size), np.float32)
    for along in np.linspace(-0.5, 0.5, 8 * size) * length:
        x = size // 2 + along * np.cos(np.radians(degrees))
        y = size // 2 + along * np.sin(np.radians(degrees))
        kernel[round(y), round(x)] += 1
    return cv2.filter2D(image, -1, kernel / kernel.sum())


def test_fineness_equals_derivatives_of_gaussians() -> None:
    grey = np.uint8(texture(3, 120)[:90, :, 0] * 255)
    found = fineness(grey)
    energies = []
    for sigma in (0.8, 2.4):
        xx, xy, yy = (sigma**2 * ndimage.gaussian_filter(grey.astype(float), sigma, order,
                                                         mode="nearest")
                      for order in ((0, 2), (1, 1), (2, 0)))
        for angle in np.radians([0, 45, 90, 135]):
            c, s = np.cos(angle), np.sin(angle)
            energies.append(np.mean((c * c * xx + 2 * c * s * xy + s * s * yy)**2))
    assert np.allclose(found, np.array(energies[:4]) / energies[4:], rtol=0.01)


def test_exposure_and_contrast_do_not_count_but_blur_does() -> None:
    image = np.uint8(60 + texture(5, 256) * 120)
    plain = fineness(image)
    assert np.allclose(fineness(np.uint8(image * 0.5 + 20)), plain, rtol=0.06)
    assert (fineness(np.uint8(ndimage.gaussian_filter(image, (1.5, 1.5, 0)))) < 0.5 * plain).all()
    # A movement blurs along its own direction.
    for number, degrees in enumerate((0, 45, 90, 135)):
        ratio = fineness(moved(image, 7, degrees)) / plain
        assert ratio.argmin() == number
        assert ratio.min() < 0.4


def test_relative_sharpness_compares_with_neighbours_of_the_same_group() -> None:
    random = np.random.default_rng(0)
    measures = np.exp(0.05 * random.standard_normal((20, 4)))
    measures[10:] *= 6.0  # another camera
    groups = ["a"] * 10 + ["b"] * 10
    measures[4, 2] *= 0.3
    found = relative_sharpness(measures, groups)
    assert found.argmin() == 4
    assert np.isclose(found[4], 0.3, rtol=0.2)
    assert (np.delete(found, 4) > 0.75).all()
    before_and_after = [0, 1, 2, 3, 5, 6, 7, 8]
    assert np.isclose(found[4], (measures[4] / np.median(measures[before_and_after], 0)).min())
    assert relative_sharpness(measures[:1]).tolist() == [1.0]


def test_few_photos_many_blurred_ones_and_flat_ones() -> None:
    image = np.uint8(texture(5, 128) * 255)
    soft = np.uint8(ndimage.gaussian_filter(image, (3, 3, 0)))
    assert blurred([image] * 4 + [soft], 0.4) == []
    assert blurred([image] * 5 + [soft], 0.4) == [5]
    assert blurred([image] * 5 + [soft], 0.0) == []
    assert blurred([image, image, soft, image, soft, image, image, soft], 0.4) == [2, 4]
    assert blurred([np.full((50, 60, 3), 128, np.uint8)] * 8, 0.4) == []


# One is enough: to read a capture's photos takes seconds.
@pytest.mark.data
@pytest.mark.parametrize("name", ["fox", *(
    pytest.param(name, marks=pytest.mark.slow) for name in ("lee_photos", "buddha_head"))])
def test_moved_photos_among_real_ones_are_found_and_no_others(shared_data: Path, name: str,
                                                              ) -> None:
    photos = [photo.image for photo in read_photos(shared_data / name / "images", max_side=960)]
    assert blurred(photos, CalibrateConfig().blur_threshold) == []
    random = np.random.default_rng(1)
    chosen = sorted(random.choice(len(photos), 6, replace=False).tolist())
    for index in chosen:
        photos[index] = moved(photos[index], 8, random.uniform(0, 180))
    assert blurred(photos, CalibrateConfig().blur_threshold) == chosen


@pytest.mark.slow  # calibrates; which are blurred: above
def test_blurred_photos_are_left_out_in_one_line(tmp_path: Path) -> None:
    cameras = room_cameras(8)
    for view in range(8):
        picture = room_picture(cameras, view)
        if view == 3:
            picture = moved(picture, 9, 30)
        write_image(tmp_path / f"photo{view}.png", picture)
    with pytest.warns(UserWarning, match=r"1 of 8 photos are blurred.*photo3\.png.*keeps them"):
        capture = calibrate(tmp_path, ROUGH)
    assert capture.figures["blurred"] == ["photo3.png"]
    assert capture.figures["photos"] == 8
    assert len(capture) == 7
    assert "photo3.png" not in capture.names


def write_video(path: Path, frames: list[np.ndarray], rate: int = 24) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=rate)
        stream.height, stream.width = frames[0].shape[:2]
        stream.bit_rate = 6_000_000
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode())


def shift_of(frame: np.ndarray, wide: np.ndarray) -> int:
    """How far to the right in the wide picture a frame was taken."""
    match = cv2.matchTemplate(wide, frame, cv2.TM_CCOEFF_NORMED)
    return int(match.argmax() % match.shape[1])


def film(shifts: np.ndarray, wide: np.ndarray, sharp: set[int] | None = None) -> list[np.ndarray]:
    frames = [wide[:, shift:shift + 192] for shift in shifts]
    return [np.ascontiguousarray(frame if sharp is None or number in sharp
                                 else moved(frame, 9, 40)) for number, frame in enumerate(frames)]


WIDE = np.uint8(texture(7, 960)[:144] * 255)


@pytest.mark.slow  # a video; sharpness: above
def test_video_frames_are_evenly_spaced_in_parallax_and_sharp(tmp_path: Path) -> None:
    # The camera stands still for half of the time, then walks, then runs.
    pace = np.concatenate([np.zeros(60), np.full(30, 4.0), np.full(30, 12.0)])
    shifts = np.round(np.cumsum(pace)).astype(int)
    sharp = {number for number in range(120) if number % 3 == 1}
    write_video(tmp_path / "walk.mp4", film(shifts, WIDE, sharp))
    found = {}
    for spacing in ("parallax", "time"):
        photos = read_video(tmp_path / "walk.mp4", 12, spacing=spacing)
        assert [photo.name for photo in photos] == [f"frame_{i:04d}.png"
                                                    for i in range(len(photos))]
        found[spacing] = np.array([shift_of(photo.image, WIDE) for photo in photos])
        for photo, shift in zip(photos, found[spacing]):
            taken = WIDE[:, shift:shift + 192]
            assert np.abs(photo.image.astype(int) - taken).mean() < 12  # not a blurred one
    steps = np.diff(found["parallax"])
    assert len(steps) >= 10
    assert steps.max() < 2.2 * shifts[-1] / 12
    assert steps.min() > 0.3 * shifts[-1] / 12
    assert (np.diff(found["time"]) == 0).sum() >= 4


def test_a_video_that_stands_still_gives_frames_at_even_time(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    frames = [np.uint8(np.clip(WIDE[:, :192].astype(int) + random.normal(0, 3, (144, 192, 3)),
                               0, 255)) for _ in range(40)]
    write_video(tmp_path / "still.mp4", frames)
    assert len(read_video(tmp_path / "still.mp4", 8)) == 8
    write_video(tmp_path / "grey.mp4", [np.full((144, 192, 3), 90, np.uint8)] * 20)
    assert len(read_video(tmp_path / "grey.mp4", 5)) == 5


def test_short_reduced_broken_and_bad_videos(tmp_path: Path) -> None:
    path = tmp_path / "v.mp4"
    write_video(path, film(np.arange(24) * 4, WIDE))
    assert len(read_source(path)) == 24
    assert read_video(path, 3, max_side=96)[0].image.shape == (72, 96, 3)
    container = tmp_path / "v.mkv"
    write_video(container, film(np.arange(60) * 8, WIDE))
    data = container.read_bytes()
    container.write_bytes(data[:len(data) // 2])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert 3 <= len(read_video(container, 12)) <= 12
    (tmp_path / "bad.mp4").write_bytes(b"no video at all")
    with pytest.raises(UserError, match="can't be read"):
        calibrate(tmp_path / "bad.mp4")
    with pytest.raises(UserError, match="no video"):
        read_video(tmp_path / "missing.mp4")
