"""Cut out the person (or object) from photos with a background."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..arrays import Float32, Float64, UInt8
from ..capture import Capture, consistent_mattes, matte_agreement, refine_changes, refine_matte
from ..progress import Progress
from ..simd.threads import side_by_side

__all__ = ["cut_person", "rough_mattes"]

# A network that is right has most of its mattes overlap with their common solid by this much; one
# of which only few do is wrong.
_OVERLAP, _MOST, _FEWEST = 0.6, 0.8, 0.25
_NOBODY = 0.01  # share of all pixels below which the network sees nobody

Network = Callable[[UInt8, Float64], Float32]


def rough_mattes(capture: Capture, progress: Progress | None = None,
                 network: Network | None = None) -> list[Float32]:
    """A network's mattes of each photo separately.

    Parameters
    ----------
    capture
        Photos in the portrait frame.
    progress
        Progress line.
    network
        Person matte of a picture whose direction ``up`` is given; by default
        `lfportrait.face.person_matte`.

    Returns
    -------
    mattes
        V times float32 [H, W] in [0, 1].

    Raises
    ------
    UserError
        If the network's weights are missing.
    """
    from ..face import person_matte

    matte_of = network or person_matte
    soft = []
    for view, image in enumerate(capture.images):
        soft.append(matte_of(image, _up_in_image(capture, view)))
        if progress is not None:
            progress.update(0, f"cutting out the person: {view + 1} of {len(capture)}")
    return soft


def cut_person(capture: Capture, progress: Progress | None = None,
               network: Network | None = None,
               soft: list[Float32] | None = None) -> tuple[Capture, str]:
    """Cut the person out of every photo.

    A network's mattes where they agree: corrected by what other photos show behind the person
    (`lfportrait.field.geometry.clean_plates`), or else made consistent over the views and freed of
    what the photos' depth puts elsewhere, and sharpened along the photos' edges. Where they do not
    agree, as with a sculpture, the object that the cameras look at, cut out by its geometry
    (`lfportrait.field.geometry.cutout`).

    Parameters
    ----------
    capture
        Photos without mattes, in the portrait frame.
    progress
        Progress line.
    network
        Person matte of a picture, as for `rough_mattes`.
    soft
        What a network has said already (`rough_mattes`).

    Returns
    -------
    capture, how
        The capture with mattes, or the same if nothing was found; ``"network"``, ``"geometry"`` or
        why there are none. The capture's figures contain the first two as ``mattes``.

    Raises
    ------
    UserError
        If the network's weights are missing.
    """
    from ..field.geometry import cut_out

    if soft is None:
        soft = rough_mattes(capture, progress, network)
    # A few views leave too much of space undecided.
    agree = (matte_agreement(capture.cameras, soft) > _OVERLAP if len(capture) >= 6
             else np.ones(len(capture), bool))
    mattes, how = None, "network"
    seen = np.mean([float(matte.mean()) for matte in soft]) > _NOBODY
    if seen and agree.mean() < _MOST:
        mattes = cut_out(capture, soft, progress)
        how = "geometry" if mattes is not None else how
    if mattes is None:
        mattes = _along_edges(capture, soft, agree.mean() >= _MOST, progress)
    # The network may see no person, or a different one in every photo, and neither texture nor
    # votes find an object.
    nobody = np.mean([float(matte.mean()) for matte in mattes]) <= 0.002
    if nobody or (how == "network" and agree.mean() < _FEWEST):
        return capture, "none: no person was found, the room stays"
    alphas = [(np.clip(matte, 0, 1) * 255 + 0.5).astype(np.uint8) for matte in mattes]
    return replace(capture, alphas=alphas, figures={**capture.figures, "mattes": how}), how


def _along_edges(capture: Capture, soft: list[Float32], sure: bool,
                 progress: Progress | None) -> list[Float32]:
    """A network's mattes, corrected by what is behind the person and along the photos' edges.

    Where the views do not show what is behind, they and their depth vote on the mattes instead;
    where these change a matte much, it is laid along the edges once more.
    """
    from ..field.geometry import plate_mattes, trim

    mattes = plate_mattes(capture, soft, progress) if sure else None
    if mattes is not None:
        return mattes
    if progress is not None:
        progress.update(0, "cutting out the person: edges")
    # Two at a time at the most: each photo's planes take a few hundred megabytes.
    views = range(len(capture))
    refined = side_by_side(lambda view: refine_matte(capture.images[view], soft[view]), views, 2)
    if progress is not None:
        progress.update(0, "cutting out the person: votes of the views")
    agreed = consistent_mattes(capture, refined)
    if sure and len(capture.training()) >= 6:
        agreed = trim(capture, agreed, progress)
    return side_by_side(lambda view: refine_changes(capture.images[view], refined[view],
                                                    agreed[view]), views, 2)


def _up_in_image(capture: Capture, view: int) -> Float64:
    """The world's up direction in a picture, [2] (x right, y down), unit length."""
    up = capture.cameras.pose[view, :3, :3].T @ np.array([0.0, 1.0, 0.0])
    flat = up[:2]
    return np.asarray(flat / max(float(np.linalg.norm(flat)), 1e-9))
