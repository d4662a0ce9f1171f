"""Quality of transfers by example, by the same figures for any method's result.

(a) Patch fidelity: mean distance of the result's 7 x 7 patches (CIE Lab) to their nearest patches
of the exemplar. The search is exact over all patches of the exemplar; some 16000 patches of the
result are spread evenly, at the same places in every picture that is compared. (b) Identity:
landmarks found in the result against those found in the photo, relative to the eyes.

Both have limits. A picture that copies the exemplar as it is has perfect patches and no identity;
the photo itself has perfect identity. So the two are read together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skimage.draw import polygon2mask

from lfportrait.example import Exemplar
from lfportrait.media.pictures import read_image

from .likeness import Detector, landmark_error
from .patches import PatchIndex

__all__ = ["REFERENCES", "Reference", "compare_with_references", "face_region", "quality",
           "quality_table", "references"]

Paint = Callable[[NDArray[np.uint8], Exemplar, NDArray[np.float64]], NDArray[Any]]
"""Photo, exemplar and landmarks of the photo -> picture [H, W, 3]."""

SAMPLES = 16000
"""Patches looked up in a region, about: other places change the mean by less than a hundredth."""

REFERENCES = {"bronzestatue": "target1_bronzestatue_3x3_voting.png",
              "charcoalman": "target1_charcoalman_3x3_voting_bg.png",
              "het": "target1_het_3x3_voting_bg.png", "ken": "target1_ken_3x3_voting_bg.png",
              "stonebust": "target1_stonebust_3x3_voting_bg.png"}
"""Published results of FaceBlit on its ``target1.png`` by style; without ``_bg`` the face alone is
painted."""


@dataclass(frozen=True)
class Reference:
    """A published result.

    Attributes
    ----------
    exemplar
        The style.
    image
        uint8 [H, W, 3].
    whole
        Whether the whole picture is painted, or the face alone.
    """

    exemplar: Exemplar
    image: NDArray[np.uint8]
    whole: bool


def references(data: Path) -> tuple[NDArray[np.uint8], dict[str, Reference]] | str:
    """The photo and the published results by style, or why they can't be had.

    Parameters
    ----------
    data
        Folder with ``faceblit_reference/`` (`REFERENCES`, ``target1.png``) and ``styles/``.
    """
    folder = data / "faceblit_reference"
    missing = [path for path in (folder / "target1.png", *(folder / n for n in REFERENCES.values()),
                                 *(data / "styles" / f"{n}.png" for n in REFERENCES))
               if not path.is_file()]
    if missing:
        return f"skipped: there is no {missing[0]}"
    found = {style: Reference(Exemplar.load(data / "styles" / f"{style}.png"),
                              np.ascontiguousarray(read_image(folder / name)[..., :3]),
                              "_bg" in name)
             for style, name in REFERENCES.items()}
    return np.ascontiguousarray(read_image(folder / "target1.png")[..., :3]), found


def face_region(shape: tuple[int, ...], landmarks: NDArray[np.floating]) -> NDArray[np.bool_]:
    """The face between jaw and brows, which every method paints; bool [H, W]."""
    outline = np.concatenate([landmarks[:17], landmarks[17:27][::-1]])
    return np.asarray(polygon2mask(shape[:2], outline[:, ::-1]), bool)


def quality(image: NDArray[Any], photo: NDArray[np.uint8], exemplar: Exemplar,
            landmarks: NDArray[np.float64], detect: Detector, *, whole: bool = True,
            samples: int = SAMPLES, seed: int = 0,
            patches: PatchIndex | None = None) -> dict[str, float]:
    """Figures of one result.

    Parameters
    ----------
    image
        The result, uint8 or float in [0, 1], [H, W, 3].
    photo
        uint8 [H, W, 3].
    exemplar
        The style.
    landmarks
        [68, 2] of the photo, found by the same detector.
    detect
        Picture -> landmarks [68, 2] or None; e.g. `lfportrait.face.detect_landmarks`.
    whole
        Whether the whole picture is painted.
    samples, seed
        Patches looked up in each region, about, and the seed of their places.
    patches
        The exemplar's, where they are at hand.

    Returns
    -------
    figures
        ``face`` and ``picture``: patch distance (delta E; NaN for a picture that is not painted
        whole); ``nme``: landmark error over the distance of the outer eye corners, NaN if no face
        is found in the result.
    """
    if image.shape[:2] != photo.shape[:2]:
        raise ValueError("the result must have the size of the photo")
    eight = image if image.dtype == np.uint8 else np.asarray(
        np.clip(image, 0, 1) * 255 + 0.5, np.uint8)
    found = detect(np.ascontiguousarray(eight))
    patches = patches or PatchIndex(exemplar.image)
    return {"face": patches.fidelity(eight, face_region(photo.shape, landmarks), samples=samples,
                                     seed=seed),
            "picture": patches.fidelity(eight, samples=samples, seed=seed)
            if whole else float("nan"),
            "nme": landmark_error(found, landmarks) if found is not None else float("nan")}


def compare_with_references(photo: NDArray[np.uint8], published: Mapping[str, Reference],
                            methods: Mapping[str, Paint], detect: Detector, *,
                            samples: int = SAMPLES, seed: int = 0,
                            keep: Callable[[str, str, NDArray[Any]], None] | None = None,
                            ) -> dict[str, dict[str, dict[str, float]]]:
    """Figures of published results and of methods on the same photo and styles.

    Parameters
    ----------
    photo, published
        As `references` gives them.
    methods
        By name, how to paint.
    detect, samples, seed
        See `quality`.
    keep
        Called with style, method and result of each transfer; e.g. to write it.

    Returns
    -------
    figures
        By style, then by method (``reference`` first, ``photo`` last): those of `quality`.
    """
    landmarks = detect(photo)
    if landmarks is None:
        raise ValueError("no face found in the photo of the references")
    rows: dict[str, dict[str, dict[str, float]]] = {}
    for style, reference in published.items():
        index = PatchIndex(reference.exemplar.image)

        def measure(image: NDArray[Any], whole: bool = True,
                    exemplar: Exemplar = reference.exemplar,
                    patches: PatchIndex = index) -> dict[str, float]:
            return quality(image, photo, exemplar, landmarks, detect, whole=whole, samples=samples,
                           seed=seed, patches=patches)

        rows[style] = {"reference": measure(reference.image, reference.whole)}
        for name, paint in methods.items():
            made = paint(photo, reference.exemplar, landmarks)
            if keep is not None:
                keep(style, name, made)
            rows[style][name] = measure(made)
        rows[style]["photo"] = measure(photo)
    return rows


def quality_table(rows: Mapping[str, Mapping[str, Mapping[str, float]]]) -> str:
    """The figures of `compare_with_references`, a line for each style and method, then means."""
    lines = [f"{'style':<14}{'method':<12}{'patches, face':>15}{'patches, all':>15}"
             f"{'landmarks':>12}"]

    def line(style: str, method: str, row: Mapping[str, float]) -> str:
        return (f"{style:<14}{method:<12}{row['face']:>15.2f}{row['picture']:>15.2f}"
                f"{row['nme']:>12.4f}").replace("nan", "  -")

    for style, methods in rows.items():
        lines += [line(style, method, row) for method, row in methods.items()]
    for method in next(iter(rows.values()), {}):
        # A mean over fewer styles than the others' would not compare.
        means = {name: float(np.mean([rows[style][method][name] for style in rows]))
                 for name in ("face", "picture", "nme")}
        lines.append(line("mean", method, means))
    return "\n".join(lines)
