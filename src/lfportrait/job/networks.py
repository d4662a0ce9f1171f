"""Check and download a job's pretrained networks before the first long stage.

Some are needed: without landmarks there is no transfer, without mattes no head to reconstruct.
Others make the result better: without networks, person and hair are segmented by color. What is
given (landmarks beside a painting, photos with an alpha channel) needs none.
"""

from __future__ import annotations

import sys
from pathlib import Path

from .. import models
from ..capture import is_video
from ..errors import UserError
from ..files import read_json
from ..media.folders import folders_below, list_pictures
from ..media.pictures import read_image


def _described(photos: Path) -> dict[str, object]:
    """What a capture that lfportrait wrote says of itself; empty for anything else."""
    path = photos / "transforms.json" if photos.is_dir() else photos
    if path.name != "transforms.json" or not path.is_file():
        return {}
    data = read_json(path)
    return data if isinstance(data, dict) and data.get("generator") == "lfportrait" else {}


def _cut_out(photos: Path) -> bool:
    """Whether the photos of a data set have mattes, judged by its first picture."""
    if not photos.is_dir():
        return _matted(photos)
    folders = [photos, *folders_below(photos)]
    if any(folder.name == "masks" for folder in folders):
        return True
    for path in (path for folder in folders for path in list_pictures(folder).files):
        try:
            return _matted(path)
        except UserError:  # a damaged one is left out later, with a warning
            continue
    return False


def _matted(path: Path) -> bool:
    """Whether a picture has an alpha channel that cuts something out."""
    picture = read_image(path)
    return picture.shape[-1] == 4 and bool((picture[..., 3] < 255).any())


def _bare(painting: Path | None) -> bool:
    """Whether a painting has no landmarks beside it."""
    return painting is not None and not painting.with_suffix(".landmarks.txt").exists()


def networks_of(photos: Path, painting: Path | None, keep_background: bool,
                ) -> tuple[list[str], list[str]]:
    """A job's required networks, and the optional ones, by their names in `lfportrait.models`.

    ``painting`` is None where the exemplar is known already; if the background is kept, no mattes
    are wanted.
    """
    described = _described(photos)
    landmarks_given = described.get("landmarks") is not None and not _bare(painting)
    needed = [] if landmarks_given else ["face-landmarker"]
    cut_out = keep_background or (not is_video(photos) and _cut_out(photos))
    regions = ["person-segmentation", "hair-segmentation"]
    if cut_out:
        return needed, regions
    return [*needed, regions[0]], regions[1:]


def get_networks(photos: Path, painting: Path | None, keep_background: bool, *, offline: bool,
                 quiet: bool) -> None:
    """Check or download a job's networks, and report optional ones that are missing.

    Raises `UserError` if one that is needed is missing and not to be had: one line with all of
    them, their size and the command that gets them.
    """
    needed, better = networks_of(photos, painting, keep_background)
    if models.missing(needed):
        # All at once: what is only better is part of the same download.
        try:
            models.require([*needed, *better], download=not offline, purpose="this job",
                           quiet=quiet)
        except UserError as error:
            if not _bare(painting):
                raise
            assert painting is not None
            beside = painting.with_suffix(".landmarks.txt").name
            raise UserError(f"{error} (the landmarks of {painting} must be detected, too: there is "
                            f"no {beside} beside it)") from error
        return
    models.require(needed, download=False, quiet=quiet)
    if models.missing(better):
        try:
            models.require(better, download=not offline, purpose="a better outline", quiet=quiet)
        except UserError as error:
            if not quiet:
                print(f"continuing without segmentation networks; person and hair are found by "
                      f"color: {error}", file=sys.stderr)
