"""Videos of standard range are read as their matrix and range say, or as players take them."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from lfportrait.capture import read_video
from lfportrait.errors import UserError

MATRICES = {1: (0.2126, 0.0722), 6: (0.299, 0.114), 9: (0.2627, 0.0593)}


def patches(width: int, height: int) -> np.ndarray:
    colors = np.random.default_rng(5).integers(0, 256, (6, 8, 3)).astype(np.uint8)
    return np.kron(colors, np.ones((height // 6, width // 8, 1), np.uint8))


def planes(image: np.ndarray, matrix: int, full: bool) -> np.ndarray:
    red, blue = MATRICES[matrix]
    value = image / 255.0
    luma = value @ (red, 1 - red - blue, blue)
    chroma = [(value[..., 2] - luma) / (2 * (1 - blue)), (value[..., 0] - luma) / (2 * (1 - red))]
    swing, low, wide = (255, 0, 255) if full else (219, 16, 224)
    found = np.stack([low + swing * luma, *(128 + wide * one for one in chroma)])
    return np.clip(np.round(found), 0, 255).astype(np.uint8)


def write(path: Path, images: list[np.ndarray], matrix: int, full: bool = False, said: bool = True,
          times: list[int] | None = None) -> Path:
    height, width = images[0].shape[:2]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"crf": "1"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv444p"
        stream.time_base = stream.codec_context.time_base = Fraction(1, 1000)
        if said:
            context = stream.codec_context
            # Primaries other than sRGB's would be converted; here the matrix alone counts.
            context.colorspace, context.color_primaries = matrix, 1
            context.color_range = 2 if full else 1
        for number, image in enumerate(images):
            frame = av.VideoFrame(width, height, "yuv444p")
            for plane, values in zip(frame.planes, planes(image, matrix, full)):
                data = np.zeros((height, plane.line_size), np.uint8)
                data[:, :width] = values
                plane.update(data.tobytes())
            if said:
                frame.colorspace, frame.color_range = matrix, 2 if full else 1
                frame.color_primaries = 1
            frame.pts, frame.time_base = (times or [33 * n for n in range(len(images))])[
                number], Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("matrix", MATRICES)
def test_matrix_and_range_are_the_streams(tmp_path, matrix, full):
    image = patches(96, 96)
    path = write(tmp_path / "v.mp4", [image] * 3, matrix, full)
    assert np.abs(read_video(path, 1)[0].image.astype(float) - image).mean() < 1.5


@pytest.mark.parametrize(("width", "height", "matrix"), [(1280, 720, 1), (720, 1280, 1),
                                                         (640, 480, 6)])
def test_what_says_nothing_is_as_players_take_it(tmp_path, width, height, matrix):
    image = patches(width, height)
    found = read_video(write(tmp_path / "v.mp4", [image] * 2, matrix, said=False), 1)[0].image
    assert np.abs(found.astype(float) - image[:found.shape[0], :found.shape[1]]).mean() < 1.5


def test_even_time_is_the_clocks_not_the_frames(tmp_path):
    """A phone in the dark films more slowly."""
    times = [*range(0, 400, 10), *range(400, 1600, 100)]
    images = [np.full((96, 96, 3), 4 * (number + 1), np.uint8) for number in range(len(times))]
    path = write(tmp_path / "v.mp4", images, 6, times=times)
    photos = read_video(path, 4, spacing="time")
    shown = [times[round(photo.image.mean() / 4) - 1] for photo in photos]
    assert [min(time // 375, 3) for time in shown] == [0, 1, 2, 3]


def test_a_file_without_pictures_is_one_line(tmp_path):
    path = tmp_path / "sound.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), "fltp", "mono")
        frame.sample_rate, frame.pts = 8000, 0
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    with pytest.raises(UserError, match="no video stream") as told:
        read_video(path, 3)
    assert "\n" not in str(told.value)
