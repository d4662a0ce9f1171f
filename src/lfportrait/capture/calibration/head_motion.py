"""Correct the cameras for a head that moved between the photos.

Structure from motion places photos by what most features are of, and that is the room, which never
moves; of a head that nodded by two degrees meanwhile all cameras are two degrees off.

Features of the person alone show whether that is so. Their matches lie a third of a pixel from
where they should, by the two cameras that explain them best. By the cameras that were found from
the whole photos they lie no farther if the person held still, and several times as far if not. Then
the photos are placed once more, by features of the person alone and with the lenses that the room
gave.

Where the face's landmarks are known, and so where the head is, only features of the head count:
shoulders often stay while it turns. Else the person is taken as rigid.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from ...arrays import Float32, Float64, UInt8, box_about
from ...simd.threads import side_by_side
from ...temporary import temporary_folder
from ..camera import Camera, pose_corrections, without_drift
from ..capture import Capture
from .database import Scene, colmap, room_for
from .features import Features, enough, likely_pairs, likeness, match_features, sift_features
from .mapping import place_photos

_FEATURES, _CONTRAST = 2048, 0.006
"""Features of a head at most, and contrast of the weakest: low, as skin has few."""
_RIM = 0.01
"""Part of a photo's longer side within a matte's edge where features are of what is behind, too."""
_RADIUS = 0.8  # Of a ball about the head's middle that holds crown and chin, and no shoulders.
_MOVED, _PIXELS = 2.0, 0.5
"""A head has moved whose matches lie this many times as far off as by their own two cameras, and
this many pixels. Heads and a bust that are still: 0.9 times, 0.2 to 0.3 pixels. A head that moves
by 0.3, 0.8, 1.7, 3.5 degrees (median): 1.7, 4, 7, 10 times, 0.5, 1.1, 2.2, 2.9 pixels; cameras
that follow it are off by 0.2 to 0.35 degrees in all four."""
_SAMPLE, _CLEARLY = 20, 0.8
"""Photos that are asked first, spread over the capture, and the part of the bounds below which they
say that the head held still: then the others need not be asked."""
_ENOUGH, _NEARER = 0.8, 0.5
"""Part of the photos that the head alone must place, and what may be left of its matches' distance
then."""
_MODEL = "SIMPLE_PINHOLE"


@dataclass(frozen=True)
class HeadMotion:
    """What was found of the head's motion."""

    moved: bool  # Whether the head moved against the room.
    # Median distance of the head's matches from where the room's cameras put them; NaN if there are
    # too few matches.
    pixels: float = np.nan
    own: float = np.nan  # The same by each pair's own two cameras.
    # The same by the cameras that follow the head; NaN where it is not followed.
    after: float = np.nan
    # Median angle between the cameras that follow the head and those of the room; 0 where it is not
    # followed.
    degrees: float = 0.0
    # Numbers of the photos whose cameras follow the head; empty if none do.
    followed: list[int] = field(default_factory=list)


def _head(capture: Capture, view: int, matte: Float32) -> UInt8:
    """Where a photo shows the head, 1 and 0; the whole person where the face is not known."""
    inside = matte > 0.5
    height, width = matte.shape
    if capture.landmarks is not None:
        camera = capture.cameras[view]
        pixels, depth = camera.project(np.zeros((1, 3)))
        (x, y), radius = pixels[0, 0], _RADIUS * camera.focal[0, 0] / max(depth[0, 0], 1e-6)
        rows, columns = np.ogrid[:height, :width]
        inside &= np.hypot(rows + 0.5 - y, columns + 0.5 - x) < radius
    rim = 2 * round(_RIM * max(height, width)) + 1
    return np.asarray(cv2.erode(inside.astype(np.uint8), np.ones((rim, rim), np.uint8)), np.uint8)


def _seen(capture: Capture, view: int, matte: Float32) -> Features:
    """Features of the head, as of a camera with square pixels and its axis in the middle."""
    image = capture.images[view]
    height, width = image.shape[:2]
    inside = _head(capture, view, matte)
    part = box_about(inside, 16)
    if part is None:
        return sift_features(np.zeros((8, 8, 3), np.uint8), 1)
    mask = np.asarray(255 * inside[part], np.uint8)
    found = sift_features(image[part], _FEATURES, mask, _CONTRAST)
    if not len(found.places):
        return found
    focal, corner = capture.cameras.focal[view], np.array([part[1].start, part[0].start])
    places = ((found.places + corner - capture.cameras.center[view])
              * (1.0, focal[0] / focal[1]) + (width / 2, height / 2))
    return replace(found, places=places.astype(np.float32))


def _scene(capture: Capture, mattes: list[Float32], work: Path, seed: int) -> Scene:
    features = side_by_side(lambda view: _seen(capture, view, mattes[view]), range(len(mattes)))
    pairs = likely_pairs(likeness(features))
    matches = dict(zip(pairs, side_by_side(
        lambda pair: match_features(*(features[view].descriptors for view in pair)), pairs, 4)))
    cameras = capture.cameras
    return Scene([(int(w), int(h)) for w, h in zip(cameras.width, cameras.height)],
                 [float(focal) for focal in cameras.focal[:, 0]], features,
                 enough(matches), work, seed)


def _lenses(scene: Scene) -> list[int]:
    """Number of each photo's lens."""
    kinds = list(zip(scene.sizes, scene.focals))
    return [list(dict.fromkeys(kinds)).index(kind) for kind in kinds]


def epipolar_distance(essential: Float64, one: Float64, other: Float64) -> Float64:
    """First-order distance of matches from an epipolar geometry (Sampson 1982), float64 [N].

    ``essential`` is E of other^T E one = 0, the places are float64 [N, 2] in the image planes at
    distance 1; the distance is in the same unit.
    """
    one, other = (np.column_stack([part, np.ones(len(part))]) for part in (one, other))
    ahead, back = one @ essential.T, other @ essential
    slope = (ahead[:, :2] ** 2).sum(1) + (back[:, :2] ** 2).sum(1)
    return np.asarray(np.abs((other * ahead).sum(1)) / np.sqrt(np.maximum(slope, 1e-30)))


def _essential(cameras: Camera, one: int, other: int) -> Float64:
    """E of the cameras' places, [3, 3]."""
    between = np.linalg.inv(cameras.pose[other]) @ cameras.pose[one]
    x, y, z = between[:3, 3]
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ between[:3, :3]


def _distances(scene: Scene, cameras: Camera, lenses: list[int]) -> Float64:
    """Median distances of each pair's matches by the cameras and by its own two, [P, 2] pixels."""
    found = []
    for (i, j), (matches, own) in scene.checked(lenses, _MODEL).items():
        if not own.any():
            continue
        planes = [(scene.features[k].places[matches[:, side], :2] - np.array(scene.sizes[k]) / 2)
                  / cameras.focal[k, 0] for side, k in enumerate((i, j))]
        unit = (cameras.focal[i, 0] + cameras.focal[j, 0]) / 2
        found.append([unit * np.median(epipolar_distance(essential, *planes))
                      for essential in (_essential(cameras, i, j), own)])
    return np.array(found).reshape(-1, 2)


def _placed_by_head(scene: Scene, lenses: list[int], cameras: Camera, lens_known: bool = True,
                    ) -> tuple[list[int], Camera]:
    """The photos that features of the head place, and their cameras laid on the given ones."""
    placing = place_photos(scene, lenses, _MODEL, lambda: None, lambda line: None,
                           lens_known=lens_known)
    if len(placing.photos) < 3:
        return [], cameras[[]]
    pose = np.tile(np.eye(4), (len(placing.photos), 1, 1))
    given = cameras[placing.photos]
    focal = given.focal.copy()
    for row, photo in enumerate(placing.photos):
        image = placing.model.images[photo + 1]
        pose[row, :3] = image.cam_from_world().inverse().matrix()
        # The scene's pixels are square, as wide as the photo's.
        focal[row] *= placing.model.cameras[image.camera_id].params[0] / focal[row, 0]
    return placing.photos, without_drift(replace(given, pose=pose, focal=focal), given)


def _placed_part(capture: Capture, placed: list[int], cameras: Camera) -> Capture:
    """The photos of a capture that are placed, with their cameras."""
    alphas = None if capture.alphas is None else [capture.alphas[view] for view in placed]
    depths = None if capture.depths is None else [capture.depths[view] for view in placed]
    return replace(capture, cameras=cameras, images=[capture.images[view] for view in placed],
                   alphas=alphas, depths=depths, names=[capture.names[view] for view in placed],
                   held_out=capture.held_out[placed])


def place_by_head(capture: Capture, mattes: list[Float32], seed: int = 0) -> Capture | None:
    """Cameras by features of the head alone, of photos whose backgrounds are of many places.

    The photos have rough cameras in the portrait frame, landmarks, and rough mattes of the person,
    float32 [H, W] in [0, 1]. Those that are placed come back, with cameras that are laid on the
    rough ones and have focal lengths of their own; None where fewer than three are.
    """
    colmap().set_random_seed(seed)
    with temporary_folder(room_for(len(capture))) as work:
        scene = _scene(capture, mattes, work, seed)
        placed, cameras = _placed_by_head(scene, _lenses(scene), capture.cameras,
                                          lens_known=False)
    return _placed_part(capture, placed, cameras) if placed else None


def _clearly_still(capture: Capture, mattes: list[Float32], seed: int) -> HeadMotion | None:
    """That the head held still, where some of the photos show it beyond doubt; else None."""
    if len(capture) < 2 * _SAMPLE:
        return None
    some = np.linspace(0, len(capture) - 1, _SAMPLE).astype(int).tolist()
    part = _placed_part(capture, some, capture.cameras[some])
    with temporary_folder(room_for(len(part))) as work:
        scene = _scene(part, [mattes[view] for view in some], work, seed)
        apart = _distances(scene, part.cameras, _lenses(scene))
    if len(apart) < len(part):
        return None
    pixels, own = (float(value) for value in np.median(apart, axis=0))
    if pixels < _CLEARLY * _PIXELS or pixels < _CLEARLY * _MOVED * own:
        return HeadMotion(False, pixels, own)
    return None


def follow_head(capture: Capture, mattes: list[Float32], seed: int = 0,
                tell: Callable[[str], None] | None = None) -> tuple[Capture, HeadMotion]:
    """Let the cameras follow the head where it moved against the room.

    The photos are undistorted, with cameras estimated from the room, in the portrait frame, and
    rough mattes of the person, float32 [H, W] in [0, 1]. Those that the head places come back, with
    cameras that follow it, together as near to the given ones as can be, and ``tell`` is called
    with a line; or the same capture where it held still, or can't be followed.
    """
    if (still := _clearly_still(capture, mattes, seed)) is not None:
        return capture, still
    with temporary_folder(room_for(len(capture))) as work:
        scene = _scene(capture, mattes, work, seed)
        lenses = _lenses(scene)
        apart = _distances(scene, capture.cameras, lenses)
        if len(apart) < len(capture):
            return capture, HeadMotion(False)
        pixels, own = (float(value) for value in np.median(apart, axis=0))
        if pixels < _PIXELS or pixels < _MOVED * own:
            return capture, HeadMotion(False, pixels, own)
        placed, cameras = _placed_by_head(scene, lenses, capture.cameras)
        pose = capture.cameras.pose.copy()
        pose[placed] = cameras.pose
        after = float(np.median(_distances(scene, replace(capture.cameras, pose=pose),
                                           lenses)[:, 0]))
    tell = tell or (lambda line: None)
    if len(placed) < _ENOUGH * len(capture) or after > _NEARER * pixels:
        tell(f"the head moved against the room ({pixels:.1f} pixels), but too few of its features "
             "were found to correct the cameras: the portrait may be blurred")
        return capture, HeadMotion(True, pixels, own)
    degrees = float(np.median(pose_corrections(capture.cameras[placed], cameras)[0]))
    tell(f"the head moved against the room ({pixels:.1f} pixels, {degrees:.1f} degrees): the "
         f"cameras of {len(placed)} of {len(capture)} photos are corrected")
    return (_placed_part(capture, placed, cameras),
            HeadMotion(True, pixels, own, after, degrees, placed))
