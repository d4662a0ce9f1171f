"""The final bundle adjustment, with as many lens terms as the photos determine.

Each further term makes the errors smaller, whether the lens has it or not, and a term that the
photos hardly determine gets an arbitrary value that bends the scene. So the cameras are adjusted
with ever more terms, and a model is taken only if it earns them: by Schwarz's criterion (BIC), and
by errors that fall by a hundredth at least; and only if its lens stays one, that bends rays the
less the nearer they are to the axis and nowhere by more than a quarter.

Wrong matches are told from right ones by how far right ones lie off: a third of a pixel before
skin, not a whole one. On a narrow arc the focal length depends on that. There it and the distance
change the pictures almost alike (a quarter of a per cent of the head's depth for a per cent of the
focal length), and some hundred matches that are wrong by one to three pixels decide between them
if they count as if they could be right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..formats import lens_of

__all__ = ["TERMS", "adjust", "starting_model"]

TERMS = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
"""Lens models by their number of terms."""

_STARTING = {"PINHOLE": "SIMPLE_PINHOLE", "SIMPLE_PINHOLE": "SIMPLE_PINHOLE",
             "OPENCV_FISHEYE": "SIMPLE_RADIAL_FISHEYE"}
_EARNED = 0.01
"""Part of the robust squared error by which more terms have to lessen it."""
_BENT = 0.25
"""Part of the distance from the axis by which a lens may move a point of the picture."""
_ENOUGH = 10
"""Photos of a lens from which on its centre can be estimated."""
_DEVIATIONS = (0.1, 1.0)
"""Pixels: the least and the greatest deviation of right matches. Where half of all are wrong, their
median says nothing."""
_MEDIAN = float(np.sqrt(2 * np.log(2)))
"""Median distance from the middle of a normal distribution in the plane, in its deviations."""


def starting_model(wanted: str) -> str:
    """The model with which photos are placed: one term of distortion at most."""
    return _STARTING.get(wanted, "SIMPLE_RADIAL")


@dataclass(frozen=True)
class _Fit:
    """A model after its adjustment: errors [N] in pixels, and how many parameters it has."""

    model: Any
    errors: NDArray[np.float64]
    parameters: int


def _with_model(pycolmap: Any, model: Any, name: str) -> Any:
    """A copy of a reconstruction whose lenses are of another model, the known terms kept."""
    copy = pycolmap.Reconstruction(model)
    for number in list(copy.cameras):
        camera = copy.cameras[number]
        if camera.model.name == name:
            continue
        fresh = pycolmap.Camera.create_from_model_name(number, name, camera.mean_focal_length(),
                                                       camera.width, camera.height)
        parameters = np.array(fresh.params)
        parameters[list(fresh.principal_point_idxs())] = (camera.principal_point_x,
                                                          camera.principal_point_y)
        known = np.array(camera.params)[list(camera.extra_params_idxs())]
        room = list(fresh.extra_params_idxs())
        for index, value in zip(room, known):
            parameters[index] = value
        camera.model = fresh.model
        camera.params = parameters
    return copy


def _errors(model: Any) -> NDArray[np.float64]:
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


def _deviation(errors: NDArray[np.float64]) -> float:
    """Deviation in pixels, along each axis, of right matches among these errors [N] in pixels.

    From their median, which few wrong ones do not change (Huber 1981, "Robust Statistics").
    """
    if not len(errors):
        return _DEVIATIONS[1]
    return float(np.clip(np.median(errors) / _MEDIAN, *_DEVIATIONS))


def _solve(pycolmap: Any, model: Any, deviation: float, iterations: int, *, center: bool = False,
           settled: float = 1e-5) -> _Fit:
    """Bundle adjustment with a Cauchy loss: large residuals are wrong matches, not information.

    What is large is measured in ``deviation``, pixels. It ends where an iteration lessens the
    errors by no more than ``settled`` of them. COLMAP's own bound, 0, takes all iterations, three
    times as many, for the same cameras.
    """
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_principal_point = center
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = deviation
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.max_num_iterations = iterations
    options.ceres.solver_options.function_tolerance = settled
    scope = pycolmap.BundleAdjustmentConfig()
    members: dict[int, int] = {}
    for number, image in model.images.items():
        if image.has_pose:
            scope.add_image(number)
            members[image.camera_id] = members.get(image.camera_id, 0) + 1
    scope.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    # pycolmap.bundle_adjustment does the same, but turns COLMAP's log on again.
    pycolmap.create_default_bundle_adjuster(options, scope, model).solve()
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


def adjust(pycolmap: Any, model: Any, wanted: str,
           triangulated: Callable[[Any], Any] | None = None) -> Any:
    """Adjust all cameras and points, with as many lens terms as the photos determine.

    Parameters
    ----------
    pycolmap : The module.
    model : COLMAP's reconstruction.
    wanted : A lens model of COLMAP to fit, or ``"auto"``.
    triangulated : Finds the points once more by the cameras of a reconstruction
        (`Scene.triangulated`). Which matches are points was decided while the cameras were rough;
        the cameras are adjusted once more to those that fit the adjusted ones, which makes them
        better by a fifth.

    Returns
    -------
    model : A new reconstruction. With ``"auto"`` its lenses are of one of `TERMS`, the centre of
        the picture freed where that is earned (a picture that was cropped).
    """
    deviation = _deviation(_errors(model))
    fitted = (_with_earned_terms(pycolmap, model, deviation) if wanted == "auto" else
              _solve(pycolmap, _with_model(pycolmap, model, wanted), deviation, 30).model)
    if triangulated is not None:
        fitted = triangulated(fitted)
    return _solve(pycolmap, fitted, _deviation(_errors(fitted)), 50, settled=1e-6).model


def _with_earned_terms(pycolmap: Any, model: Any, deviation: float) -> Any:
    """The model adjusted with each of `TERMS` that explains the photos better than those before.

    All are adjusted with one deviation: else later ones would be better by their sharper loss.
    """
    kept = _solve(pycolmap, _with_model(pycolmap, model, TERMS[0]), deviation, 30)
    for name in TERMS[1:]:
        more = _solve(pycolmap, _with_model(pycolmap, kept.model, name), deviation, 30)
        if not (_earns(more, kept) and _sane(more.model)):
            break
        kept = more
    groups = [image.camera_id for image in kept.model.images.values() if image.has_pose]
    if min(groups.count(number) for number in set(groups)) >= _ENOUGH:
        more = _solve(pycolmap, pycolmap.Reconstruction(kept.model), deviation, 30,
                      center=True)
        if _earns(more, kept) and _sane(more.model):
            kept = more
    return kept.model
