"""What a format of captures is, and the last step of every reader: upright, undistorted photos.

Each format is a subclass of `CaptureFormat`. A reader finds a `Shot` for each photo in its own
format: file, pose, lens; all of them are a `DataSet`, of which no picture is read yet. `read_shots`
reads the pictures, turns them upright and gives them their masks; `assemble` takes the distortion
out and makes `Views` of them, which are the first fields of a `Capture` in their order.

A phone stores what its sensor sees and notes beside it how to turn that (EXIF). Some programs
calibrate the stored pixels, others the upright ones, and few say which. The size that the program
noted decides where a quarter turn changes it; where it can't (square pictures, half turns, no size)
the pixels are taken as stored, as COLMAP, Metashape, Meshroom, nerfstudio and instant-ngp read
them. Whatever was calibrated, pictures are upright from here on: pose and lens turn with them.
"""

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import cv2
import numpy as np
from PIL import Image

from ...arrays import Bool, Float64, UInt8
from ...errors import UserError
from ...media.depth import DepthMap, read_depth
from ...media.folders import Finder
from ...media.pictures import mask_places, open_picture, read_images, read_mask
from ..camera import Camera, looks_normalised, portrait_frame_from_cameras
from ..lenses import Lens, some_depth, straightened, undistort
from ..photos import noted

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""Turns a camera's y and z axes round: from NeRF's to OpenCV's and back."""
# The camera's axes after its picture was turned clockwise by a quarter turn.
_QUARTER = np.array([[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0],
                     [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def same_shape(first: tuple[int, int], second: tuple[int, int]) -> bool:
    """Whether one size is the other, reduced and rounded."""
    return abs(first[0] * second[1] - first[1] * second[0]) <= 2 * max(*first, *second)


def noted_turns(path: Path) -> int:
    """Quarter turns (counter-clockwise) from the upright picture to the stored pixels, 0 to 3."""
    try:
        with open_picture(path) as picture:
            return noted(picture.getexif(), picture.size).turns
    except (OSError, ValueError, SyntaxError):
        return 0


def calibrated_turns(upright: tuple[int, int], turns: int, size: tuple[int, int] | None,
                     name: str) -> int:
    """Quarter turns (counter-clockwise) from the upright picture to the calibrated one, 0 to 3.

    The file notes ``turns`` (`noted_turns`), the program the width and height that it calibrated,
    or None; a picture may be a reduced copy. Raises `UserError` if the picture fits neither way.
    """
    stored = upright[::-1] if turns % 2 else upright
    if size is None or same_shape(size, stored):
        return turns
    if same_shape(size, upright):
        return 0
    raise UserError(f"{name} has {upright[0]} x {upright[1]} pixels, its camera {size[0]} x "
                    f"{size[1]}: it was turned or cropped after it was calibrated; put the photo "
                    "there that the program saw")


def turned_upright(pose: Float64, lens: Lens, turns: int) -> tuple[Float64, Lens]:
    """Pose [4, 4] and lens of a picture after so many clockwise quarter turns."""
    for _ in range(turns % 4):
        pose, lens = pose @ _QUARTER, lens.turned()
    return pose, lens


def turns_by_up(pose: Float64, up: Float64) -> int:
    """Clockwise quarter turns after which the picture's upper edge is nearest to ``up``, 0 to 3."""
    sides = [-pose[:3, 1], -pose[:3, 0], pose[:3, 1], pose[:3, 0]]
    heights = [float(side @ up) for side in sides]
    best = int(np.argmax(heights))
    # A camera that looks straight up or down has no upper edge to speak of.
    return best if heights[best] > 0.5 * float(np.linalg.norm(up)) else 0


def mask_for(picture: UInt8, place: Path, turns: int) -> UInt8:
    """A mask file, white where it is kept, as it lies on an upright picture, uint8 [H, W].

    A mask of another size, for a reduced picture, is resized. One that lies as the stored pixels do
    is turned with them (`noted_turns`). Where sizes and notes leave more than one way, or the photo
    lost its note, that is taken on whose outline the picture changes most. Raises `UserError` if
    the mask is of another shape, or can't be read.
    """
    mask = read_mask(place)
    height, width = picture.shape[:2]

    def fits(way: int) -> bool:
        return same_shape(np.rot90(mask, -way).shape[::-1], (width, height))

    fitting = list(filter(fits, dict.fromkeys((turns, 0)))) or list(filter(fits, (1, 3)))
    if not fitting:
        raise UserError(f"the mask {place} is not of its picture's size")
    turned = [_resized(np.rot90(mask, -way), width, height) for way in fitting]
    if len(turned) == 1:
        return turned[0]
    return max(turned, key=lambda one: _outline_contrast(picture, one))


def _resized(mask: UInt8, width: int, height: int) -> UInt8:
    if mask.shape == (height, width):
        return np.ascontiguousarray(mask)
    picture = Image.fromarray(np.ascontiguousarray(mask))
    return np.asarray(picture.resize((width, height), Image.Resampling.BOX))


def _outline_contrast(picture: UInt8, mask: UInt8) -> float:
    """How much a picture changes on average along a mask's outline."""
    factor = min(1.0, 512 / max(mask.shape))
    grey = cv2.resize(np.ascontiguousarray(picture[..., :3].mean(axis=2).astype(np.float32)), None,
                      fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    small = cv2.resize(mask.astype(np.float32), grey.shape[::-1], interpolation=cv2.INTER_AREA)
    down, across = np.gradient(small)
    outline = np.hypot(down, across)
    if outline.sum() == 0:
        return 0.0
    return float((np.hypot(*np.gradient(np.asarray(grey))) * outline).sum() / outline.sum())


@dataclass(frozen=True)
class Shot:
    """One calibrated photo as a program's files have it."""

    path: Path  # The picture's file.
    name: str  # Its name in the capture.
    pose: Float64  # float64 [4, 4], camera-to-world, OpenCV axes; a common scale is allowed.
    # Makes the lens of the picture as it was calibrated from its width and height in pixels.
    lens: Callable[[int, int], Lens]
    # Width and height of the pixels that were calibrated, where the program notes them.
    size: tuple[int, int] | None = None
    # Folders where the picture's mask may lie; the first becomes its alpha (white is kept).
    masks: tuple[Path, ...] = ()
    mask_name: str = ""  # The picture's name in these folders; that of its file where empty.
    # The mask's file, where the data set names it; it goes before `masks`.
    mask: Path | None = None
    test: bool | None = None  # Whether it is held out, where the data set says so.
    # float64 [3], what is up in the source's world, for photos that lie on their sides without a
    # note; None where that is not known.
    up: Float64 | None = None


class DataSet(NamedTuple):
    """What a reader finds before a picture is read."""

    format: str  # The program or format, for people.
    shots: list[Shot]  # In the order of the views.
    source: Path  # The file or folder that lists them, for messages.
    box: Float64 | None = None  # As in `assemble`.


class Views(NamedTuple):
    """Calibrated photos of a reader: the fields of a `Capture`, most without data of the head."""

    cameras: Camera  # One a view, in the portrait frame.
    images: Sequence[UInt8]  # uint8 [H, W, 3] a view.
    alphas: Sequence[UInt8] | None  # uint8 [H, W] a view, or None where the photos have no mattes.
    names: list[str]  # File names.
    held_out: Bool  # bool [V], views that are tested on.
    frame: Float64  # float64 [4, 4], from the source's frame to the portrait frame.
    # float64 [68, 3] in the portrait frame (NaN = unknown), where the format keeps them.
    landmarks: Float64 | None = None
    figures: dict[str, Any] | None = None  # What calibration measured, where the format keeps it.
    # What the photos' files keep of depth, one or None a view; None where no file has any.
    depths: Sequence[DepthMap | None] | None = None


def held_out_views(count: int, holdout: int) -> Bool:
    """Which views are held out, bool [V]: every ``holdout``-th; none if there are too few."""
    held_out = np.zeros(count, bool)
    if holdout > 1 and count >= 2 * holdout:
        held_out[holdout // 2::holdout] = True
    return held_out


def _rigid(poses: Float64, names: list[str]) -> Float64:
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


def pinholes(poses: Float64, lenses: Sequence[Lens]) -> Camera:
    """Cameras of poses [V, 4, 4] and lenses, whose distortion is left aside."""
    return Camera(poses, np.array([lens.focal for lens in lenses]),
                  np.array([lens.center for lens in lenses]),
                  np.array([lens.width for lens in lenses]),
                  np.array([lens.height for lens in lenses]))


def assemble(poses: Float64, lenses: list[Lens], pictures: Iterable[UInt8], names: list[str],
             held_out: Bool | None, holdout: int, box: Float64 | None = None,
             depths: Sequence[DepthMap | None] | None = None) -> Views:
    """Views in the portrait frame from poses, lenses and photos.

    Photos are undistorted; where the lens leaves corners uncovered they are transparent only if the
    photo had an alpha channel. An alpha channel is a photo's matte (opaque is the person) where all
    photos have one and any of them is transparent anywhere: screenshots and many programs write
    channels that are opaque throughout. A data set that is normalised already keeps its frame.
    Raises `UserError` if a pose or a lens makes no sense.

    Parameters
    ----------
    poses : float64 [V, 4, 4], camera-to-world, OpenCV axes, in the source's world.
    lenses, pictures, names : One a view; pictures uint8 [H, W, 3 or 4].
    held_out : bool [V], or None: every ``holdout``-th view is held out.
    holdout : See ``held_out``; 0 holds out none.
    box : float64 [2, 3], lowest and highest corner of the subject in the source's world, where
        known.
    depths : One or None a view, upright; straightened as the photos are.
    """
    poses = _rigid(poses, names)
    images: list[UInt8] = []
    alphas: list[UInt8] = []
    transparent = 0
    for picture, lens, name in zip(pictures, lenses, names):
        _check(lens, name)
        flat, inside = undistort(picture, lens)
        images.append(np.ascontiguousarray(flat[..., :3]))
        if picture.shape[2] == 4:
            transparent += bool((picture[..., 3] < 255).any())
            alphas.append(np.ascontiguousarray(flat[..., 3] * inside))
    cameras = pinholes(poses, [lens.pinhole() for lens in lenses])
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

    A picture that can't be read is left out with a warning. Raises `UserError` if no picture can be
    read, a picture and its camera are of different shapes, or a pose or lens makes no sense.

    Every ``holdout``-th view is held out unless all shots say whether they are.
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


def _upright(shot: Shot, picture: UInt8, noted: int) -> tuple[Float64, Lens, UInt8, int]:
    """Pose, lens and picture of a shot, upright, and the clockwise quarter turns that this took."""
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


class CaptureFormat(ABC):
    """A format in which programs write photos with their cameras.

    ``name`` is the program or format, ``files`` what it is recognised by, such as
    ``transforms.json``; both for people, and names differ.
    """

    name: ClassVar[str]
    files: ClassVar[str]

    @abstractmethod
    def recognises(self, path: Path) -> bool:
        """Whether a folder or file is of this format; it may as well not be there."""

    @abstractmethod
    def read(self, path: Path, holdout: int) -> DataSet:
        """The shots of a data set that is recognised; no picture is decoded.

        Every ``holdout``-th picture becomes a test view where the format's custom says which; 0
        holds out none. Raises `UserError` if the data set is damaged.
        """

    def load(self, path: Path, holdout: int) -> Views:
        """The views of a data set, with their pictures."""
        return read_shots(self.read(path, holdout), holdout)

    def write(self, capture: Views, path: Path) -> None:
        """Write a capture; it appears under its name when it is whole.

        Raises `UserError` if this format is only read, or ``path`` can't be written.
        """
        raise UserError(f"captures are not written as {self.name}")

    @property
    def writes(self) -> bool:
        """Whether captures can be written so, too."""
        return type(self).write is not CaptureFormat.write

    def check(self) -> None:
        """Complain of a class that can't be used; those of other packages are looked at."""
        for name in ("name", "files"):
            if not isinstance(getattr(self, name, None), str):
                raise TypeError(f"it has no {name}")
