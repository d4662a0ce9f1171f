"""Place the photos (incremental mapping): several tries, the best one is kept; then the lens.

Lens parameters run away while few photos are placed. So a lens starts with one term (none, if none
is wanted), and more are freed at the very end (`adjust`).

Where photos are left out that have matches with others, it is tried again: all photos at once
instead of one after the other (COLMAP's global mapping), which needs no good pair to start from and
finds a wrong focal length from far off; other focal lengths; a lens for each photo; and from the
best so far with weaker demands, until tries bring no more. Each try is reported on one line.

The final bundle adjustment has as many lens terms as the photos determine: a term that they hardly
determine gets an arbitrary value that bends the scene. So the cameras are adjusted with ever more
terms, and a model is taken only if it earns them: by Schwarz's criterion (BIC), and by errors that
fall by a hundredth at least; and only if its lens stays one, that bends rays the less the nearer
they are to the axis and nowhere by more than a quarter.

Wrong matches differ from right ones by how far right ones lie off: a third of a pixel before skin,
not a whole one. On a narrow arc, where the focal length and the distance change the pictures almost
alike, some hundred matches that are wrong by one to three pixels would decide between them.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Float64, Int64
from ..formats.colmap import lens_of
from .database import USUAL_FOCAL, Scene, colmap

_FEWEST_POINTS = 15  # A photo that sees fewer points of the model has no sure place.
_SUPPORT = 0.25
"""Nor has one for which a smaller part of its matched features are points of the model: all photos
at once may be laid out wrongly so that each still fits a few matches."""
_MOST, _IN_VAIN = 0.7, 2
"""Where this part of the photos is placed, so many tries in a row that place no more are the last:
of 66 photos of a shiny head 52 were placed in 210 s, and five more ways brought none in 300 s."""
_GROWN = 1.3  # All cameras are adjusted whenever the model has grown by this factor.
_FOCALS = (0.75, 2.4, 3.8)
"""Focal lengths over the longer side that are tried besides the usual one: 27, 86, 137 mm."""


def placed(model: Any, seen_again: Int64 | None = None) -> list[int]:
    """Numbers (from 0) of the photos that COLMAP's reconstruction places surely.

    ``seen_again`` int64 [V]: features of each photo that have a checked match (`Scene.seen_again`).
    """
    return sorted(number - 1 for number, image in model.images.items() if image.has_pose
                  and image.num_points3D >= _FEWEST_POINTS
                  and (seen_again is None
                       or image.num_points3D >= _SUPPORT * seen_again[number - 1]))


@dataclass(frozen=True)
class Placing:
    """One try."""

    how: str  # What was tried, in words.
    model: Any  # COLMAP's reconstruction, or None.
    photos: list[int]  # Numbers (from 0) of the photos that it places.
    groups: list[int]  # Number of each photo's lens in it.


class _Mapper:
    """COLMAP's two ways of mapping, with fixed seeds and on one thread: the same every time."""

    def __init__(self, scene: Scene, model: str, seen_again: Int64, report: Callable[[], None],
                 lens_known: bool) -> None:
        self.scene, self.model, self.report = scene, model, report
        self.seen_again, self.lens_known = seen_again, lens_known
        self.runs = 0

    def _folder(self) -> Path:
        self.runs += 1
        folder = self.scene.work / f"run{self.runs}"
        folder.mkdir()
        return folder

    def _best(self, how: str, models: dict[int, Any], groups: Sequence[int]) -> Placing:
        tries = [Placing(how, model, placed(model, self.seen_again), list(groups))
                 for model in models.values()]
        return max(tries, key=lambda one: len(one.photos),
                   default=Placing(how, None, [], list(groups)))

    def one_by_one(self, how: str, groups: Sequence[int], weak: bool = False,
                   start: Placing | None = None) -> Placing:
        """From a pair on, photo after photo; or from a model on."""
        options = self.scene.steady_options()
        options.min_model_size = 3  # COLMAP drops models of fewer than 10 photos
        options.max_num_models = 6
        options.extract_colors = False
        # The last adjustment refines all cameras; here they need to be good enough for the next
        # photo.
        options.ba_global_max_refinements, options.ba_local_max_refinements = 2, 1
        options.ba_global_frames_ratio = options.ba_global_points_ratio = _GROWN
        if self.lens_known:
            options.ba_refine_focal_length = options.ba_refine_extra_params = False
            options.mapper.abs_pose_refine_focal_length = False
            options.mapper.abs_pose_refine_extra_params = False
        if weak:
            options.mapper.init_min_num_inliers = 30
            options.mapper.init_min_tri_angle = 4.0
            options.mapper.abs_pose_min_num_inliers = 15
            options.mapper.abs_pose_min_inlier_ratio = 0.15
            options.min_num_matches = 10
        database = self.scene.database(groups, self.model)
        given: dict[str, Any] = {}
        if start is not None and start.model is not None:
            given["input_path"] = self._folder()
            start.model.write(given["input_path"])
        models = colmap().incremental_mapping(
            database, self.scene.work, self._folder(), options=options,
            next_image_callback=self.report, **given)
        return self._best(how, models, groups)

    def all_at_once(self, how: str, groups: Sequence[int], focal: float | None = None) -> Placing:
        """All rotations, then all positions, then everything."""
        options = colmap().GlobalPipelineOptions()
        options.random_seed = self.scene.seed
        options.mapper.random_seed = self.scene.seed
        options.num_threads = 1
        database = self.scene.database(groups, self.model, focal)
        models = colmap().global_mapping(database, self.scene.work, self._folder(), options=options)
        return self._best(how, models, groups)


def _tries(mapper: _Mapper, groups: list[int], best: Callable[[], Placing]) -> Iterator[Placing]:
    """One try after the other, as they are asked for."""
    scene = mapper.scene
    yield mapper.one_by_one("one after the other", groups)
    if mapper.lens_known:
        yield mapper.one_by_one("from weaker pairs", groups, weak=True)
        return
    yield mapper.all_at_once("all at once", groups)
    if len(best().photos) < 0.9 * len(groups):
        known = [focal / max(size) for focal, size in zip(scene.focals, scene.sizes) if focal]
        begun = float(np.median(known)) if known else USUAL_FOCAL
        for focal in (USUAL_FOCAL, *_FOCALS) if known else _FOCALS:
            if abs(np.log(focal / begun)) > 0.15:
                yield mapper.all_at_once(f"as if by a lens of {36 * focal:.0f} mm", groups, focal)
        yield mapper.one_by_one("from weaker pairs", groups, weak=True)
        if len(set(groups)) < len(groups):
            apart = list(range(len(groups)))
            yield mapper.all_at_once("with a lens for each photo", apart)
    if best().model is not None:
        yield mapper.one_by_one("on from the best, with weaker demands", best().groups, weak=True,
                                start=best())


def place_photos(scene: Scene, groups: list[int], model: str, report: Callable[[], None],
                 say: Callable[[str], None], *, lens_known: bool = False) -> Placing:
    """Place as many photos as can be.

    ``groups`` has the number of each photo's lens, ``model`` is COLMAP's name of the lens model to
    place them with, of one term of distortion at most; ``lens_known``: the lenses are as the scene
    says and stay so. ``report`` is called whenever a photo is placed, ``say`` with each try and its
    result, if the first one leaves photos out.
    """
    seen_again = scene.seen_again(groups, model)
    able = int((seen_again > 0).sum())
    tried = [Placing("nothing", None, [], groups)]
    in_vain = 0

    def best() -> Placing:
        # The first of those that place the most: it was made under the better conditions.
        return max(tried, key=lambda one: len(one.photos))

    for attempt in _tries(_Mapper(scene, model, seen_again, report, lens_known), groups, best):
        in_vain = 0 if len(attempt.photos) > len(best().photos) else in_vain + 1
        tried.append(attempt)
        if len(tried) > 2 or len(attempt.photos) < able:
            say(f"placing the photos {attempt.how}: {len(attempt.photos)} of {len(groups)}")
        if len(best().photos) >= able or (in_vain >= _IN_VAIN
                                          and len(best().photos) >= _MOST * able):
            break
    return best()


TERMS = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
"""Lens models by their number of terms."""

_STARTING = {"PINHOLE": "SIMPLE_PINHOLE", "SIMPLE_PINHOLE": "SIMPLE_PINHOLE",
             "OPENCV_FISHEYE": "SIMPLE_RADIAL_FISHEYE"}
_EARNED = 0.01  # Part of the robust squared error by which more terms have to lessen it.
_BENT = 0.25  # Part of the distance from the axis by which a lens may move a point of the picture.
_DENSE = 200
"""Photos up to which the adjustment's equations are solved as a dense matrix: most photos of a head
share points with most others, and a sparse solver takes a tenth longer."""
_ENOUGH = 10  # Photos of a lens from which on its centre can be estimated.
_DEVIATIONS = (0.1, 1.0)  # Pixels: the least and the greatest deviation of right matches.
_SURE = 0.25  # Part of a head's matches that are right, surely: a quarter and more are wrong.


def starting_model(wanted: str) -> str:
    """The model with which photos are placed: one term of distortion at most."""
    return _STARTING.get(wanted, "SIMPLE_RADIAL")


@dataclass(frozen=True)
class _Fit:
    """A model after its adjustment: errors [N] in pixels, and how many parameters it has."""

    model: Any
    errors: Float64
    parameters: int


def _with_model(model: Any, name: str) -> Any:
    """A copy of a reconstruction whose lenses are of another model, the known terms kept."""
    copy = colmap().Reconstruction(model)
    for number in list(copy.cameras):
        camera = copy.cameras[number]
        if camera.model.name == name:
            continue
        fresh = colmap().Camera.create_from_model_name(number, name, camera.mean_focal_length(),
                                                       camera.width, camera.height)
        parameters = np.array(fresh.params)
        parameters[list(fresh.principal_point_idxs())] = (camera.principal_point_x,
                                                          camera.principal_point_y)
        known = np.array(camera.params)[list(camera.extra_params_idxs())]
        for index, value in zip(fresh.extra_params_idxs(), known):
            parameters[index] = value
        camera.model, camera.params = fresh.model, parameters
    return copy


def _errors(model: Any) -> Float64:
    """Distances in pixels between observed and projected points, float64 [N]."""
    found = []
    for image in model.images.values():
        if not image.has_pose:
            continue
        seen = image.get_observation_points2D()
        places = np.array([point.xy for point in seen])
        points = np.array([model.points3D[point.point3D_id].xyz for point in seen])
        if not len(seen):
            continue
        local = points @ image.cam_from_world().rotation.matrix().T \
            + image.cam_from_world().translation
        pixels = model.cameras[image.camera_id].img_from_cam(local)
        found.append(np.linalg.norm(pixels - places, axis=1))
    errors = np.concatenate(found) if found else np.zeros(0)
    return np.where(np.isfinite(errors), errors, 1e3)


def _deviation(errors: Float64, nearest: float = 0.5) -> float:
    """Deviation in pixels, along each axis, of right matches among these errors [N] in pixels.

    From that part of the errors which is ``nearest``, as of a normal distribution in the plane: by
    their median, which few wrong ones do not change (Huber 1981, "Robust Statistics"), or by less
    where many are.
    """
    if not len(errors):
        return _DEVIATIONS[1]
    within = float(np.sqrt(-2 * np.log(1 - nearest)))
    return float(np.clip(np.quantile(errors, nearest) / within, *_DEVIATIONS))


def _solve(model: Any, deviation: float, iterations: int, *, center: bool = False,
           settled: float = 1e-5) -> _Fit:
    """Bundle adjustment with a Cauchy loss: large residuals are wrong matches, not information.

    What is large is measured in ``deviation``, pixels. It ends where an iteration lessens the
    errors by no more than ``settled`` of them. COLMAP's own bound, 0, takes all iterations, three
    times as many, for the same cameras.
    """
    options = colmap().BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_principal_point = center
    options.ceres.loss_function_type = colmap().LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = deviation
    options.ceres.solver_options.num_threads = 1
    options.ceres.max_num_images_direct_dense_cpu_solver = _DENSE
    options.ceres.solver_options.max_num_iterations = iterations
    options.ceres.solver_options.function_tolerance = settled
    scope = colmap().BundleAdjustmentConfig()
    members: dict[int, int] = {}
    for number, image in model.images.items():
        if image.has_pose:
            scope.add_image(number)
            members[image.camera_id] = members.get(image.camera_id, 0) + 1
    scope.fix_gauge(colmap().BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    # pycolmap.bundle_adjustment does the same, but turns COLMAP's log on again.
    colmap().create_default_bundle_adjuster(options, scope, model).solve()
    terms = [len(model.cameras[number].params) - (0 if center else 2) for number in members]
    return _Fit(model, _errors(model), sum(terms))


def _earns(fit: _Fit, base: _Fit) -> bool:
    """Whether more terms explain the photos so much better that they are there."""
    scale = max(float(np.median(base.errors)), 1e-3)
    costs = [float(np.log1p((one.errors / scale) ** 2).sum()) for one in (fit, base)]
    count = 2 * len(base.errors)
    gain = count * np.log(costs[1] / max(costs[0], 1e-9))
    return bool(costs[0] < (1 - _EARNED) * costs[1]
                and gain > (fit.parameters - base.parameters) * np.log(count))


def _sane(model: Any) -> bool:
    """Whether every lens bends rays by little and never back, all over its picture."""
    for camera in model.cameras.values():
        lens = lens_of(camera.model.name, camera.width, camera.height, camera.params)
        if lens.model != "opencv":
            continue
        reach = np.hypot(max(lens.center[0], lens.width - lens.center[0]) / lens.focal[0],
                         max(lens.center[1], lens.height - lens.center[1]) / lens.focal[1])
        r = np.linspace(1e-3, 1.0, 64) * reach
        moved = np.linalg.norm(lens.distort(np.stack([r, 0 * r], 1)), axis=1)
        if np.any(np.diff(moved) <= 0) or np.any(np.abs(moved / r - 1) > _BENT):
            return False
        off = np.abs(np.array(lens.center) / (lens.width, lens.height) - 0.5)
        if off.max() > 0.3:
            return False
    return True


def adjust(model: Any, wanted: str, triangulated: Callable[[Any], Any] | None = None) -> Any:
    """Adjust all cameras and points, with as many lens terms as the photos determine.

    ``wanted`` is a lens model of COLMAP, or ``"auto"``: one of `TERMS`, the centre of the picture
    freed where that is earned (a picture that was cropped). ``triangulated`` finds the points once
    more by the cameras of a reconstruction (`Scene.triangulated`): which matches are points was
    decided while the cameras were rough; adjusted once more to those that fit, cameras are better
    by a fifth.
    """
    deviation = _deviation(_errors(model))
    fitted = (_with_earned_terms(model, deviation) if wanted == "auto" else
              _solve(_with_model(model, wanted), deviation, 30).model)
    # Points that are found once more lie half as far off again until they are adjusted. The loss
    # is as sharp as can be only here: under a sharp one terms are earned that are not there.
    deviation = _deviation(_errors(fitted), _SURE)
    if triangulated is not None:
        fitted = triangulated(fitted)
    return _solve(fitted, deviation, 25, settled=1e-6).model


def _with_earned_terms(model: Any, deviation: float) -> Any:
    """The model adjusted with each of `TERMS` that explains the photos better than those before.

    All are adjusted with one deviation: else later ones would be better by their sharper loss.
    """
    kept = _solve(_with_model(model, TERMS[0]), deviation, 30)
    for name in TERMS[1:]:
        more = _solve(_with_model(kept.model, name), deviation, 30)
        if not (_earns(more, kept) and _sane(more.model)):
            break
        kept = more
    groups = [image.camera_id for image in kept.model.images.values() if image.has_pose]
    if min(groups.count(number) for number in set(groups)) >= _ENOUGH:
        more = _solve(colmap().Reconstruction(kept.model), deviation, 30, center=True)
        if _earns(more, kept) and _sane(more.model):
            kept = more
    return kept.model
