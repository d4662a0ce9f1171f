"""Finding a face and its 68 landmarks in one picture, and those of many views in space.

MediaPipe's face landmarker does most of the work, on the whole picture and, where it finds nothing,
on enlarged crops and turned by quarter turns.

Paintings and sculptures that it does not take for a face are tried with face-api's networks, which
were published for face-api.js (MIT): the detector is a separable tiny YOLOv2 on a 416x416 picture,
the landmark network four dense blocks on a 112x112 crop. They are small enough to be computed with
NumPy in hundredths of a second; importing torch takes a second. Layers are float32 [H, W, C].

Detectors fail towards the profile; a point triangulated from the frontal views can be projected
into any. Each point is found by robust least squares: a linear solution, then Gauss-Newton on the
pixel errors with Cauchy weights, so that single wrong detections lose their say.
"""

import functools
from collections.abc import Iterator
from typing import Any

import numpy as np
from PIL import Image
from safetensors.numpy import load_file

from .. import models
from ..arrays import Bool, Float32, Float64, Int64, UInt8
from ..cache import key_of
from ..capture import Camera, Capture, focus_point
from ..progress import Progress, note
from .landmarks import FROM_MEDIAPIPE, centred
from .segmentation import made, picture, quarter_turns

_AROUND = 1.5
_MANY = 8  # Faces that are looked for in a picture.
_SPREAD = 24  # Views tried first, spread over the capture.
_WANTED = 20  # Views about the front of the face that are searched.
_ENOUGH = 3  # Views with a face that landmarks in space are found from, at least.
_MOST_TURNED = 0.9  # `face_yaw` beyond which a view says little about the hidden half of the face.


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


def _across(cameras: Camera, points: Float64) -> tuple[Float64, Float64]:
    """What the viewing rays of one landmark say of its place x: A x = b, [V, 3, 3] and [V, 3].

    The point nearest to some of the rays solves the sum of theirs.
    """
    local = np.column_stack([(points - cameras.center) / cameras.focal, np.ones(len(points))])
    directions = np.einsum("vij,vj->vi", cameras.pose[:, :3, :3], local)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.eye(3) - directions[:, :, None] * directions[:, None]
    return across, np.einsum("vij,vj->vi", across, cameras.position)


def _refine(cameras: Camera, points: Float64, start: Float64,
            scale: float) -> tuple[Float64, Float64]:
    """Gauss-Newton on pixel errors with Cauchy weights; returns the point and its errors [V]."""
    guess = start
    rotation = cameras.pose[:, :3, :3]
    for _ in range(15):
        local = np.einsum("vji,vj->vi", rotation, guess - cameras.position)
        depth = np.maximum(local[:, 2:3], 1e-6)
        error = local[:, :2] / depth * cameras.focal + cameras.center - points
        length = np.linalg.norm(error, axis=1)
        weight = 1.0 / (1.0 + (length / scale) ** 2)
        jacobian = np.zeros((len(points), 2, 3))
        jacobian[:, 0, 0], jacobian[:, 1, 1] = 1.0, 1.0
        jacobian[:, :, 2] = -local[:, :2] / depth
        jacobian *= (cameras.focal / depth)[:, :, None]
        jacobian = np.einsum("vij,vkj->vik", jacobian, rotation)
        normal = np.einsum("v,vij,vik->jk", weight, jacobian, jacobian)
        change = np.linalg.solve(normal + 1e-9 * np.trace(normal) * np.eye(3),
                                 -np.einsum("v,vij,vi->j", weight, jacobian, error))
        guess = guess + change
        if np.linalg.norm(change) < 1e-9:
            break
    pixels, depth = cameras.project(guess[None])
    errors = np.linalg.norm(pixels[:, 0] - points, axis=1)
    errors[depth[:, 0] <= 0] = np.inf
    return guess, errors


def triangulate(cameras: Camera, points: Float64, *, tolerance: float | None = None,
                ) -> tuple[Float64, Float64, Bool]:
    """Triangulate landmarks from several views, robustly.

    Parameters
    ----------
    cameras : V views.
    points : float64 [V, N, 2], pixels (x, y); NaN where a landmark was not seen.
    tolerance : Error in pixels beyond which an observation is an outlier; by default 1 % of the
        picture's larger side, at least 2.

    Returns
    -------
    points3d : float64 [N, 3] in the world; NaN where fewer than two views agree.
    errors : float64 [N], root mean squared error of the inliers in pixels; NaN likewise.
    inliers : bool [V, N].
    """
    if points.ndim != 3 or points.shape[0] != len(cameras) or points.shape[2] != 2:
        raise ValueError(f"points must be [{len(cameras)}, N, 2], not {list(points.shape)}")
    if tolerance is None:
        tolerance = max(2.0, 0.01 * float(max(cameras.width.max(), cameras.height.max())))
    count = points.shape[1]
    found = np.full((count, 3), np.nan)
    errors = np.full(count, np.nan)
    inliers = np.zeros(points.shape[:2], bool)
    for index in range(count):
        views = np.flatnonzero(np.isfinite(points[:, index]).all(axis=1))
        if len(views) < 2:
            continue
        best = _best_start(cameras, points[:, index], views, tolerance)
        point, error = _refine(cameras[views], points[views, index], best, tolerance / 2)
        good = error < tolerance
        if good.sum() < 2:
            continue
        point, error = _refine(cameras[views[good]], points[views[good], index], point,
                               tolerance / 2)
        found[index] = point
        errors[index] = float(np.sqrt(np.mean(error ** 2)))
        inliers[views[good], index] = True
    return found, errors, inliers


def _best_start(cameras: Camera, points: Float64, views: Int64, tolerance: float) -> Float64:
    """The linear solution, from all views or from the pair that most others agree with."""
    across, along = _across(cameras[views], points[views])
    left, right = across.sum(0)[None], along.sum(0)[None]
    if len(views) > 2:
        one, other = np.triu_indices(min(len(views), 12), 1)
        left = np.concatenate([left, across[one] + across[other]])
        right = np.concatenate([right, along[one] + along[other]])
    candidates = np.linalg.solve(left + 1e-12 * np.eye(3), right[..., None])[..., 0]
    pixels, depth = cameras[views].project(candidates)
    error = np.linalg.norm(pixels - points[views][:, None], axis=-1)
    error[depth <= 0] = np.inf
    cost = np.minimum(error, 3 * tolerance).sum(axis=0)
    return np.asarray(candidates[int(cost.argmin())])


def frontal_order(cameras: Camera) -> Int64:
    """Views, int64 [V], sorted by how far they are turned from the portrait frame's front (+z)."""
    away = cameras.position
    yaw = np.abs(np.arctan2(away[:, 0], away[:, 2]))
    pitch = np.abs(np.arctan2(away[:, 1], np.hypot(away[:, 0], away[:, 2])))
    return np.argsort(yaw + 0.5 * pitch, kind="stable")


def _detect(capture: Capture, view: int, thorough: bool) -> Float64 | None:
    """Landmarks of one view; the picture is turned upright, a matted one put on grey."""
    image = np.round(255 * capture.image_float(view, background=0.6)).astype(np.uint8)
    up = capture.cameras.pose[view, :3, :3].T @ np.array([0.0, 1.0, 0.0])
    return detect_landmarks(image, turns=(quarter_turns(up),), thorough=thorough)


def _look_around(capture: Capture, progress: Progress | None) -> dict[int, Float64]:
    """Landmarks by view: views spread over the capture first, then those about the best of them.

    The portrait frame may be a guess by the cameras alone, so where the face looks is learnt from
    the detections: the views in which it shows most frontally, and their neighbours.
    """
    order = frontal_order(capture.cameras)
    detected: dict[int, Float64] = {}
    tried: set[tuple[int, bool]] = set()

    def look(views: Int64, thorough: bool = False) -> None:
        for view in (int(v) for v in views):
            if (view, thorough) in tried or view in detected:
                continue
            tried.add((view, thorough))
            note(progress, f"looking for the face: {len(detected)} views found")
            points = _detect(capture, view, thorough)
            if points is not None:
                detected[view] = points

    look(order[::max(1, len(order) // _SPREAD)])
    if not detected:
        look(order[:_SPREAD])
    # Small faces, sculptures and shaded ones are overlooked at a first look.
    thorough = len(detected) < _ENOUGH
    if thorough:
        look(order[:_SPREAD], thorough)
    if not detected:
        return detected
    away = capture.cameras.position - focus_point(capture.cameras)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    for _ in range(2):
        yaws = np.array([abs(face_yaw(points)) for points in detected.values()])
        best = np.array(list(detected))[np.argsort(yaws, kind="stable")[:3]]
        front = np.median(away[best], axis=0)
        near = np.argsort(-(away @ front), kind="stable")
        look(near[:_WANTED], thorough)
    return detected


def landmarks_of_capture(capture: Capture, progress: Progress | None = None,
                         ) -> tuple[Float64 | None, dict[str, Any]]:
    """Find the face in a capture: landmarks detected in frontal views and triangulated.

    They are float64 [68, 3] in the world, or None if fewer than three views show a face; figures
    are ``views`` (with a face), ``error_px`` (median), ``outliers`` (share). A few views from all
    around are tried first, then those nearest to where the face shows most frontally.
    Points of the jaw (0-16), which detectors let slide along the outline of a turned face, are
    taken from views that show the face nearly frontally.
    """
    detected = _look_around(capture, progress)
    detected = {view: points for view, points in detected.items()
                if abs(face_yaw(points)) < _MOST_TURNED}
    if len(detected) < _ENOUGH:
        return None, {"views": len(detected)}
    views = np.array(sorted(detected))
    observed = np.stack([detected[view] for view in views])
    yaws = np.array([abs(face_yaw(points)) for points in observed])
    turned = yaws > max(0.3, float(np.sort(yaws)[min(3, len(yaws) - 1)]))
    jaw = observed[:, :17].copy()
    jaw[turned] = np.nan
    usable = np.concatenate([jaw, observed[:, 17:]], axis=1)
    cameras = capture.cameras[views]
    eye = float(np.median(np.linalg.norm(observed[:, 36] - observed[:, 45], axis=1)))
    found, errors, inliers = triangulate(cameras, usable, tolerance=max(2.0, 0.12 * eye))
    if np.isnan(found[17:]).any():
        return None, {"views": len(views), "error_px": float(np.nanmedian(errors))}
    missing = np.asarray(np.isnan(found[:17]).any(axis=1))
    if missing.any():
        found = _fill_jaw(found, missing)
    seen = np.isfinite(usable).all(-1)
    return found, {"views": len(views), "error_px": float(np.nanmedian(errors)),
                   "outliers": float(1.0 - inliers[seen].mean())}


def _fill_jaw(points: Float64, missing: Bool) -> Float64:
    """Missing jaw points from their mirror images in the face's plane of symmetry."""
    left, right = points[[36, 39]].mean(0), points[[42, 45]].mean(0)
    normal = (right - left) / np.linalg.norm(right - left)
    middle = points[[27, 28, 29, 30, 33, 51, 57]].mean(0)
    filled = points.copy()
    for index in np.flatnonzero(missing):
        mirror = points[16 - index]
        if np.isfinite(mirror).all():
            filled[index] = mirror - 2 * ((mirror - middle) @ normal) * normal
    return filled
