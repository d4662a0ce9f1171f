"""What every reader of a data set ends with: photos without distortion, in the portrait frame.

A reader finds poses, lenses and pictures in its own format; `assemble` makes `Views` of them, which
are the first fields of a `Capture` in their order.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...errors import UserError
from ...files import read_image
from ..camera import Camera
from ..distortion import Lens, undistort
from ..frame import looks_normalised, portrait_frame_from_cameras

__all__ = ["Views", "assemble", "held_out_views", "with_mask"]


class Views(NamedTuple):
    """Calibrated photos as a reader finds them: `Capture` without what is known of the head.

    Attributes
    ----------
    cameras
        One a view, in the portrait frame.
    images
        uint8 [H, W, 3] a view.
    alphas
        uint8 [H, W] a view, or None where the photos have no mattes.
    names
        File names.
    held_out
        bool [V], views that are tested on.
    frame
        float64 [4, 4], from the source's frame to the portrait frame.
    """

    cameras: Camera
    images: list[NDArray[np.uint8]]
    alphas: list[NDArray[np.uint8]] | None
    names: list[str]
    held_out: NDArray[np.bool_]
    frame: NDArray[np.float64]


def with_mask(picture: NDArray[np.uint8], places: Iterable[Path]) -> NDArray[np.uint8]:
    """The picture with the first mask file that exists as alpha (white is kept).

    A mask of another size, for a reduced picture, is resized; one of another shape is an error.
    """
    if picture.shape[2] == 4:
        return picture
    height, width = picture.shape[:2]
    for place in places:
        if place.is_file():
            mask = read_image(place)[..., :3].max(axis=2)
            if mask.shape != (height, width):
                if abs(mask.shape[0] * width - mask.shape[1] * height) > 2 * max(mask.shape):
                    raise UserError(f"the mask {place} is not of its picture's size")
                mask = np.asarray(Image.fromarray(mask).resize((width, height),
                                                               Image.Resampling.BOX))
            return np.dstack([picture, mask])
    return picture


def held_out_views(count: int, holdout: int) -> NDArray[np.bool_]:
    """Which of so many views are tested on, bool [V]: every ``holdout``-th; none of too few."""
    held_out = np.zeros(count, bool)
    if holdout > 1 and count >= 2 * holdout:
        held_out[holdout // 2::holdout] = True
    return held_out


def _rigid(poses: NDArray[np.float64], names: list[str]) -> NDArray[np.float64]:
    """Poses whose rotations are exact; a common scale in them, as some exporters leave, goes."""
    u, sizes, vt = np.linalg.svd(np.where(np.isfinite(poses), poses, 0.0)[:, :3, :3])
    rotation = u @ vt
    good = (np.isfinite(poses).all((1, 2)) & (sizes[:, 2] > 0.98 * sizes[:, 0])
            & (sizes[:, 2] > 1e-6) & (np.linalg.det(rotation) > 0))
    if not good.all():
        raise UserError(f"the pose of {names[int(np.argmin(good))]} is no rotation with a "
                        "position; are the cameras' axes right?")
    result = np.tile(np.eye(4), (len(poses), 1, 1))
    result[:, :3, :3], result[:, :3, 3] = rotation, poses[:, :3, 3]
    return result


def _check(lens: Lens, name: str) -> None:
    numbers = (*lens.focal, *lens.center, *lens.k, *lens.p, *lens.s)
    if not (np.isfinite(numbers).all() and min(lens.focal) > 0):
        raise UserError(f"the camera of {name} makes no sense: focal length "
                        f"{lens.focal[0]:g} x {lens.focal[1]:g} pixels, centre "
                        f"{lens.center[0]:g}, {lens.center[1]:g}")


def assemble(poses: NDArray[np.float64], lenses: list[Lens],
             pictures: Iterable[NDArray[np.uint8]], names: list[str],
             held_out: NDArray[np.bool_] | None, holdout: int,
             box: NDArray[np.float64] | None = None) -> Views:
    """Views in the portrait frame from poses, lenses and photos.

    Photos are undistorted; where the lens leaves corners uncovered they are transparent only if the
    photo had an alpha channel. A data set that is normalised already keeps its frame.

    Parameters
    ----------
    poses
        float64 [V, 4, 4], camera-to-world, OpenCV axes, in the source's world.
    lenses, pictures, names
        One a view; pictures uint8 [H, W, 3 or 4].
    held_out
        bool [V], or None: every ``holdout``-th view is held out.
    holdout
        See ``held_out``; 0 holds out none.
    box
        float64 [2, 3], lowest and highest corner of the subject in the source's world, where known.

    Raises
    ------
    UserError
        If a pose or a lens makes no sense.
    """
    poses = _rigid(poses, names)
    images: list[NDArray[np.uint8]] = []
    alphas: list[NDArray[np.uint8]] = []
    for picture, lens, name in zip(pictures, lenses, names):
        _check(lens, name)
        flat, inside = undistort(picture, lens)
        images.append(np.ascontiguousarray(flat[..., :3]))
        if picture.shape[2] == 4:
            alphas.append(np.ascontiguousarray(flat[..., 3] * inside))
    straight = [lens.pinhole() for lens in lenses]
    cameras = Camera(poses, np.array([lens.focal for lens in straight]),
                     np.array([lens.center for lens in straight]),
                     np.array([lens.width for lens in straight]),
                     np.array([lens.height for lens in straight]))
    frame = np.eye(4)
    if not looks_normalised(cameras):
        frame = portrait_frame_from_cameras(cameras, box)
        cameras = cameras.transformed(frame)
    if held_out is None:
        held_out = held_out_views(len(images), holdout)
    return Views(cameras, images, alphas if len(alphas) == len(images) else None, names, held_out,
                 frame)
