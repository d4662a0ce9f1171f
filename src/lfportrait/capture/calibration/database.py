"""The COLMAP database: photos, shared lenses, features, matches that one geometry explains.

Photos come from one lens if they are of one size and their camera noted the same lens and focal
length; a photo taken upright is the same lens turned. So photos are handed on as the sensor saw
them, and their poses are turned back afterwards.

Which of two photos' matches one geometry of two views explains, `two_views` finds. The estimators
are OpenCV's MAGSAC++ (Barath et al. 2020, "MAGSAC++, a fast, reliable and accurate robust
estimator"), and the decisions between them are COLMAP's (Schoenberger and Frahm 2016,
"Structure-from-motion revisited"): where a homography explains nearly as many matches as the
epipolar geometry, the two photos are of a plane, or from one place, and determine no more. COLMAP's
own estimators find the same matches, in eight times the time.
"""

import functools
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from ...arrays import Array, Bool, Float32, Float64, Int64
from ...simd.threads import side_by_side
from ..photos import Photo
from .features import FEWEST, Features, Matches

_ROUGH = 8.0  # Pixels that a match may lie off a rough geometry: more than it may in the end.
_OFF = 3.0
"""Pixels that a match may lie off its geometry. By 4, as COLMAP has it, MAGSAC++ keeps a tenth more
matches of real photos than COLMAP does, which are the worst ones."""
_CONFIDENCE, _TRIALS = 0.9999, 2000  # Trials are enough for a third of right matches.
_FLAT = 0.8
"""Part of the epipolar geometry's matches which a homography explains if that is all there is."""
_FITS = 0.95  # Part of them which known lenses explain, if they are as noted.
_SHARE = 0.25  # Part of a pair's matches that must be explained.

@functools.cache
def colmap() -> Any:
    """COLMAP, whose log is off; it takes a tenth of a second to load, which few commands need."""
    import pycolmap

    pycolmap.logging.minloglevel = pycolmap.logging.Level.FATAL.value
    return pycolmap


Lens = tuple[float, tuple[int, int]]
"""Focal length in pixels, and size (width, height) of the photo."""


@dataclass(frozen=True)
class TwoViews:
    """The geometry of two views."""

    # COLMAP's name of it: ``CALIBRATED`` (with `essential`), ``UNCALIBRATED`` (with `fundamental`)
    # or ``PLANAR_OR_PANORAMIC`` (with `homography`).
    kind: Literal["CALIBRATED", "UNCALIBRATED", "PLANAR_OR_PANORAMIC"]
    inliers: Bool  # bool [M], the matches that it explains.
    # fundamental, essential, homography: float64 [3, 3] each, by pixels, by image planes at
    # distance 1, and by pixels; zero where it is not known.
    fundamental: Float64
    essential: Float64
    homography: Float64


def _robust(estimate: Any, one: Array, other: Array, *options: Any) -> tuple[Float64, Bool]:
    """A matrix [3, 3] and its inliers [M] by one of OpenCV's estimators, zero where it fails."""
    try:
        matrix, mask = estimate(one, other, *options)
    except cv2.error:  # places that determine nothing
        matrix = mask = None
    if matrix is None or mask is None or matrix.shape != (3, 3):
        return np.zeros((3, 3)), np.zeros(len(one), bool)
    return np.asarray(matrix, np.float64), np.asarray(mask.ravel() > 0)


def two_views(one: Float32, other: Float32, fewest: int,
              lenses: tuple[Lens, Lens] | None = None) -> TwoViews | None:
    """The geometry that explains the matches of two photos, float32 [M, 2] each in pixels, or None.

    It is always the same for the same matches; ``fewest`` of them must be explained. ``lenses`` are
    those of both photos, if these are known.
    """
    # It takes half a millisecond to see that nothing explains most of a pair's matches.
    near = np.flatnonzero(_robust(cv2.findFundamentalMat, one, other, cv2.USAC_FAST, _ROUGH, 0.999,
                                  500)[1])
    if len(near) < fewest:
        return None
    one, other, count = one[near], other[near], len(one)
    zero = np.zeros((3, 3))
    fundamental, explained = _robust(cv2.findFundamentalMat, one, other, cv2.USAC_MAGSAC, _OFF,
                                     _CONFIDENCE, _TRIALS)
    homography, flat = _robust(cv2.findHomography, one, other, cv2.USAC_FAST, _OFF, None, 500,
                               0.999)
    kind: Literal["CALIBRATED", "UNCALIBRATED", "PLANAR_OR_PANORAMIC"] = "UNCALIBRATED"
    inside, essential = explained, zero
    if lenses is not None:
        matrix, known = _by_lenses(one, other, lenses)
        # Lenses that are not as noted explain fewer.
        if known.sum() >= max(fewest, _FITS * explained.sum()):
            kind, inside, essential = "CALIBRATED", known, matrix
    if flat.sum() > _FLAT * inside.sum():
        kind = "PLANAR_OR_PANORAMIC"
        inside = flat if flat.sum() > inside.sum() else inside
    if inside.sum() < max(fewest, _SHARE * count):
        return None
    inliers = np.zeros(count, bool)
    inliers[near[inside]] = True
    return TwoViews(kind, inliers, fundamental, essential,
                    homography if kind == "PLANAR_OR_PANORAMIC" else zero)


def _by_lenses(one: Float32, other: Float32, lenses: tuple[Lens, Lens]) -> tuple[Float64, Bool]:
    """The essential matrix of known lenses, and its inliers."""
    planes = [(places - np.array(size, np.float64) / 2) / focal
              for places, (focal, size) in zip((one, other), lenses)]
    off = 2 * _OFF / (lenses[0][0] + lenses[1][0])
    return _robust(cv2.findEssentialMat, planes[0], planes[1], np.eye(3), cv2.USAC_MAGSAC,
                   _CONFIDENCE, off, _TRIALS)


USUAL_FOCAL = 1.2
"""Focal length over the longer side where nothing is known: 43 mm on film."""


def room_for(photos: int) -> int:
    """Bytes that the databases of so many photos take at the least."""
    return max(2 << 20, photos << 18)


def sensor_turns(photos: Sequence[Photo]) -> list[int]:
    """Quarter turns (counter-clockwise) that bring each photo to how its sensor saw it.

    Known from what the camera noted. A photo that still is as high as others of the same lens are
    wide was turned by some program that did not say so: by a quarter turn then, as good as the
    other way round for a lens that is alike in all directions.
    """
    def shape(photo: Photo) -> tuple[int, ...]:
        return photo.image.shape[:2] if photo.turns % 2 == 0 else photo.image.shape[1::-1]

    lying = {(photo.lens, shape(photo)) for photo in photos if shape(photo)[1] > shape(photo)[0]}
    return [(photo.turns + int((photo.lens, shape(photo)[::-1]) in lying
                               and shape(photo)[0] > shape(photo)[1])) % 4 for photo in photos]


def lens_groups(photos: Sequence[Photo], turns: Sequence[int]) -> list[int]:
    """Number of each photo's lens, counted from 0 in the order in which they appear.

    Photos of the same size and lens (EXIF) have one: nobody zooms while going around a person.
    """
    seen: dict[Any, int] = {}
    groups = []
    for photo, turn in zip(photos, turns):
        height, width = photo.image.shape[:2] if turn % 2 == 0 else photo.image.shape[1::-1]
        key = (width, height, photo.lens)
        groups.append(seen.setdefault(key, len(seen)))
    return groups


@dataclass
class Scene:
    """Photos as COLMAP gets them."""

    sizes: list[tuple[int, int]]  # Width and height of each photo, as the sensor saw it.
    focals: list[float | None]  # Focal length in pixels that the camera noted for each, or None.
    features: list[Features]  # Of each photo, as the sensor saw it.
    matches: dict[tuple[int, int], Matches]  # Checked by nothing yet, by pairs of photos.
    work: Path  # Folder for COLMAP's files.
    seed: int = 0  # Of the random sampling.
    _checked: dict[tuple[int, ...], Path] = field(default_factory=dict)
    _copies: int = 0

    def _focal(self, group: Sequence[int], focal: float | None) -> tuple[float, bool]:
        """Focal length in pixels to start a lens from, and whether its camera noted it."""
        noted = [value for index in group if (value := self.focals[index])]
        if focal is None and noted:
            return float(np.median(noted)), True
        return (focal or USUAL_FOCAL) * max(self.sizes[group[0]]), False

    def _cameras(self, groups: Sequence[int], model: str, focal: float | None) -> list[Any]:
        cameras = []
        for number in range(max(groups) + 1):
            members = [index for index, group in enumerate(groups) if group == number]
            length, noted = self._focal(members, focal)
            camera = colmap().Camera.create_from_model_name(number + 1, model, length,
                                                            *self.sizes[members[0]])
            camera.has_prior_focal_length = noted
            cameras.append(camera)
        return cameras

    def _places(self, pair: tuple[int, int], own: Matches) -> list[Float32]:
        """Where both photos of a pair have its matches, two times float32 [M, 2]."""
        return [np.ascontiguousarray(self.features[number].places[own[:, side], :2])
                for side, number in enumerate(pair)]

    def _check(self, groups: Sequence[int], path: Path, model: str) -> None:
        """Write all to a new database and keep the matches that two cameras can explain."""
        with colmap().Database.open(path) as base:
            rigs = []
            for camera in self._cameras(groups, model, None):
                base.write_camera(camera, True)
                rig = colmap().Rig()
                rig.add_ref_sensor(camera.sensor_id)
                rigs.append(base.write_rig(rig))
            for index, own in enumerate(self.features):
                image = base.read_image(base.write_image(colmap().Image(
                    name=f"{index:05d}", camera_id=groups[index] + 1)))
                frame = colmap().Frame()
                frame.rig_id = rigs[groups[index]]
                frame.add_data_id(image.data_id)
                base.write_frame(frame)
                base.write_keypoints(image.image_id, own.places)
            for (i, j), geometry in self._geometries(groups).items():
                matches, found = self.matches[i, j], colmap().TwoViewGeometry()
                found.config = getattr(colmap().TwoViewGeometryConfiguration, geometry.kind)
                found.F, found.E, found.H = (geometry.fundamental, geometry.essential,
                                             geometry.homography)
                found.inlier_matches = matches[geometry.inliers]
                base.write_matches(i + 1, j + 1, matches)
                base.write_two_view_geometry(i + 1, j + 1, found)

    def _geometries(self, groups: Sequence[int]) -> dict[tuple[int, int], TwoViews]:
        """What explains the matches, by the pairs of photos of which something does."""
        lenses: list[Lens | None] = []
        for number in range(max(groups) + 1):
            members = [index for index, group in enumerate(groups) if group == number]
            focal, noted = self._focal(members, None)
            lenses.append((focal, self.sizes[members[0]]) if noted else None)

        def geometry(item: tuple[tuple[int, int], Matches]) -> TwoViews | None:
            one, other = (lenses[groups[number]] for number in item[0])
            first, second = self._places(*item)
            return two_views(first, second, FEWEST,
                             None if one is None or other is None else (one, other))

        pairs = list(self.matches.items())
        found = side_by_side(geometry, pairs)
        return {pair: own for (pair, _), own in zip(pairs, found) if own is not None}

    def database(self, groups: Sequence[int], model: str, focal: float | None = None) -> Path:
        """A new database with checked matches and lenses to start from.

        ``groups`` has the number of each photo's lens, ``model`` is COLMAP's name of the lens
        model, ``focal`` its focal length over the longer side; None: as noted, or the usual one.
        """
        key = tuple(groups)
        if key not in self._checked:
            path = self.work / f"checked{len(self._checked)}.db"
            self._check(groups, path, model)
            self._checked[key] = path
        self._copies += 1
        copy = self.work / f"database{self._copies}.db"
        shutil.copy(self._checked[key], copy)
        with colmap().Database.open(copy) as base:
            for camera in self._cameras(groups, model, focal):
                base.update_camera(camera)
        return copy

    def steady_options(self) -> Any:
        """Options of COLMAP's incremental mapping with which it does the same every time.

        Its adjustments end where an iteration lessens the errors by no more than a hundred
        thousandth: by COLMAP's own bound, 0, they take all of their iterations.
        """
        options = colmap().IncrementalPipelineOptions()
        for part in (options, options.mapper, options.triangulation):
            part.random_seed = self.seed
        options.num_threads = 1
        options.ba_global_function_tolerance = options.ba_local_function_tolerance = 1e-5
        return options

    def triangulated(self, groups: Sequence[int], model: Any) -> Any:
        """A reconstruction with its cameras, whose points are found once more from all matches.

        Its lenses are of one model; ``groups`` has the number of each photo's.
        """
        options = self.steady_options()
        options.ba_global_max_refinements = 1
        database = self.database(groups, next(iter(model.cameras.values())).model.name)
        folder = database.with_suffix(".points")
        folder.mkdir()
        return colmap().triangulate_points(colmap().Reconstruction(model), database, self.work,
                                           folder, clear_points=True, options=options)

    def seen_again(self, groups: Sequence[int], model: str) -> Int64:
        """How many features of each photo have a checked match in some other, int64 [V].

        Pairs of photos with fewer than `FEWEST` checked matches don't count.
        """
        used = [np.zeros(len(own.places), bool) for own in self.features]
        for pair, (matches, _) in self.checked(groups, model).items():
            for side, number in enumerate(pair):
                used[number][matches[:, side]] = True
        return np.array([int(own.sum()) for own in used])

    def checked(self, groups: Sequence[int], model: str,
                ) -> dict[tuple[int, int], tuple[Matches, Float64]]:
        """Matches that two cameras can explain, uint32 [K, 2], and E [3, 3], by pairs of photos.

        Pairs of photos with fewer than `FEWEST` of them don't count. The matrix is zero where the
        lenses were not known.
        """
        with colmap().Database.open(self.database(groups, model)) as base:
            pairs, geometries = base.read_two_view_geometries()
        found = {}
        for pair, geometry in zip(pairs, geometries):
            matches = np.asarray(geometry.inlier_matches)
            if len(matches) >= FEWEST:
                one, other = (number - 1 for number in colmap().pair_id_to_image_pair(pair))
                essential = np.zeros((3, 3)) if geometry.E is None else np.asarray(geometry.E)
                found[one, other] = matches, essential
        return found
