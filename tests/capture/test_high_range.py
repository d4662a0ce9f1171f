"""Videos of high dynamic range look as their twins of standard range do."""

from pathlib import Path

import av
import numpy as np
import pytest

from lfportrait.capture import read_video, video_frames
from lfportrait.color import linear_light

RED, GREEN, BLUE = 0.2627, 0.6780, 0.0593
TO_2020 = np.array([[0.627404, 0.329283, 0.043313], [0.069097, 0.919540, 0.011362],
                    [0.016391, 0.088013, 0.895595]])


def picture():
    """A picture of all tones and of many colors, uint8 [96, 128, 3]."""
    y, x = np.mgrid[:96, :128]
    grey = 20 + 220 * x / 127
    tint = np.stack([np.sin(x / 17), np.sin(y / 11 + 2), np.sin((x + y) / 23 + 4)], axis=-1)
    return np.uint8(np.clip(grey[..., None] + 45 * tint, 0, 255))


def hlg(light):
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    return np.where(light <= 1 / 12, np.sqrt(3 * light),
                    a * np.log(np.maximum(12 * light - b, 1e-9)) + c)


def pq(nits):
    y = (np.maximum(nits, 0) / 10_000) ** 0.1593017578125
    return ((0.8359375 + 18.8515625 * y) / (1 + 18.6875 * y)) ** 78.84375


def signal_of(image, kind):
    light = linear_light(image / 255.0) @ TO_2020.T
    if kind == "pq":
        return pq(203 * light)
    if kind == "hlg of the scene":
        return hlg(0.265 * light)
    display = 0.203 * light  # of a display of 1000 candela per square metre
    luma = np.maximum(display @ (RED, GREEN, BLUE), 1e-9)
    return hlg(display * luma[..., None] ** (1 / 1.2 - 1))


def write(path: Path, signal, trc: int, full: bool) -> Path:
    """Ten bits, HEVC, the matrix of BT.2020, as phones write it."""
    luma = signal @ (RED, GREEN, BLUE)
    planes = [luma, (signal[..., 2] - luma) / 1.8814, (signal[..., 0] - luma) / 1.4746]
    scale, low, swing = (1023, 0, 1023) if full else (876, 64, 896)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx265", rate=24, options={"crf": "8", "x265-params":
                                                                   "log-level=none"})
        stream.width, stream.height, stream.pix_fmt = signal.shape[1], signal.shape[0], (
            "yuv420p10le")
        context = stream.codec_context
        context.color_primaries, context.color_trc, context.colorspace = 9, trc, 9
        context.color_range = 2 if full else 1
        frame = av.VideoFrame(signal.shape[1], signal.shape[0], "yuv420p10le")
        frame.color_primaries, frame.color_trc, frame.colorspace = 9, trc, 9
        frame.color_range = 2 if full else 1
        for number, plane in enumerate(planes):
            if number:
                plane = plane.reshape(plane.shape[0] // 2, 2, -1, 2).mean(axis=(1, 3))
                values = 512 + swing * plane
            else:
                values = low + scale * plane
            data = np.zeros((frame.planes[number].height, frame.planes[number].line_size // 2),
                            "<u2")
            data[:, :plane.shape[1]] = np.clip(np.round(values), 0, 1023)
            frame.planes[number].update(data.tobytes())
        for count in range(6):
            frame.pts = count
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("kind", ["hlg of the scene", "hlg of the display", "pq"])
def test_high_range_looks_as_standard_range_does(tmp_path, kind, full):
    image = picture()
    path = write(tmp_path / "v.mov", signal_of(image, kind), 16 if kind == "pq" else 18, full)
    photo = read_video(path, 2)[0]
    apart = np.abs(photo.image.astype(float) - image)
    assert photo.image.shape == image.shape
    assert apart.mean() < 8
    dark = image.max(axis=-1) < 100
    assert abs((photo.image.astype(float) - image)[dark].mean()) < 10
    _, frames = video_frames(path)
    assert np.abs(next(frames).astype(float) - image).mean() < 8


def test_a_large_frame_is_reduced_before_it_is_mapped(tmp_path):
    path = write(tmp_path / "v.mov", signal_of(picture(), "hlg of the scene"), 18, False)
    photo = read_video(path, 2, max_side=64)[0]
    assert photo.image.shape == (48, 64, 3)
    assert np.abs(photo.image.astype(float) - picture()[::2, ::2]).mean() < 10
