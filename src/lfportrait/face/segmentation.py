"""Which pixels are face, hair and person.

Mattes of person and hair are MediaPipe's, which runs the official TensorFlow Lite files itself. Two
small networks give person and hair; where the file of a third one, which separates six parts of a
person, is at hand, both come from that. All were trained on pictures that the person fills,
upright, so the picture is turned upright first, and the result turned back. MediaPipe's
tasks are made without log output, and are not closed when the process ends.

The face mask is that of Shen et al. 2023, Fig. 3: the jaw's landmarks and an ellipse through its
upper ends bound the face without its forehead. The skin's color is sampled inside, and what
continues the face above the brows in that color, in one connected piece, is forehead; hair and
fringe differ and stay out.
"""

import atexit
import functools
import importlib
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image
from scipy import ndimage
from skimage.draw import polygon2mask

from .. import models
from ..arrays import Array, Bool, Float32, Float64, UInt8
from ..color import LUMA
from ..errors import UserError
from ..labels import SEGMENTS

_MULTICLASS = "multiclass-segmentation"


@functools.lru_cache(maxsize=4)
def _segmenter(path: Path, size: int) -> Any:
    """A network for pictures of ``size`` x ``size`` pixels."""
    content, channels = _described(path.read_bytes(), size)

    def make() -> Any:
        from mediapipe.tasks.python import BaseOptions, vision

        return vision.ImageSegmenter.create_from_options(vision.ImageSegmenterOptions(
            base_options=BaseOptions(model_asset_buffer=content), output_confidence_masks=True))

    return made(make, lambda task: task.segment(
        picture(np.zeros((size, size, channels), np.uint8))))


def _described(content: bytes, size: int) -> tuple[bytes, int]:
    """A TensorFlow Lite file as ImageSegmenter wants it, and its number of color channels.

    The files of the two small networks say nowhere what range their input has: 0 to 1. Without that
    they are refused. They also work on pictures of another size than the one that they name.
    """
    _import_mediapipe()
    import flatbuffers
    from mediapipe.tasks.metadata import metadata_schema_py_generated as about
    from mediapipe.tasks.metadata import schema_py_generated as schema

    def table(kind: Any, **fields: Any) -> Any:
        made = kind()
        vars(made).update(fields)
        return made

    def packed(top: Any, mark: bytes) -> bytes:
        builder = flatbuffers.Builder()
        builder.Finish(top.Pack(builder), mark)
        return bytes(builder.Output())

    model = schema.ModelT.InitFromObj(schema.Model.GetRootAs(content))
    graph = model.subgraphs[0]
    frame = graph.tensors[graph.inputs[0]]
    channels = int(frame.shape[3])
    if not model.metadata:
        frame.shape = [1, size, size, channels]
        unit = table(about.ProcessUnitT,
                     optionsType=about.ProcessUnitOptions.NormalizationOptions,
                     options=table(about.NormalizationOptionsT, mean=[0.0], std=[255.0]))
        tensors = table(about.SubGraphMetadataT, outputTensorMetadata=[about.TensorMetadataT()],
                        inputTensorMetadata=[table(about.TensorMetadataT, processUnits=[unit])])
        text = packed(table(about.ModelMetadataT, subgraphMetadata=[tensors]), b"M001")
        model.metadata = [table(schema.MetadataT, name="TFLITE_METADATA",
                                buffer=len(model.buffers))]
        model.buffers.append(table(schema.BufferT, data=np.frombuffer(text, np.uint8)))
        content = packed(model, b"TFL3")
    return content, channels


def _run(name: str, frame: UInt8) -> Float32:
    """The output [h, w, c] of a network for one square picture [H, H, C], read only.

    A painting is looked at again whenever one of its landmarks was moved.
    """
    return _output(models.fetch(name), frame.tobytes(), len(frame))


@functools.lru_cache(maxsize=6)
def _output(path: Path, content: bytes, side: int) -> Float32:
    """The output [h, w, c] of the network in a file for a picture's bytes; the last are kept."""
    frame = np.frombuffer(content, np.uint8).reshape(side, side, -1)
    found = _segmenter(path, side).segment(picture(frame))
    out = np.stack([mask.numpy_view().reshape(side, side) for mask in found.confidence_masks],
                   axis=-1)
    out.setflags(write=False)
    return out


def _softmax(values: Float32) -> Float32:
    powers = np.exp(values - values.max(axis=-1, keepdims=True))
    return powers / powers.sum(axis=-1, keepdims=True)


def quarter_turns(up: Array | None) -> int:
    """Quarter turns (counter-clockwise) that put the direction ``up`` (x right, y down) on top."""
    if up is None:
        return 0
    x, y = float(up[0]), float(up[1])
    if abs(x) > abs(y):
        return 1 if x > 0 else 3
    return 0 if y <= 0 else 2


def _resized(image: UInt8, size: int) -> UInt8:
    """The picture as the networks want it: [size, size, 3]."""
    # Whole blocks of pixels first, where there are some: as good, and several times faster.
    return np.asarray(Image.fromarray(np.ascontiguousarray(image)).resize(
        (size, size), Image.Resampling.BILINEAR, reducing_gap=1.0))


def _full_size(mask: Float32, image: UInt8) -> Float32:
    """One map [h, w] of a network as a matte of its picture."""
    full = cv2.resize(mask, (image.shape[1], image.shape[0]), interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(np.clip(full, 0, 1), np.float32)


def person_matte(image: UInt8, up: Array | None = None) -> Float32:
    """How much of each pixel is the person, float32 [H, W] in [0, 1]; of 256x256 pixels.

    The picture, uint8 [H, W, 3] sRGB, is turned to the nearest quarter before the network sees it:
    ``up`` is the direction [2] in it that is up in the world (x right, y down). Raises `UserError`
    if the network's weights are missing.
    """
    turns = quarter_turns(up)
    upright = np.ascontiguousarray(np.rot90(image, turns))
    if models.available(_MULTICLASS):
        matte = 1 - _shares(upright)[..., 0]
    else:
        matte = _run("person-segmentation", _resized(upright, 256))[..., 0]
    return np.ascontiguousarray(np.rot90(_full_size(matte, upright), -turns))


def hair_mask(image: UInt8, size: int = 512) -> Float32:
    """How much of each pixel of a picture is hair, float32 [H, W] in [0, 1]; see `person_matte`.

    ``size`` is the side of the picture that the network sees, a multiple of 32. It was trained on
    512; on photos 384 takes two thirds of the time and differs in less than one pixel of 200, 256
    two fifths and in less than one of 100; paintings want 512. The network of six parts always sees
    256.
    """
    if models.available(_MULTICLASS):
        return _full_size(_shares(image)[..., 1], image)
    # The fourth channel is the hair of the frame before, of which nothing is known.
    frame = np.dstack([_resized(image, size), np.zeros((size, size), np.uint8)])
    return _full_size(_softmax(_run("hair-segmentation", frame))[..., 1], image)


def mattes(image: UInt8, size: int = 512) -> tuple[Float32, Float32]:
    """`person_matte` and `hair_mask`, [H, W] each; the network of six parts runs once for both."""
    if not models.available(_MULTICLASS):
        return person_matte(image), hair_mask(image, size)
    shares = _shares(image)
    return _full_size(1 - shares[..., 0], image), _full_size(shares[..., 1], image)


def parts(image: UInt8) -> dict[str, Float32]:
    """How much of each pixel is each part of a person, by the network of six parts.

    float32 [H, W] in [0, 1] for each name of `SEGMENTS`; they sum to 1. This is written against the
    network's documented input and outputs, and tested with a stand-in of the same shapes: its file
    was not at hand. Raises `UserError` if the network (``multiclass-segmentation``) is missing, or
    its file has other outputs.
    """
    shares = _shares(image)
    return {name: _full_size(shares[..., index], image) for index, name in enumerate(SEGMENTS)}


def _shares(image: UInt8) -> Float32:
    """Confidences [256, 256, 6] of the classes."""
    result = _run(_MULTICLASS, _resized(image, 256))
    if result.shape[-1] != len(SEGMENTS):
        raise UserError(f"the network {_MULTICLASS} has {result.shape[-1]} classes instead of "
                        f"{len(SEGMENTS)}; get its file again: lfportrait models fetch "
                        f"{_MULTICLASS}")
    # The documents call its output logits in one place, confidences in another.
    ready = bool((result >= 0).all()) and bool((abs(result.sum(-1) - 1) < 1e-3).all())
    return result if ready else _softmax(result)


_LOCK = threading.Lock()
"""Standard error is silenced for the whole process: by one thread at a time."""


def made(make: Callable[[], Any], first: Callable[[Any], object]) -> Any:
    """A task that is made, and its first run, with none of the chatter on standard error."""
    _import_mediapipe()
    os.environ.setdefault("GLOG_minloglevel", "3")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    with _LOCK:
        saved = os.dup(2)
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 2)
        try:
            task = make()
            # When the process ends, closing would fail on threads and modules that are gone already
            # (and say so on standard error); the system frees everything anyway.
            atexit.register(setattr, task, "_handle", None)
            first(task)
            return task
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            os.close(silent)


@functools.cache
def _import_mediapipe() -> None:
    """Import MediaPipe in a thread of its own.

    It keeps the error of an import that may fail (of its audio tasks), and by that the frames of
    whoever imported it, with all that they hold: 0.8 GB of what trains a field.
    """
    with ThreadPoolExecutor(1, "import") as thread:
        thread.submit(importlib.import_module, "mediapipe.tasks.python").result()


def picture(image: UInt8) -> Any:
    """A picture, uint8 [H, W, 3 or 4], as MediaPipe wants it."""
    import mediapipe

    kind = mediapipe.ImageFormat.SRGB if image.shape[2] == 3 else mediapipe.ImageFormat.SRGBA
    return mediapipe.Image(image_format=kind, data=np.ascontiguousarray(image))


FINE = 160  # Minimum width of the face in blocks of pixels.
SOFTNESS = 0.02  # Width of a face's edge (sigma) over the face's width.


def _chroma(image: Array) -> Float32:
    """Cb and Cr of an sRGB picture (ITU-R BT.601), [H, W, 2], in units of 1/255, and luma."""
    rgb = np.asarray(image, np.float32)
    luma = rgb @ LUMA
    return np.stack([0.564 * (rgb[..., 2] - luma), 0.713 * (rgb[..., 0] - luma), luma], axis=-1)


def _forehead(landmarks: Float64, reach: float) -> Float64:
    """The upper half of an ellipse on the line between the jaw's ends, turned with the head."""
    left, right = landmarks[0], landmarks[16]
    middle, across = 0.5 * (left + right), 0.5 * (right - left)
    upward = middle - landmarks[8]
    upward = upward - across * (upward @ across) / max(float(across @ across), 1e-9)
    upward /= max(float(np.linalg.norm(upward)), 1e-9)
    face = float(np.linalg.norm(landmarks[8] - middle))
    angle = np.linspace(np.pi, 0, 40)[:, None]
    return middle - across * -np.cos(angle) + upward * np.sin(angle) * reach * face


def face_mask(image: UInt8, landmarks: Float64) -> Float32:
    """The soft mask of the face in a photo uint8 [H, W, 3] (sRGB), float32 [H, W] in [0, 1].

    By landmarks float64 [68, 2] in pixels.
    """
    jaw = landmarks[:17]
    limit = np.concatenate([jaw, _forehead(landmarks, 0.85)[::-1]])
    # Only the face's surroundings are looked at, by blocks of pixels: the edge is soft anyway.
    width = float(np.linalg.norm(landmarks[16] - landmarks[0]))
    block = max(1, int(width / FINE))
    margin = 4 * SOFTNESS * width + block
    low = np.maximum(np.floor(limit.min(0) - margin), 0).astype(int) // block * block
    high = np.minimum(np.ceil(limit.max(0) + margin), image.shape[1::-1]).astype(int)
    out = np.zeros(image.shape[:2], np.float32)
    if (high <= low).any():
        return out
    small = np.asarray(Image.fromarray(np.ascontiguousarray(image[..., :3])).reduce(
        block, (int(low[0]), int(low[1]), int(high[0]), int(high[1]))))
    mask = _small_mask(small, (landmarks - low) / block)
    size = small.shape[1] * block, small.shape[0] * block
    full = np.asarray(Image.fromarray(mask).resize(size, Image.Resampling.BILINEAR))
    x, y = low
    out[y:high[1], x:high[0]] = full[:high[1] - y, :high[0] - x]
    return out


def _small_mask(image: UInt8, landmarks: Float64) -> Float32:
    """`face_mask` of a picture that holds little else."""
    shape = image.shape[:2]

    def filled(outline: Float64) -> Bool:
        # Points are continuous, pixels lie at their middles.
        return polygon2mask(shape, outline[:, ::-1] - 0.5)

    jaw = landmarks[:17]
    width = float(np.linalg.norm(landmarks[16] - landmarks[0]))
    sure = filled(np.concatenate([jaw, _forehead(landmarks, 0.35)[::-1]]))
    limit = filled(np.concatenate([jaw, _forehead(landmarks, 0.85)[::-1]]))
    color = _chroma(image)
    # Skin between brows and mouth, away from eyes and lips, on both sides of its own spread.
    sample = filled(landmarks[[17, 19, 24, 26, 14, 12, 4, 2]])
    for feature in (slice(36, 42), slice(42, 48), slice(48, 60)):
        hull = landmarks[feature]
        grown = hull.mean(0) + 1.6 * (hull - hull.mean(0))
        sample &= ~filled(grown)
    pixels = color[sample] if sample.sum() > 50 else color[sure] if sure.any() else color[:1, 0]
    center = np.median(pixels, axis=0)
    spread = 1.4826 * np.median(np.abs(pixels - center), axis=0)
    spread = np.maximum(spread, np.array([3.0, 3.0, 14.0], np.float32))
    distance = np.abs(color - center) / spread
    skin = (distance[..., 0] < 4.0) & (distance[..., 1] < 4.0) & (distance[..., 2] < 3.5)
    candidate = ndimage.binary_opening((skin & limit) | sure, iterations=max(1, int(width / 120)))
    parts, _ = ndimage.label(candidate)
    wanted = np.unique(parts[sure & candidate])
    face = np.isin(parts, wanted[wanted > 0]) | sure
    face = ndimage.binary_fill_holes(face)
    face = ndimage.binary_closing(face, iterations=max(1, int(width / 60))) & limit | sure
    return np.clip(ndimage.gaussian_filter(face.astype(np.float32), SOFTNESS * width), 0, 1)
