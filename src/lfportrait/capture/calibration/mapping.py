"""Place the photos (incremental mapping): several tries, of which the best one is kept.

Lens parameters run away while few photos are placed: behind a long lens two terms of distortion
placed 5 of 66 photos where one term placed all. So a lens starts with one term (none, if none is
wanted), and more are freed at the very end (`lens_terms`).

Where photos are left out that have matches with others, it is tried again: all photos at once
instead of one after the other (COLMAP's global mapping), which needs no good pair to start from and
finds a wrong focal length from far off; other focal lengths; a lens for each photo; and from the
best so far with weaker demands, until tries bring no more. Each try is reported on one line.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .database import USUAL_FOCAL, Scene

__all__ = ["Placing", "place_photos", "placed"]

_FEWEST_POINTS = 15
"""A photo that sees fewer points of the model has no sure place."""
_SUPPORT = 0.25
"""Nor has one for which a smaller part of its matched features are points of the model: all photos
at once may be laid out wrongly so that each still fits a few matches."""
_MOST, _IN_VAIN = 0.7, 2
"""Where this part of the photos is placed, so many tries in a row that place no more are the last:
of 66 photos of a shiny head 52 were placed in 210 s, and five more ways brought none in 300 s."""
_GROWN = 1.3
"""All cameras are adjusted whenever the model has grown by this factor."""
_FOCALS = (0.75, 2.4, 3.8)
"""Focal lengths over the longer side that are tried besides the usual one: 27, 86, 137 mm."""


def placed(model: Any, seen_again: NDArray[np.int64] | None = None) -> list[int]:
    """Numbers (from 0) of the photos that a model places surely.

    Parameters
    ----------
    model : COLMAP's reconstruction.
    seen_again : int64 [V], features of each photo that have a checked match (`Scene.seen_again`).
    """
    return sorted(number - 1 for number, image in model.images.items() if image.has_pose
                  and image.num_points3D >= _FEWEST_POINTS
                  and (seen_again is None
                       or image.num_points3D >= _SUPPORT * seen_again[number - 1]))


@dataclass(frozen=True)
class Placing:
    """One try.

    Attributes
    ----------
    how : What was tried, in words.
    model : COLMAP's reconstruction, or None.
    photos : Numbers (from 0) of the photos that it places.
    groups : Number of each photo's lens in it.
    """

    how: str
    model: Any
    photos: list[int]
    groups: list[int]


class _Mapper:
    """COLMAP's two ways of mapping, with fixed seeds and on one thread: the same every time."""

    def __init__(self, pycolmap: Any, scene: Scene, model: str,
                 seen_again: NDArray[np.int64], report: Callable[[], None],
                 lens_known: bool) -> None:
        self.pycolmap, self.scene, self.model, self.report = pycolmap, scene, model, report
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

    def one_by_one(self, how: str, groups: Sequence[int], focal: float | None = None,
                   weak: bool = False, start: Placing | None = None) -> Placing:
        """From a pair on, photo after photo; or from a model on."""
        options = self.scene.steady_options(self.pycolmap)
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
        database = self.scene.database(self.pycolmap, groups, self.model, focal)
        given: dict[str, Any] = {}
        if start is not None and start.model is not None:
            given["input_path"] = self._folder()
            start.model.write(given["input_path"])
        models = self.pycolmap.incremental_mapping(
            database, self.scene.work, self._folder(), options=options,
            next_image_callback=self.report, **given)
        return self._best(how, models, groups)

    def all_at_once(self, how: str, groups: Sequence[int], focal: float | None = None) -> Placing:
        """All rotations, then all positions, then everything."""
        options = self.pycolmap.GlobalPipelineOptions()
        options.random_seed = self.scene.seed
        options.mapper.random_seed = self.scene.seed
        options.num_threads = 1
        database = self.scene.database(self.pycolmap, groups, self.model, focal)
        models = self.pycolmap.global_mapping(database, self.scene.work, self._folder(),
                                              options=options)
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


def place_photos(pycolmap: Any, scene: Scene, groups: list[int], model: str,
                 report: Callable[[], None], say: Callable[[str], None], *,
                 lens_known: bool = False) -> Placing:
    """Place as many photos as can be.

    Parameters
    ----------
    pycolmap : The module.
    scene : The photos.
    groups : Number of each photo's lens.
    model : COLMAP's name of the lens model to place them with, of one term of distortion at most.
    report : Called whenever a photo is placed.
    say : Called with each try and its result, if the first one leaves photos out.
    lens_known : Whether the lenses are as the scene says, and stay so.

    Returns
    -------
    placing : The best try.
    """
    seen_again = scene.seen_again(pycolmap, groups, model)
    able = int((seen_again > 0).sum())
    tried = [Placing("nothing", None, [], groups)]
    in_vain = 0

    def best() -> Placing:
        # The first of those that place the most: it was made under the better conditions.
        return max(tried, key=lambda one: len(one.photos))

    for attempt in _tries(_Mapper(pycolmap, scene, model, seen_again, report, lens_known),
                          groups, best):
        in_vain = 0 if len(attempt.photos) > len(best().photos) else in_vain + 1
        tried.append(attempt)
        if len(tried) > 2 or len(attempt.photos) < able:
            say(f"placing the photos {attempt.how}: {len(attempt.photos)} of {len(groups)}")
        if len(best().photos) >= able or (in_vain >= _IN_VAIN
                                          and len(best().photos) >= _MOST * able):
            break
    return best()
