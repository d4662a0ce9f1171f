"""Films with pixels that are not square, cover pictures, wide colors, and names that lie."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from lfportrait.capture import is_video, read_source, read_video, video_frames
from lfportrait.errors import UserError


def film(path: Path, image: np.ndarray, *, aspect: Fraction | None = None, turn: int = 0,
         cover: bool = False, numbers: tuple[int, int, int] | None = None,
         form: str | None = None, frames: int = 3) -> Path:
    """A short film; ``numbers``: primaries, transfer and matrix."""
    height, width = image.shape[:2]
    with av.open(str(path), "w", format=form) as container:
        if cover:
            still = container.add_stream("mjpeg", rate=1)
            still.width, still.height, still.pix_fmt = 64, 64, "yuvj444p"
            still.disposition = av.stream.Disposition.attached_pic
        stream = container.add_stream("libx264", rate=30, options={"crf": "2"}) if frames else None
        if stream is not None:
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv444p"
            if aspect:
                stream.codec_context.sample_aspect_ratio = aspect
            if turn:
                stream.set_display_rotation(turn) if hasattr(
                    stream, "set_display_rotation") else pytest.skip("PyAV writes no rotation")
            if numbers:
                context = stream.codec_context
                context.color_primaries, context.color_trc, context.colorspace = numbers
                context.color_range = 1
        if cover:
            black = av.VideoFrame.from_ndarray(np.zeros((64, 64, 3), np.uint8), "rgb24")
            black = black.reformat(format="yuvj444p")
            black.pts = 0
            container.mux(still.encode(black))
            container.mux(still.encode())
        for number in range(frames):
            source = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), "rgb24")
            matrix = numbers[2] if numbers else None
            frame = source.reformat(format="yuv444p", dst_colorspace=matrix, dst_color_range=1)
            if numbers:
                frame.color_primaries, frame.color_trc, frame.colorspace = numbers
            frame.pts, frame.time_base = number, Fraction(1, 30)
            container.mux(stream.encode(frame))
        if stream is not None:
            container.mux(stream.encode())
    return path


def halves(height: int = 96, width: int = 128) -> np.ndarray:
    """White above black."""
    image = np.zeros((height, width, 3), np.uint8)
    image[:height // 2] = 255
    return image


@pytest.mark.parametrize(("size", "aspect", "wanted"), [
    ((576, 720), Fraction(16, 11), (576, 1047)), ((480, 720), Fraction(8, 9), (540, 720)),
    ((96, 128), Fraction(1, 1), (96, 128)), ((96, 128), None, (96, 128))])
def test_pixels_become_square(tmp_path, size, aspect, wanted):
    path = film(tmp_path / "a.mp4", halves(*size), aspect=aspect)
    image = read_video(path, 1)[0].image
    assert image.shape[:2] == wanted
    assert image[10].min() > 240 and image[-10].max() < 15
    assert next(video_frames(path)[1]).shape[:2] == wanted
    small = read_video(path, 1, max_side=64)[0].image
    assert max(small.shape[:2]) == 64
    assert abs(small.shape[1] / small.shape[0] - wanted[1] / wanted[0]) < 0.03


def test_a_cover_picture_is_not_the_film(tmp_path):
    path = film(tmp_path / "a.mp4", np.full((96, 128, 3), 200, np.uint8), cover=True)
    with av.open(str(path)) as container:
        if not any(stream.disposition & av.stream.Disposition.attached_pic
                   for stream in container.streams.video):
            pytest.skip("this FFmpeg writes no cover picture")
    photos = read_video(path, 2)
    assert photos[0].image.shape == (96, 128, 3) and photos[0].image.min() > 190
    assert next(video_frames(path)[1]).shape == (96, 128, 3)


def test_a_cover_alone_is_one_line(tmp_path):
    path = film(tmp_path / "a.mp4", halves(), cover=True, frames=0)
    with av.open(str(path)) as container:
        if not container.streams.video[0].disposition & av.stream.Disposition.attached_pic:
            pytest.skip("this FFmpeg writes no cover picture")
    for read in (lambda: read_video(path, 2), lambda: video_frames(path)):
        with pytest.raises(UserError) as told:
            read()
        assert "\n" not in str(told.value) and str(path) in str(told.value)


@pytest.mark.parametrize("numbers", [(9, 14, 9), (9, 1, 9)])
def test_wide_colors_of_standard_range(tmp_path, numbers):
    image = np.full((96, 128, 3), (202, 59, 19), np.uint8)
    image[:, 64:] = 130
    found = read_video(film(tmp_path / "a.mp4", image, numbers=numbers), 1)[0].image
    assert found[48, 30, 0] > 245 and found[48, 30, 1:].max() < 25
    assert np.abs(found[48, 100].astype(int) - 130).max() <= 3


@pytest.mark.parametrize("name", ["a.MOV", "a", "a.jpg", "a.avi"])
@pytest.mark.parametrize("form", ["matroska", "mp4", "avi"])
def test_names_that_lie(tmp_path, name, form):
    path = film(tmp_path / name, halves(), form=form)
    assert is_video(path)
    assert read_source(path, frames=2)[0].image.shape == (96, 128, 3)


def test_a_photo_named_as_a_film_is_none(tmp_path):
    Image.new("RGB", (8, 8)).save(tmp_path / "a.mp4", "JPEG")
    assert not is_video(tmp_path / "a.mp4")


def test_a_film_that_is_none_is_one_line(tmp_path):
    (tmp_path / "a.mp4").write_bytes(bytes(5000))
    with pytest.raises(UserError, match="can't be read") as told:
        read_video(tmp_path / "a.mp4", 2)
    assert "\n" not in str(told.value)
