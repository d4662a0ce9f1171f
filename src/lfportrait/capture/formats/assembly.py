"""Last step of every reader: undistorted photos with cameras in the portrait frame.

A reader finds a `Shot` for each photo in its own format: file, pose, lens; all of them are a
`DataSet`, of which no picture is read yet. `read_shots` reads the pictures, turns them upright and
gives them their masks; `assemble` takes the distortion out and makes `Views` of them, which are the
first fields of a `Capture` in their order.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from ...media.depth import DepthMap, read_depth
from ...media.folders import Finder
from ...media.masks import mask_places
from ...media.pictures import read_images
from ..camera import Camera
from ..depths import some_depth, straightened
from ..distortion import Lens, undistort
from ..frame import looks_normalised, portrait_frame_from_cameras
from .orientation import calibrated_turns, mask_for, noted_turns, turned_upright, turns_by_up

__all__ = ["DataSet", "Shot", "Views", "assemble", "held_out_views", "mask_of", "read_shots"]


@dataclass(frozen=True)
class Shot:
    """One calibrated photo as a program's files have it.

    Attributes
    ----------
    path
        The picture's file.
    name
        Its name in the capture.
    pose
        float64 [4, 4], camera-to-world, OpenCV axes; a common scale is allowed.
    lens
        Makes the lens of the picture as it was calibrated from its width and height in pixels.
    size
        Width and height of the pixels that were calibrated, where the program notes them.
    masks
        Folders where the picture's mask may lie; the first becomes its alpha (white is kept).
    mask_name
        The picture's name in these folders; that of its file where empty.
    mask
        The mask's file, where the data set names it; it goes before `masks`.
    test
        Whether it is held out, where the data set says so.
    up
        float64 [3], what is up in the source's world, for photos that lie on their sides without a
        note; None where that is not known.
    """

    path: Path
    name: str
    pose: NDArray[np.float64]
    lens: Callable[[int, int], Lens]
    size: tuple[int, int] | None = None
    masks: tuple[Path, ...] = ()
    mask_name: str = ""
    mask: Path | None = None
    test: bool | None = None
    up: NDArray[np.float64] | None = None


class DataSet(NamedTuple):
    """What a reader finds before a picture is read.

    Attributes
    ----------
    format
        The program or format, for people.
    shots
        In the order of the views.
    source
        The file or folder that lists them, for messages.
    box
        As in `assemble`.
    """

    format: str
    shots: list[Shot]
    source: Path
    box: NDArray[np.float64] | None = None


class Views(NamedTuple):
    """Calibrated photos of a reader: the fields of a `Capture`, most without data of the head.

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
    landmarks
        float64 [68, 3] in the portrait frame (NaN = unknown), where the format keeps them.
    figures
        What calibration measured, where the format keeps it.
    depths
        What the photos' files keep of depth, one or None a view; None where no file has any.
    """

    cameras: Camera
    images: Sequence[NDArray[np.uint8]]
    alphas: Sequence[NDArray[np.uint8]] | None
    names: list[str]
    held_out: NDArray[np.bool_]
    frame: NDArray[np.float64]
    landmarks: NDArray[np.float64] | None = None
    figures: dict[str, Any] | None = None
    depths: Sequence[DepthMap | None] | None = None


def held_out_views(count: int, holdout: int) -> NDArray[np.bool_]:
    """Which views are held out, bool [V]: every ``holdout``-th; none if there are too few."""
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
        raise UserError(f"the camera of {name} is invalid: focal length "
                        f"{lens.focal[0]:g} x {lens.focal[1]:g} pixels, centre "
                        f"{lens.center[0]:g}, {lens.center[1]:g}")


def assemble(poses: NDArray[np.float64], lenses: list[Lens],
             pictures: Iterable[NDArray[np.uint8]], names: list[str],
             held_out: NDArray[np.bool_] | None, holdout: int,
             box: NDArray[np.float64] | None = None,
             depths: Sequence[DepthMap | None] | None = None) -> Views:
    """Views in the portrait frame from poses, lenses and photos.

    Photos are undistorted; where the lens leaves corners uncovered they are transparent only if the
    photo had an alpha channel. An alpha channel is a photo's matte (opaque is the person) where all
    photos have one and any of them is transparent anywhere: screenshots and many programs write
    channels that are opaque throughout. A data set that is normalised already keeps its frame.

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
    depths
        One or None a view, upright; straightened as the photos are.

    Raises
    ------
    UserError
        If a pose or a lens makes no sense.
    """
    poses = _rigid(poses, names)
    images: list[NDArray[np.uint8]] = []
    alphas: list[NDArray[np.uint8]] = []
    transparent = 0
    for picture, lens, name in zip(pictures, lenses, names):
        _check(lens, name)
        flat, inside = undistort(picture, lens)
        images.append(np.ascontiguousarray(flat[..., :3]))
        if picture.shape[2] == 4:
            transparent += bool((picture[..., 3] < 255).any())
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
    if transparent and len(alphas) < len(images):
        warnings.warn(f"{len(alphas)} of {len(images)} photos have an alpha channel; it is left "
                      "out, because all photos need one", stacklevel=2)
    matted = bool(transparent) and len(alphas) == len(images)
    flat_depths = some_depth([None if depth is None else straightened(depth, lens)
                              for depth, lens in zip(depths or (), lenses)])
    return Views(cameras, images, alphas if matted else None, names, held_out, frame,
                 depths=flat_depths)


def read_shots(found: DataSet, holdout: int) -> Views:
    """Views of a program's shots: pictures are read, turned upright and given their masks.

    A picture that can't be read is left out with a warning.

    Parameters
    ----------
    found
        Its shots.
    holdout
        As in `assemble`; every ``holdout``-th view is held out unless all shots say whether they
        are.

    Raises
    ------
    UserError
        If no picture can be read, a picture and its camera are of different shapes, or a pose or
        lens makes no sense.
    """
    shots, source = found.shots, found.source
    poses, lenses, pictures, depths, kept = [], [], [], [], []
    finder = Finder()
    for shot, picture in zip(shots, read_images(shot.path for shot in shots)):
        if isinstance(picture, UserError):
            warnings.warn(f"{picture}; left out", stacklevel=3)
            continue
        noted = noted_turns(shot.path)
        mask = None if picture.shape[2] == 4 else mask_of(shot, finder)
        if mask is not None:
            picture = np.dstack([picture, mask_for(picture, mask, noted)])
        pose, lens, picture, turns = _upright(shot, picture, noted)
        depth = read_depth(shot.path)
        depths.append(None if depth is None else depth.turned(-turns))
        poses.append(pose)
        lenses.append(lens)
        pictures.append(picture)
        kept.append(shot)
    if not kept:
        raise UserError(f"none of the photos named in {source} can be read")
    known = [shot.test for shot in kept if shot.test is not None]
    return assemble(np.array(poses), lenses, pictures, [shot.name for shot in kept],
                    np.array(known) if len(known) == len(kept) else None, holdout, found.box,
                    depths)


def mask_of(shot: Shot, finder: Finder) -> Path | None:
    """The file of a shot's mask: the one that is named for it, or the first in `Shot.masks`."""
    if shot.mask:
        found = finder.find(shot.mask.parent, shot.mask.name)
        if found is not None:
            return found
    return mask_places(finder, shot.masks, shot.mask_name or shot.path.name)


def _upright(shot: Shot, picture: NDArray[np.uint8], noted: int,
             ) -> tuple[NDArray[np.float64], Lens, NDArray[np.uint8], int]:
    """Pose, lens and picture of a shot, upright, and how often it was turned for that.

    Clockwise quarter turns of the picture as it was read.
    """
    width, height = picture.shape[1], picture.shape[0]
    turns = calibrated_turns((width, height), noted, shot.size, shot.path.name)
    try:
        lens = shot.lens(*((height, width) if turns % 2 else (width, height)))
    except (TypeError, ValueError) as error:
        raise UserError(f"the camera of {shot.path.name} can't be read: {error}") from error
    pose, lens = turned_upright(shot.pose, lens, turns)
    more = 0
    if shot.up is not None:
        more = turns_by_up(pose, shot.up)
        pose, lens = turned_upright(pose, lens, more)
        picture = np.ascontiguousarray(np.rot90(picture, -more))
    return pose, lens, picture, more
