"""Cameras from photos alone: structure from motion, by COLMAP (through pycolmap).

SIFT features in every photo, matches between the pairs that look alike, then the photos are placed:
by COLMAP's incremental mapping, and by other ways where that leaves photos out
(`calibration.mapping`). A last bundle adjustment with a robust loss also decides how many lens
terms the photos determine. Photos of one lens share one camera (`calibration.database`), whose
focal length starts from what it noted in the file (`photos`).

COLMAP works in a temporary folder. Images are numbered in the order of their names, the random
seeds are fixed and the mapper runs on one thread: the same photos give the same cameras.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import tyro

from ..arrays import Float64, Int64
from ..errors import UserError
from ..progress import Progress, note, say
from ..simd.threads import side_by_side
from ..temporary import temporary_folder
from .calibration import features as sift
from .calibration.database import Scene, colmap, lens_groups, room_for, sensor_turns
from .calibration.features import Features, Matches
from .calibration.mapping import adjust, place_photos, starting_model
from .camera import portrait_frame_from_cameras
from .capture import Capture
from .formats.assembly import assemble, pinholes, turned_upright
from .formats.colmap import lens_of
from .lenses import Lens
from .photos import Photo, blurred
from .video import read_source

_ADVICE = ("take 20 to 100 photos of a person who holds still, with small steps between them "
           "(each part of the scene in at least three photos), in focus")

_MOST_AGAIN = 800
"""Pairs of photos that are compared once more, in full, where photos are left out."""
ALL_PAIRS = 200
"""Of up to so many photos all pairs whose largest features match are compared, of more only
neighbours in the order of their names: pairs grow with the square of the photos."""
_DENSE = 1.2  # Degrees between neighbours up to which photos between them show nothing more.


class PhotosError(UserError):
    """Photos that can't be placed; ``marks`` is what is wrong, by the photo's name."""

    def __init__(self, message: str, marks: dict[str, str]) -> None:
        super().__init__(message)
        self.marks = marks


@dataclass(frozen=True)
class CalibrateConfig:
    """Parameters of calibration."""

    features: int = 4096
    """Maximum number of SIFT features per photo."""
    camera_model: Literal["auto", "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV",
                          "OPENCV_FISHEYE"] = "auto"
    """Camera model; auto: as many distortion terms as the photos can determine."""
    max_side: int = 1600
    """Downscale photos to this many pixels on the longer side; 0 = full size."""
    video_frames: int = 80
    """Number of frames to extract from a video."""
    blur_threshold: float = 0.4
    """Leave out blurred photos: those with less than this share of their neighbours' fine detail in
    any direction, at most a quarter of all; 0 keeps all."""
    every_photo: bool = False
    """Place every photo, also those of a dense sweep that lie between others and show nothing more.
    """
    holdout: int = 8
    """Hold out every Nth photo for testing the reconstruction; 0 = none."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of the random sampling in matching and mapping (on the command line: ``--seed``)."""


def _features(photos: list[Photo], turns: list[int], config: CalibrateConfig,
              progress: Progress | None, contrast: float = 1.0) -> list[Features]:
    """Features of every photo as its sensor saw it; none where the photo is transparent."""
    def of(number: int) -> Features:
        image = np.ascontiguousarray(np.rot90(photos[number].image, turns[number]))
        mask = None
        if image.shape[2] == 4:
            # Not at the rim, where the features would be of the picture behind.
            mask = np.asarray(cv2.erode(image[..., 3], np.ones((5, 5), np.uint8)), np.uint8)
        return sift.sift_features(image, config.features, mask, 0.02 * contrast)

    found: list[Features] = []
    while len(found) < len(photos):
        note(progress, f"features in photo {len(found) + 1} of {len(photos)}")
        found += side_by_side(of, range(len(found), min(len(found) + 8, len(photos))))
    return found


_MATCHED = 4  # Pairs of photos whose features are compared at a time, at most.


def _matches(features: list[Features], pairs: list[tuple[int, int]], progress: Progress | None,
             ) -> dict[tuple[int, int], Matches]:
    """Matches of pairs of photos."""
    def of(pair: tuple[int, int]) -> Matches:
        return sift.match_features(*(features[photo].descriptors for photo in pair))

    found: list[Matches] = []
    while len(found) < len(pairs):
        note(progress, f"comparing photos in full: pair {len(found)} of {len(pairs)}")
        found += side_by_side(of, pairs[len(found):len(found) + 20], _MATCHED)
    return sift.enough(dict(zip(pairs, found)))


@dataclass(frozen=True)
class _Placed:
    """Pose (camera-to-world) and lens of every registered photo by its name, and figures."""

    cameras: dict[str, tuple[Float64, Lens]] = field(default_factory=dict)
    figures: dict[str, Any] = field(default_factory=dict)
    spacing: float = np.inf
    """Degrees between a camera and the next one, seen from the points; the median."""


def _reconstruct(photos: list[Photo], config: CalibrateConfig, progress: Progress | None,
                 work: Path) -> tuple[_Placed, list[str]]:
    """The cameras, and the names of photos that were left out because they add nothing."""
    colmap().set_random_seed(config.seed)
    turns = sensor_turns(photos)
    features = _features(photos, turns, config, progress)
    alike = None
    if len(photos) <= ALL_PAIRS:
        alike = sift.likeness(features, lambda done, of: note(
            progress, f"comparing photos: {done} of {of}"))

    def place(some: Int64) -> _Placed:
        pairs = (sift.neighbouring_pairs(len(some)) if alike is None else
                 sift.likely_pairs(alike[np.ix_(some, some)]))
        folder = work / f"of{len(some)}"
        folder.mkdir()
        return _place([photos[i] for i in some], [turns[i] for i in some],
                      [features[i] for i in some], pairs, config, folder, progress)

    every = np.arange(len(photos))
    some = every if alike is None or config.every_photo else sift.worth_placing(alike)
    # Before a camera that stands still all photos are alike, however far the person turned.
    if len(some) < len(photos) and not sift.camera_stands_still(features):
        placed = place(some)
        if len(placed.cameras) == len(some) and placed.spacing < _DENSE:
            say(progress, f"{len(some)} of {len(photos)} photos are used: the others lie between "
                          "them and show nothing more")
            return placed, [photos[i].name for i in np.setdiff1d(every, some)]
    return place(every), []


def _place(photos: list[Photo], turns: list[int], features: list[Features],
           pairs: list[tuple[int, int]], config: CalibrateConfig, work: Path,
           progress: Progress | None) -> _Placed:
    """Place photos by the matches of these pairs."""
    groups = lens_groups(photos, turns)
    matches = _matches(features, pairs, progress)
    stood_still = sift.camera_stood_still(features, matches)
    if stood_still:
        say(progress, "the camera did not move: features that do not move either are ignored")
        matches = sift.enough(sift.without_still(features, matches))
    shapes = [np.rot90(photo.image[..., 0], turn).shape for photo, turn in zip(photos, turns)]
    scene = Scene([(shape[1], shape[0]) for shape in shapes], [photo.focal for photo in photos],
                  features, matches, work, config.seed)
    registered = [2]

    def report() -> None:
        registered[0] += 1
        note(progress, f"placing photo {min(registered[0], len(photos))} of {len(photos)}")

    note(progress, "checking matches")
    announce = partial(say, progress)
    start = starting_model(config.camera_model)
    placing = place_photos(scene, groups, start, report, announce)
    again = sorted(set(range(len(photos))) - set(placing.photos))
    if again and len(again) * len(photos) <= _MOST_AGAIN:
        say(progress, f"trying {len(again)} unplaced photos again: weaker features, compared with "
                      "all photos")
        closer = _closer(scene, photos, turns, again, config, progress, stood_still)
        registered[0] = 2
        if closer.seen_again(groups, start)[again].any():
            second = place_photos(closer, groups, start, report, announce)
            if len(second.photos) > len(placing.photos):
                placing, scene = second, closer
    if placing.model is None:
        return _Placed()
    note(progress, "refining the cameras")
    model = adjust(placing.model, config.camera_model,
                   lambda rough: scene.triangulated(placing.groups, rough))
    found = {}
    for index in placing.photos:
        image = model.images[index + 1]
        camera = model.cameras[image.camera_id]
        lens = lens_of(camera.model.name, camera.width, camera.height, camera.params)
        pose = np.eye(4)
        pose[:3] = image.cam_from_world().inverse().matrix()
        found[photos[index].name] = turned_upright(pose, lens, turns[index])
    models = {camera.model.name for camera in model.cameras.values()}
    figures = {"points": int(model.num_points3D()),
               "reprojection_error_px": float(model.compute_mean_reprojection_error()),
               "lens_model": " ".join(sorted(models)), "lenses": len(set(groups)),
               "placed": placing.how}
    return _Placed(found, figures, _spacing(model))


def _spacing(model: Any) -> float:
    """Median angle between a camera and the next one, in degrees, seen from among the points."""
    middle = np.median([point.xyz for point in model.points3D.values()], axis=0)
    ways = np.array([image.projection_center() - middle for image in model.images.values()
                     if image.has_pose])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    nearest = np.partition(ways @ ways.T, -2, axis=1)[:, -2]
    return float(np.degrees(np.median(np.arccos(np.clip(nearest, -1.0, 1.0)))))


def _closer(scene: Scene, photos: list[Photo], turns: list[int], again: list[int],
            config: CalibrateConfig, progress: Progress | None, stood_still: bool) -> Scene:
    """The scene with more features in some photos, which are compared with all others in full."""
    features, matches = list(scene.features), dict(scene.matches)
    more = replace(config, features=2 * config.features)
    found = _features([photos[i] for i in again], [turns[i] for i in again], more, progress,
                      0.5)
    for i, own in zip(again, found):
        features[i] = own
    for i in again:
        for j in range(len(photos)):
            if j != i and (j not in again or j > i):
                pair = min(i, j), max(i, j)
                matches[pair] = sift.match_features(*(features[k].descriptors for k in pair))
    if stood_still:
        matches = sift.without_still(features, matches)
    work = scene.work / "closer"
    work.mkdir()
    return Scene(scene.sizes, scene.focals, features, sift.enough(matches), work, scene.seed)


def calibrate(photos: str | Path, config: CalibrateConfig | None = None,
              progress: Progress | None = None, *, read: list[Photo] | None = None) -> Capture:
    """Find the cameras of photos or of a video.

    Parameters
    ----------
    photos : Folder of photos, or a video file.
    config : Parameters.
    progress : Progress line.
    read : The pictures, where they were read already. The list is emptied: they are large.

    Returns
    -------
    capture : The photos that could be placed, undistorted, in the portrait frame guessed from
        the cameras (`portrait_frame_from_cameras`; `portrait_frame_from_landmarks` is better
        once the face is known). ``capture.figures``: ``photos``, ``registered``, ``left_out``
        (could not be placed), ``blurred`` and ``spare`` (not tried; these lie between others of
        a dense sweep), ``points``, ``reprojection_error_px``, ``focal_px``.

    Raises
    ------
    UserError : If there are fewer than 3 usable photos, or they do not overlap.
    """
    config = config or CalibrateConfig()
    path = Path(photos)
    note(progress, "reading photos")
    if read is None:
        loaded = read_source(path, config.max_side, config.video_frames)
    else:
        loaded = list(read)
        read.clear()
    count = len(loaded)
    soft = [loaded[index].name for index in blurred([photo.image for photo in loaded],
                                                    config.blur_threshold)]
    if soft:
        warnings.warn(f"{len(soft)} of {count} photos are blurred and are left out: "
                      f"{_listed(soft)} (--blur-threshold 0 keeps them)", stacklevel=2)
        loaded = [photo for photo in loaded if photo.name not in soft]
    if len(loaded) < 3:
        raise UserError(f"{path} has only {len(loaded)} usable "
                        f"{'photo' if len(loaded) == 1 else 'photos'}; {_ADVICE}")
    with temporary_folder(room_for(len(loaded))) as work:
        placed, spare = _reconstruct(loaded, config, progress, work)
    found, figures = placed.cameras, placed.figures
    loaded = [photo for photo in loaded if photo.name not in spare]
    left_out = [photo.name for photo in loaded if photo.name not in found]
    if len(found) < max(3, 0.4 * len(loaded)):
        how_many = f"only {len(found)}" if found else "none"
        marks = dict.fromkeys(soft, "blurred") | dict.fromkeys(left_out, "not placed")
        raise PhotosError(f"the photos in {path} do not overlap enough: {how_many} of "
                          f"{len(loaded)} could be placed together; {_ADVICE}", marks)
    if left_out:
        warnings.warn(f"{len(left_out)} of {len(loaded)} photos could not be placed and are left "
                      f"out: {_listed(left_out)}", stacklevel=2)
    kept = [photo for photo in loaded if photo.name in found]
    lenses = [found[photo.name][1] for photo in kept]
    poses = np.array([found[photo.name][0] for photo in kept])
    similarity = portrait_frame_from_cameras(pinholes(poses, lenses))
    poses = similarity @ poses
    poses[:, :3, :3] /= np.cbrt(np.linalg.det(similarity[:3, :3]))
    capture = Capture(**assemble(poses, lenses, [photo.image for photo in kept],
                                [photo.name for photo in kept], None, config.holdout,
                                depths=[photo.depth for photo in kept])._asdict())
    figures.update(photos=count, registered=len(kept), left_out=left_out, blurred=soft, spare=spare,
                   focal_px=float(np.median([lens.focal[0] for lens in lenses])))
    return replace(capture, frame=capture.frame @ similarity, figures=figures)


def _listed(names: list[str]) -> str:
    """The first few names, for a message of one line."""
    return f"{', '.join(names[:5])}{', ...' if len(names) > 5 else ''}"
