"""Finding a face and its 68 landmarks in one picture.

MediaPipe's face landmarker does most of the work, on the whole picture and, where it finds nothing,
on enlarged crops and turned by quarter turns.

Paintings and sculptures that it does not take for a face are tried with face-api's networks, which
were published for face-api.js (MIT): the detector is a separable tiny YOLOv2 on a 416x416 picture,
the landmark network four dense blocks on a 112x112 crop. They are small enough to be computed with
NumPy in hundredths of a second; importing torch for them took a second. Layers are float32
[H, W, C].
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

import numpy as np
from PIL import Image
from safetensors.numpy import load_file

from .. import models
from ..arrays import Float32, Float64, UInt8
from ..cache import key_of
from .landmarks import FROM_MEDIAPIPE, centred
from .segmentation import made, picture

_AROUND = 1.5
_MANY = 8  # Faces that are looked for in a picture.


def detectors_key() -> str:
    """Hash of what finds landmarks: the networks that are at hand, and the code of this package."""
    return key_of(__name__, models.in_use(
        ["face-landmarker", "face-landmarks-68", "face-detector"]))


@functools.lru_cache(maxsize=4)
def _landmarker(path: str, faces: int) -> Any:
    """MediaPipe's detector of up to ``faces`` faces, one per process."""
    def make() -> Any:
        from mediapipe.tasks.python import BaseOptions, vision

        return vision.FaceLandmarker.create_from_options(vision.FaceLandmarkerOptions(
            base_options=BaseOptions(model_asset_path=path), num_faces=faces,
            min_face_detection_confidence=0.4))

    return made(make, lambda task: task.detect(picture(np.zeros((64, 64, 3), np.uint8))))


def face_mesh(image: UInt8) -> Float64 | None:
    """All points of MediaPipe's mesh of the surest face in a picture, or None without a face.

    The picture is uint8 [H, W, 3], sRGB, of one face; the points are float64 [478, 2] in pixels, in
    MediaPipe's order (468 to 472 the iris on the picture's left, 473 to 477 the other one).
    """
    return next(iter(_points(image, 1)), None)


def _points(image: UInt8, most: int) -> list[Float64]:
    """MediaPipe's points [478, 2] of ``most`` faces, the surest first."""
    detector = _landmarker(str(models.fetch("face-landmarker")), most)
    return [np.array([(point.x, point.y) for point in mesh]) * image.shape[1::-1]
            for mesh in detector.detect(picture(image)).face_landmarks]


def _meshes(image: UInt8, most: int = 1) -> list[Float64]:
    """MediaPipe's points of ``most`` faces mapped to 68 landmarks [68, 2], the largest first."""
    faces: list[Float64] = []
    for mesh in _points(image, most):
        if not _among(points := mesh[FROM_MEDIAPIPE], faces):
            faces.append(points)
    return sorted(faces, key=_extent, reverse=True)


def _among(points: Float64, faces: list[Float64]) -> bool:
    """Whether landmarks are those of a face that was found before."""
    return any(np.linalg.norm(points.mean(axis=0) - one.mean(axis=0)) < 0.3 * _extent(one)
               for one in faces)


def _extent(points: Float64) -> float:
    """Size of a face in pixels: the diagonal of its landmarks' box."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def detect_faces(image: UInt8, near: tuple[float, float] | None = None, *,
                 thorough: bool = True) -> list[Float64]:
    """The 68 landmarks of every face in a picture, uint8 [H, W, 3] sRGB, the largest first.

    As `detect_landmarks`, float64 [68, 2] each. ``near`` is a place (x, y) in pixels on the one
    face that is meant, for those that are overlooked, or where a pattern is taken for one: windows
    around it are looked at, and only a face whose landmarks surround it is given back.
    ``thorough``: crops are looked at, too; a picture that shows one face gives what
    `detect_landmarks` finds.
    """
    height, width = image.shape[:2]
    windows = list(_windows(height, width) if near is None else _around(near, height, width))
    if near is None and not thorough:
        windows = windows[:1]
    faces: list[Float64] = []
    for x0, y0, x1, y1 in windows:
        for points in _meshes(image[y0:y1, x0:x1], _MANY):
            points = points + np.array([x0, y0])
            if near is not None and not _within(points, near):
                continue
            # The same face in another window: the first window shows most of it.
            if not _among(points, faces):
                faces.append(_second_opinion(image, points))
        if near is not None and faces:
            return faces[:1]
    if len(faces) < 2 and near is None:
        one = detect_landmarks(image)
        return [] if one is None else [one]
    return sorted(faces, key=_extent, reverse=True)


def _around(near: tuple[float, float], height: int, width: int,
            ) -> Iterator[tuple[int, int, int, int]]:
    """Crops (x0, y0, x1, y1) around a place, from large to small."""
    for part in (1.0, 0.7, 0.5, 0.35, 0.25, 0.17):
        half = 0.5 * part * max(height, width)
        x0, y0 = (int(np.clip(at - half, 0, end - 1)) for at, end in zip(near, (width, height),
                                                                       strict=True))
        x1, y1 = (int(np.clip(at + half, 1, end)) for at, end in zip(near, (width, height),
                                                                    strict=True))
        if x1 - x0 >= 32 and y1 - y0 >= 32:
            yield x0, y0, x1, y1


def _within(points: Float64, place: tuple[float, float]) -> bool:
    """Whether a place lies in the box around landmarks, forehead included."""
    low, high = points.min(axis=0), points.max(axis=0)
    low = low - [0.0, 0.4 * (high[1] - low[1])]
    return bool((np.asarray(place) >= low).all() and (np.asarray(place) <= high).all())


def _windows(height: int, width: int) -> Iterator[tuple[int, int, int, int]]:
    """Crops (x0, y0, x1, y1) to try: the whole, then a middle, then overlapping quarters."""
    yield 0, 0, width, height
    for part in (0.7, 0.5):
        w, h = int(width * part), int(height * part)
        for fy in (0.5, 0.0, 1.0):
            for fx in (0.5, 0.0, 1.0):
                x, y = int((width - w) * fx), int((height - h) * fy)
                yield x, y, x + w, y + h


def _inside_a_head(image: UInt8, points: Float64) -> bool:
    """Whether what was taken for a face, [68, 2], is a part of a larger head: a profile's ear."""
    if not models.available("person-segmentation"):
        return False
    from .segmentation import person_matte

    brows = points[17:27].mean(axis=0)
    down = _AROUND * (points[8] - brows)
    turns = np.radians(np.arange(-90, 91, 30))
    around = brows - np.multiply.outer(np.cos(turns), down) + np.multiply.outer(
        np.sin(turns), [down[1], -down[0]])
    x, y = np.floor(around).astype(np.int64).T
    if min(x.min(), y.min()) < 0 or x.max() >= image.shape[1] or y.max() >= image.shape[0]:
        return False
    return bool((person_matte(np.ascontiguousarray(image))[y, x] > 0.9).all())


def _second_opinion(image: UInt8, points: Float64) -> Float64:
    """The mean of MediaPipe's landmarks and face-api's, where both saw the same face.

    The two err in different directions: over 14 painted and sculpted portraits the mean error is
    0.036 of the distance of the outer eye corners, against 0.040 and 0.045 of the single ones.
    """
    if not models.available("face-landmarks-68"):
        return points

    low, high = points.min(axis=0), points.max(axis=0)
    box = np.concatenate([low - 0.05 * (high - low), 1.1 * (high - low)])
    if (box[2:] < 16).any() or (low < 0).any() or (high > np.array(image.shape[1::-1])).any():
        return points
    other = landmarks_in_box(np.ascontiguousarray(image), box)
    eyes = float(np.linalg.norm(points[36] - points[45]))
    apart = np.linalg.norm(other - points, axis=1)
    return centred(0.5 * (points + other)) if apart.mean() < 0.15 * eyes else points


def detect_landmarks(image: UInt8, *, turns: tuple[int, ...] = (0,),
                     thorough: bool = True) -> Float64 | None:
    """The 68 landmarks of the largest face in a picture, uint8 [H, W, 3] sRGB, or None.

    They are float64 [68, 2] in pixels (x right, y down; iBUG order). ``turns`` are the quarter
    turns (counter-clockwise) of the picture to try, e.g. ``(0, 1, 2, 3)``. ``thorough``: crops, and
    the face-api networks, are tried where the whole picture shows no face, and points are refined
    by the mean of both networks.
    """
    for turn in turns:
        turned = np.rot90(image, turn)
        height, width = turned.shape[:2]
        for x0, y0, x1, y1 in _windows(height, width) if thorough else [(0, 0, width, height)]:
            faces = _meshes(turned[y0:y1, x0:x1])
            if faces:
                points = faces[0] + np.array([x0, y0])
                if (x1 - x0, y1 - y0) != (width, height) and _inside_a_head(turned, points):
                    continue
                if thorough:
                    points = _second_opinion(turned, points)
                return _turn_back(points, turn, image.shape)
    if thorough and models.available("face-detector") and models.available("face-landmarks-68"):
        for turn in turns:
            turned = np.ascontiguousarray(np.rot90(image, turn))
            found = detect_face(turned)
            if found is not None:
                return _turn_back(landmarks_in_box(turned, found[0]), turn, image.shape)
    return None


def _turn_back(points: Float64, turn: int, shape: tuple[int, ...]) -> Float64:
    """Points found in a picture turned by quarter turns, in the picture itself."""
    height, width = shape[:2]
    x, y = points[:, 0], points[:, 1]
    match turn % 4:
        case 1:
            return np.stack([width - y, x], 1)
        case 2:
            return np.stack([width - x, height - y], 1)
        case 3:
            return np.stack([y, height - x], 1)
    return points


def face_yaw(landmarks: Float64) -> float:
    """How far a face is turned, from -1 (profile to the left) over 0 (frontal) to 1.

    The nose tip's place between the outer corners of the eyes, along the line through them.
    """
    left, right = landmarks[36], landmarks[45]
    along = right - left
    share = (landmarks[30] - left) @ along / max(float(along @ along), 1e-9)
    return float(np.clip(2.0 * share - 1.0, -1.5, 1.5))


_ANCHORS = ((1.603231, 2.094468), (6.041143, 7.080126), (2.882459, 3.518061),
            (4.266906, 5.178857), (9.041765, 10.66308))


@functools.lru_cache(maxsize=4)
def _weights(name: str) -> dict[str, Float32]:
    return {key: np.asarray(value, np.float32)
            for key, value in load_file(str(models.fetch(name))).items()}


def _resized(image: UInt8, width: int, height: int) -> Float32:
    picture = Image.fromarray(image).resize((width, height), Image.Resampling.BILINEAR)
    return np.asarray(picture, np.float32)


def _convolve(x: Float32, weights: dict[str, Float32], name: str, stride: int = 1,
              padding: str = "same") -> Float32:
    """A convolution by HWIO filters, or a separable one by depthwise and pointwise filters."""
    bias = weights[f"{name}.bias"]
    filters = weights.get(f"{name}.filters")
    if filters is not None:
        x = _same(x, len(filters), stride) if padding == "same" else x
        # One product for each of the filter's places.
        return np.asarray(sum(part @ filters[row, column] for row, column, part in
                              _parts(x, len(filters), stride)) + bias, np.float32)
    depthwise = weights[f"{name}.depthwise_filter"][..., 0]
    x = _same(x, len(depthwise), stride) if padding == "same" else x
    mixed = sum(part * depthwise[row, column] for row, column, part in
                _parts(x, len(depthwise), stride))
    return np.asarray(mixed @ weights[f"{name}.pointwise_filter"][0, 0] + bias, np.float32)


def _same(x: Float32, kernel: int, stride: int) -> Float32:
    """Padded with zeros as TensorFlow does: more at the end where the padding is odd."""
    total = max((-(-len(x) // stride) - 1) * stride + kernel - len(x), 0)
    return np.pad(x, ((total // 2, total - total // 2),) * 2 + ((0, 0),))


def _parts(x: Float32, kernel: int, stride: int) -> Iterator[tuple[int, int, Float32]]:
    """What each place of a filter sees: its row and column, and every so many pixels from there."""
    last = len(x) - kernel + 1
    for row in range(kernel):
        for column in range(kernel):
            yield row, column, x[row:row + last:stride, column:column + last:stride]


def _pooled(x: Float32, stride: int) -> Float32:
    """The largest of each 2x2 pixels; what lies beyond the edge counts for nothing."""
    more = x.shape[0] % 2 if stride == 2 else 1
    x = np.pad(x, ((0, more), (0, more), (0, 0)), constant_values=-np.inf)
    return np.maximum.reduce([part for _, _, part in _parts(x, 2, stride)])


def _leaky(x: Float32) -> Float32:
    return np.maximum(x, np.float32(0.1) * x)


def detect_face(image: UInt8, least: float = 0.4) -> tuple[Float64, float] | None:
    """The box (x, y, width, height) of the most certain face, with its score, or None.

    In a picture uint8 [H, W, 3]; a box of a score below ``least`` is no face.
    """
    weights = _weights("face-detector")
    height, width = image.shape[:2]
    scale = 416.0 / max(height, width)
    wide, high = round(width * scale), round(height * scale)
    frame = np.zeros((416, 416, 3), np.float32)
    frame[:high, :wide] = _resized(image, wide, high)
    x = (frame - np.array([117.001, 114.697, 97.404], np.float32)) / np.float32(255.0)
    for layer in range(6):
        x = _leaky(_convolve(x, weights, f"conv{layer}",
                             padding="valid" if layer == 0 else "same"))
        x = _pooled(x, 2 if layer < 5 else 1)
    for name in ("conv6", "conv7", "conv8"):
        if any(key.startswith(f"{name}.") for key in weights):
            x = _convolve(x, weights, name)
            if name != "conv8":
                x = _leaky(x)
    cells = len(x)
    x = x.reshape(cells, cells, 5, -1)
    score = 1 / (1 + np.exp(-x[..., 4]))
    best = int(score.argmax())
    row, column, anchor = np.unravel_index(best, score.shape)
    if score.reshape(-1)[best] < least:
        return None
    tx, ty, tw, th = (float(v) for v in x[row, column, anchor, :4])
    size = 416.0 / cells
    center = (column + 1 / (1 + np.exp(-tx))) * size, (row + 1 / (1 + np.exp(-ty))) * size
    box = np.exp(tw) * _ANCHORS[anchor][0] * size, np.exp(th) * _ANCHORS[anchor][1] * size
    corner = center[0] - box[0] / 2, center[1] - box[1] / 2
    return np.array([*corner, *box]) / scale, float(score.reshape(-1)[best])


def landmarks_in_box(image: UInt8, box: Float64) -> Float64:
    """The 68 landmarks [68, 2] of the face in a box (x, y, width, height)."""
    weights = _weights("face-landmarks-68")
    height, width = image.shape[:2]
    x0, y0 = int(max(box[0], 0)), int(max(box[1], 0))
    x1, y1 = int(min(box[0] + box[2], width)), int(min(box[1] + box[3], height))
    crop = np.ascontiguousarray(image[y0:y1, x0:x1])
    scale = 112.0 / max(crop.shape[:2])
    wide, high = round(crop.shape[1] * scale), round(crop.shape[0] * scale)
    left, top = (112 - wide) // 2, (112 - high) // 2
    frame = np.zeros((112, 112, 3), np.float32)
    frame[top:top + high, left:left + wide] = _resized(crop, wide, high)
    x = (frame - np.array([122.782, 117.001, 104.298], np.float32)) / np.float32(255.0)
    for block in range(4):
        x = np.maximum(_convolve(x, weights, f"dense{block}.conv0", 2), 0)
        total = x
        for layer in (1, 2, 3):
            total = total + _convolve(np.maximum(total, 0) if layer > 1 else x, weights,
                                      f"dense{block}.conv{layer}")
        x = np.maximum(total, 0)
    flat = x.mean(axis=(0, 1))
    points = (flat @ weights["fc.weights"] + weights["fc.bias"]).reshape(68, 2)
    return (points * 112.0 - (left, top)) / scale + (x0, y0)
