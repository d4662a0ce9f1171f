"""Soft labels of the regions of a portrait, diffused between neighbours.

The labels are compared during the synthesis: a chunk of hair does not land on skin, nor lips on a
cheek. Features are polygons through the landmarks, drawn small and blurred; hair and person are the
masks of the segmentation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from ...labels import PICTURE_LABELS
from ..kernels.labels import soft_labels
from .face_frame import FaceFrame
from .filters import broad_blur, gaussian_blur, shrunk

__all__ = ["PICTURE_LABELS", "missing_labels", "polygon", "region_labels", "soft_face",
           "without_hair"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

OUTLINE_BLUR = 0.02
"""Sigma of the blur of the person's outline, over the distance of brows and chin."""



def region_labels(person: Float32, hair: Float32 | None, landmarks: Float64, frame: FaceFrame,
                  like: frozenset[str] = frozenset()) -> NDArray[np.uint8]:
    """Soft labels of a picture.

    Parameters
    ----------
    person, hair
        float32 [H, W]; no hair if None.
    landmarks, frame
        [68, 2] and the face's frame.
    like
        Labels (``hair``, ``body``) to give to those that stand in for them, where the exemplar has
        none (`missing_labels`): hair to the skin, the body to the background.

    Returns
    -------
    uint8 [H, W, len(PICTURE_LABELS)], 255 = wholly inside; about 255 in sum.
    """
    blur = 0.03 * frame.height
    factor = 2 * min(4, max(1, int(blur / 4))) if blur >= 2 else 1
    planes = _feature_planes(person.shape, landmarks, factor, blur / factor)
    if hair is None:
        hair = np.zeros(person.shape, np.float32)
    out = np.empty((*person.shape, 2), np.int32)
    # Paint of the outline lies outside the mask too: labels that fall off gently hold it there.
    soft = broad_blur(np.ascontiguousarray(person, np.float32), OUTLINE_BLUR * frame.height)
    soft_labels(soft, np.ascontiguousarray(hair, np.float32),
                planes, factor, "hair" in like, "body" in like, out)
    return out.view(np.uint8)


def soft_face(shape: tuple[int, ...], landmarks: Float64, above: float = 0.1) -> NDArray[np.uint8]:
    """The face between jaw and brows with soft edges, uint8 [H, W].

    It ends ``above`` of its height above the brows.
    """
    frame = FaceFrame.of(landmarks)
    brows = landmarks[17:27][::-1] - above * frame.height * frame.down
    drawn = polygon(shape, np.concatenate([landmarks[:17], brows]))
    return np.asarray(broad_blur(drawn, 0.05 * frame.height) * 255 + np.float32(0.5), np.uint8)


def missing_labels(style: NDArray[np.uint8]) -> frozenset[str]:
    """Labels among hair and body that an exemplar [h, w, len(PICTURE_LABELS)] does not show.

    Hair of an exemplar whose hair can't be separated from its skin (a statue) is skin, a body that
    it does not show is background.
    """
    return frozenset(name for name in ("hair", "body")
                     if style[..., PICTURE_LABELS.index(name)].mean() < 0.5)


def without_hair(labels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Labels [h, w, len(PICTURE_LABELS)] whose hair is skin, for a target that shows no hair."""
    out = labels.copy()
    hair, skin = PICTURE_LABELS.index("hair"), PICTURE_LABELS.index("skin")
    out[..., skin] = np.minimum(out[..., skin].astype(np.int64) + out[..., hair], 255)
    out[..., hair] = 0
    return out


def _feature_planes(shape: tuple[int, ...], landmarks: Float64, factor: int,
                    blur: float) -> Float32:
    """Brows, eyes, nose, lips, and what is below the jaw, blurred block means [5, h, w]."""
    # Drawn at twice the resolution of the blocks: their edges are a quarter grey at the least.
    fine = max(1, factor // 2)
    ratio = factor // fine
    rows, columns = -(-shape[0] // factor) * ratio, -(-shape[1] // factor) * ratio
    points = landmarks / fine
    frame = FaceFrame.of(points)
    size = (rows, columns)
    drawn = [
        np.maximum(polygon(size, _thicken(points[17:22], frame)),
                   polygon(size, _thicken(points[22:27], frame))),
        np.maximum(polygon(size, points[36:42]), polygon(size, points[42:48])),
        polygon(size, np.concatenate([points[27:28], points[31:36]])),
        polygon(size, points[48:60]),
        _below_jaw(size, points, frame)]
    return np.stack([gaussian_blur(shrunk(plane, ratio), blur * (1.5 if n == 4 else 1.0))
                     for n, plane in enumerate(drawn)])


def polygon(shape: tuple[int, ...], points: NDArray[np.floating]) -> Float32:
    """Filled polygon, float32 [H, W]."""
    picture = Image.new("L", (shape[1], shape[0]))
    if np.isfinite(points).all():
        ImageDraw.Draw(picture).polygon([(float(x), float(y)) for x, y in points - 0.5], fill=1)
    return np.asarray(picture, np.float32)


def _thicken(brow: Float64, frame: FaceFrame) -> Float64:
    """A brow's line of landmarks as a strip."""
    half = 0.035 * frame.height * frame.down
    return np.concatenate([brow - half, (brow + 1.6 * half)[::-1]])


def _below_jaw(shape: tuple[int, ...], points: Float64, frame: FaceFrame) -> Float32:
    """Everything below the jaw line: neck, shoulders and whatever is beside them."""
    jaw = points[3:14]
    far = 6.0 * max(shape)
    left, right = jaw[0], jaw[-1]
    border = [left - far * frame.right, left, *jaw[1:-1], right, right + far * frame.right,
              right + far * frame.right + far * frame.down,
              left - far * frame.right + far * frame.down]
    return polygon(shape, np.array(border))
