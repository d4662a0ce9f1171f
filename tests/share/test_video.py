"""Videos and camera paths."""

import av
import numpy as np
import pytest

from lfportrait.errors import UserError
from lfportrait.field import VoxelField
from lfportrait.share import (
    good_cone,
    path_cameras,
    sweep_cameras,
    sweep_degrees,
    sweep_frames,
    write_video,
)


def ball(radius: float = 0.6, resolution: int = 24, height: float = 0.0) -> VoxelField:
    """A solid ball, red on the right half (+x) and blue on the left."""
    axis = 2 * (np.arange(resolution) + 0.5) / resolution - 1
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    inside = x ** 2 + (y - height) ** 2 + z ** 2 < radius ** 2
    links = np.full(inside.shape, -1, np.int32)
    links[inside] = np.arange(inside.sum())
    sh = np.full((int(inside.sum()), 3, 1), -0.5 / 0.28209479, np.float32)
    right = x[inside] > 0
    sh[right, 0] *= -1
    sh[~right, 2] *= -1
    return VoxelField(links, np.full(int(inside.sum()), 60.0, np.float32), sh)


def gradient_frames(count=6, height=45, width=63):
    y, x = np.mgrid[:height, :width]
    for index in range(count):
        shade = np.stack([x / width, y / height, 0.5 + 0.4 * np.sin(x / 25 + index)], axis=-1)
        yield np.float32(shade)


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
def test_a_video_shows_the_frames_it_was_given(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    assert write_video(path, gradient_frames(), 24) == 6
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height) == (64, 46)  # even sides
        assert stream.codec_context.name == "h264" and stream.pix_fmt == "yuv420p"
        assert float(stream.average_rate) == 24
        seen = [frame.reformat(format="rgb24", src_colorspace="ITU709").to_ndarray()
                for frame in container.decode(video=0)]
    assert len(seen) == 6
    for frame, wanted in zip(seen, gradient_frames()):
        # A wrong matrix or range would leave errors of 0.03.
        assert np.abs(frame[:45, :63] / 255.0 - wanted).mean() < 0.015
    assert [item.name for item in tmp_path.iterdir()] == [path.name]


def test_the_same_frames_give_the_same_bytes(tmp_path):
    for name in ("a.mp4", "b.mp4"):
        write_video(tmp_path / name, gradient_frames(), 30)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_coded_pictures_keep_their_colors_and_their_odd_sides(tmp_path):
    """Neighbouring sub-pixels differ freely, as they do where they belong to other views."""
    frames = list(np.random.default_rng(0).integers(0, 256, (3, 45, 63, 3), np.uint8))
    error, formats = {}, {}
    for coding in ("420", "444", "lossless"):
        path = tmp_path / f"{coding}.mp4"
        assert write_video(path, frames, 30, quality=0, coding=coding) == 3
        with av.open(str(path)) as container:
            formats[coding] = container.streams.video[0].pix_fmt
            shown = [frame.reformat(format="rgb24", src_colorspace="ITU709").to_ndarray()
                     if coding != "lossless" else frame.to_ndarray(format="rgb24")
                     for frame in container.decode(video=0)]
        assert coding == "420" or shown[0].shape == (45, 63, 3)
        error[coding] = np.abs(shown[2][:45, :63].astype(float) - frames[2]).mean()
    assert formats == {"420": "yuv420p", "444": "yuv444p", "lossless": "gbrp"}
    assert error["lossless"] == 0
    assert error["444"] < 1.5
    assert error["420"] > 20


@pytest.mark.parametrize(("name", "frames", "fps", "text"), [
    ("a.mp4", [], 30, "no frames"), ("a.avi", [np.zeros((4, 4, 3))], 30, "end the name in .mp4"),
    ("a.mp4", [np.zeros((4, 4, 3))], 0, "frames per second")])
def test_bad_videos_are_told_and_leave_nothing(tmp_path, name, frames, fps, text):
    with pytest.raises(UserError, match=text):
        write_video(tmp_path / name, frames, fps)
    assert not list(tmp_path.iterdir())


def test_frames_must_have_one_size(tmp_path):
    with pytest.raises(ValueError, match="frame 1"):
        write_video(tmp_path / "a.mp4", [np.zeros((4, 4, 3)), np.zeros((6, 4, 3))], 30)
    assert not list(tmp_path.iterdir())


def test_a_sweep_runs_over_the_cone_there_and_back_without_a_seam():
    yaw = sweep_degrees(60, 40.0)
    assert yaw[0] == 0 and yaw.max() == pytest.approx(20) and yaw.min() == pytest.approx(-20)
    steps = np.abs(np.diff(np.append(yaw, yaw[0])))
    assert steps.max() < 2.2 and steps[13:17].max() < 0.4  # even, and slow at the ends
    cameras = sweep_cameras(40.0, 60, 64)
    forward = cameras.pose[:, :3, 2]
    assert np.degrees(np.arctan2(-forward[:, 0], -forward[:, 2])) == pytest.approx(yaw)


def test_a_sweep_goes_no_further_than_a_head_is_good():
    field = ball(0.6)
    assert good_cone(field, 60.0) == 60.0
    field.cone = 40.0
    assert good_cone(field, 60.0) == 40.0 and good_cone(field, 30.0) == 30.0


def test_an_orbit_looks_from_all_sides():
    cameras = path_cameras("orbit", frames=8, size=32)
    assert cameras.position[0, 2] > 3 and cameras.position[4, 2] < -3
    assert cameras.position[2, 0] > 3
    with pytest.raises(UserError, match="sweep or orbit"):
        path_cameras("spiral")
    with pytest.raises(UserError, match="at least one frame"):
        path_cameras("sweep", frames=0)


@pytest.mark.parametrize("height", [-0.2, 0.0, 0.3])
def test_frames_show_the_whole_head_centred(height):
    field = ball(0.6, height=height)
    frames = list(sweep_frames(field, 60.0, 4, 64, background=0.0))
    for frame in frames:
        covered = frame.max(axis=2) > 60
        rows, columns = np.nonzero(covered)
        assert abs(rows.mean() - 31.5) < 2 and abs(columns.mean() - 31.5) < 2
        assert rows.min() > 0 and rows.max() < 63 and columns.min() > 0 and columns.max() < 63
        assert covered.mean() > 0.45
    # From the right (frame 1) more of the red half is seen, from the left more of the blue.
    red = [int((frame[..., 0] > 128).sum()) for frame in frames]
    assert red[1] > red[0] > red[3]
    assert np.array_equal(frames[0], frames[2])


@pytest.mark.slow  # writes many; other videos: above
@pytest.mark.parametrize(("count", "size"), [
    pytest.param(1, (320, 540), marks=pytest.mark.slow), (2, (160, 270))])
def test_the_shortest_hevc_videos_are_written_each_time(tmp_path, count, size):
    # With B-frames an eighth of the first and half of the second failed.
    for seed in range(12):
        frames = np.random.default_rng(seed).integers(0, 255, (count, *size, 3), np.uint8)
        assert write_video(tmp_path / "x.mp4", iter(frames), 30, codec="hevc") == count
