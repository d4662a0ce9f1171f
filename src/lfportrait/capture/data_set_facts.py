"""What is known of a calibrated data set before its pictures are decoded."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import UserError
from ..measure import usable_cores
from ..media.folders import Finder
from .formats import Shot, find_views, mask_of
from .picture_facts import PictureFacts, picture_facts

__all__ = ["DataSetFacts", "data_set_facts"]


@dataclass(frozen=True)
class DataSetFacts:
    """Of a calibrated data set.

    Attributes
    ----------
    path
        As it was given.
    fault
        Why it can't be read; empty where it can. Nothing else is known then.
    format
        The program or format whose files it has.
    source
        The file or folder with the cameras.
    lenses
        Views by their lens model, as text.
    masks
        Views whose mask was found.
    test
        Views that the data set itself holds out.
    pictures
        Of each view's file.
    """

    path: Path
    fault: str = ""
    format: str = ""
    source: Path | None = None
    lenses: dict[str, int] = field(default_factory=dict)
    masks: int = 0
    test: int = 0
    pictures: list[PictureFacts] = field(default_factory=list)


def data_set_facts(path: Path) -> DataSetFacts:
    """Look at a calibrated data set (`is_calibrated`).

    Warnings say what is missing in it, as when it is read.
    """
    try:
        found = find_views(path)
    except UserError as error:
        return DataSetFacts(path, str(error))
    with ThreadPoolExecutor(usable_cores()) as threads:
        pictures = list(threads.map(picture_facts, [shot.path for shot in found.shots]))
    finder = Finder()
    lenses = Counter(_lens_model(shot, one) for shot, one in zip(found.shots, pictures))
    return DataSetFacts(path, "", found.format, found.source, dict(lenses),
                        sum(mask_of(shot, finder) is not None for shot in found.shots),
                        sum(bool(shot.test) for shot in found.shots), pictures)


def _lens_model(shot: Shot, picture: PictureFacts) -> str:
    """A shot's lens in a word or two."""
    if picture.fault:
        return "unknown, as the picture can't be read"
    try:
        lens = shot.lens(*(shot.size or picture.stored))
    except (TypeError, ValueError, UserError) as error:
        return f"can't be read: {error}"
    return lens.model if lens.distorts else "pinhole"
