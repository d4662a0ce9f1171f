"""An exemplar: one painted portrait with its 68 landmarks and, where known, a mask of its head."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from PIL import Image

from .. import face, models
from ..arrays import Array, Float32, Float64, Floats, UInt8
from ..cache import hash_of, kept_arrays, key_of
from ..errors import UserError
from ..face import FacePose
from ..labels import BY_HAND
from ..media.pictures import read_image, read_mask
from ..plugins import provided_styles
from .guides.regions import Regions, find_regions


def face_size(landmarks: Floats) -> float:
    """Size of a face in pixels: root mean square distance of its landmarks from their mean.

    About 0.31 of the width of a frontal face between the ears.
    """
    points = np.asarray(landmarks, np.float64)
    points = points[np.isfinite(points).all(axis=1)]
    return float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))


@dataclass
class Exemplar:
    """One painted portrait.

    Attributes
    ----------
    image : uint8 [H, W, 3], sRGB.
    landmarks : float64 [68, 2], iBUG order, pixels (x right, y down).
    name : Short name, for titles and file names.
    mask : float32 [H, W] in [0, 1]: the person (head, hair, neck and clothes) against the
        background, or None; then the transfer segments the picture itself.
    faces : How many faces were found in the picture; 1 where its landmarks were given.
    hair : float32 [H, W] in [0, 1]: the hair where it is known, or None; then it is segmented.
    covered, bared : The painting before its forehead was bared (`worn.inpainting`), and float32
        [H, W] in [0, 1], where it was; or None.
    hat : float32 [H, W] in [0, 1], the hat of a bared painting that shows hair of other colors
        beside it; or None.
    lids : Which of its eyes, on the picture's left and right, were shut (`lids.closed`).
    opened : The exemplar as it was before, or None.
    by_hand : uint8 [H, W], regions that were painted over by hand, as places in
        `lfportrait.labels.BY_HAND`; or None.
    """

    image: UInt8
    landmarks: Float64
    name: str = "exemplar"
    mask: Float32 | None = field(default=None, repr=False)
    faces: int = 1
    hair: Float32 | None = field(default=None, repr=False)
    covered: Exemplar | None = field(default=None, repr=False)
    bared: Float32 | None = field(default=None, repr=False)
    hat: Float32 | None = field(default=None, repr=False)
    lids: tuple[bool, bool] = (False, False)
    opened: Exemplar | None = field(default=None, repr=False)
    by_hand: UInt8 | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self.image = np.ascontiguousarray(self.image[..., :3], np.uint8)
        self.landmarks = np.asarray(self.landmarks, np.float64)
        if self.landmarks.shape != (68, 2):
            raise ValueError(f"landmarks must be [68, 2], not {list(self.landmarks.shape)}")
        if self.mask is not None and self.mask.shape != self.image.shape[:2]:
            raise ValueError("the mask must have the size of the picture")
        if self.by_hand is not None and self.by_hand.shape != self.image.shape[:2]:
            raise ValueError("regions painted by hand must have the size of the picture")

    @property
    def size(self) -> float:
        """Size of the face in pixels, see `face_size`."""
        return face_size(self.landmarks)

    def within(self, size: float) -> Exemplar:
        """The exemplar with a face of at most ``size`` pixels (`face_size`): reduced, or itself."""
        factor = size / self.size
        if factor >= 1:
            return self
        height, width = self.image.shape[:2]
        shape = max(round(factor * width), 1), max(round(factor * height), 1)

        def small(plane: Array) -> Array:
            return np.asarray(Image.fromarray(plane).resize(shape, Image.Resampling.BOX))

        return replace(self, image=small(self.image), opened=None,
                       mask=None if self.mask is None else small(self.mask),
                       hair=None if self.hair is None else small(self.hair),
                       bared=None if self.bared is None else small(self.bared),
                       hat=None if self.hat is None else small(self.hat),
                       covered=None if self.covered is None else self.covered.within(size),
                       by_hand=None if self.by_hand is None else np.asarray(Image.fromarray(
                           self.by_hand).resize(shape, Image.Resampling.NEAREST)),
                       landmarks=self.landmarks * np.divide(shape, (width, height)))

    def pose(self) -> FacePose:
        """How its face is turned (`face_pose`), kept in the user's cache."""
        def find() -> dict[str, Array]:
            pose = face.face_pose(self.landmarks)
            return {"rotation": pose.rotation, "shift": pose.shift,
                    "numbers": np.array([pose.scale, pose.residual])}

        kept = kept_arrays("poses", key_of(__name__, self.landmarks), find)
        scale, residual = kept["numbers"].tolist()
        return FacePose(kept["rotation"], scale, kept["shift"], residual)

    def regions(self) -> Regions:
        """Where its person and hair are: `find_regions`, and what was painted over by hand."""
        found = self._found_regions()
        if self.by_hand is None:
            return found
        person = np.where(self.by_hand == 0, found.person, np.float32(1))
        person[self.by_hand == BY_HAND.index("background")] = 0
        known = np.zeros_like(person) if found.hair is None else found.hair
        hair = np.where(self.by_hand == 0, known, np.float32(0))
        hair[self.by_hand == BY_HAND.index("hair")] = 1
        return Regions(self.landmarks, person, None if found.hair is None and not hair.any()
                       else hair)

    def _found_regions(self) -> Regions:
        """Where its person and hair are, found.

        What the segmentation networks see in a picture takes seconds to find, most of them to load
        the networks: it is kept in the user's cache.
        """
        if self.hair is not None and self.mask is not None:
            return Regions(self.landmarks, self.mask, np.minimum(self.hair, self.mask))
        if self.opened is not None:
            known = self.opened.regions()
            return Regions(self.landmarks, known.person, known.hair)
        networks = models.in_use(["person-segmentation", "hair-segmentation"])
        if not networks:
            return find_regions(self.image, self.landmarks, self.mask)

        def find() -> dict[str, Array]:
            found = find_regions(self.image, self.landmarks, self.mask)
            return {name: np.asarray(65535 * matte + 0.5, np.uint16)
                    for name, matte in (("person", found.person), ("hair", found.hair))
                    if matte is not None}

        key = key_of(__name__, "regions", self.image, self.landmarks, self.mask, networks)
        kept = kept_arrays("regions", key, find)
        # A file keeps rounded numbers: the first run continues with the numbers that the next one
        # reads.
        mattes = {name: matte.astype(np.float32) / np.float32(65535)
                  for name, matte in kept.items()}
        return Regions(self.landmarks, mattes["person"], mattes.get("hair"))

    @staticmethod
    def load(style: str | Path, landmarks: Floats | None = None) -> Exemplar:
        """Load an exemplar.

        Parameters
        ----------
        style : A picture; its landmarks lie beside it in ``NAME.landmarks.txt`` (one "x y" a
            line, 68 lines) or are detected: those of the largest face. A mask ``NAME.mask.png``
            (white = person) is used if there, and so are regions that were painted over by
            hand, ``NAME.regions.png`` (grey values as in `lfportrait.labels.BY_HAND`). Or the
            name of a built-in exemplar.
        landmarks : [68, 2], instead of those beside the picture or detected.

        Raises
        ------
        UserError : If there is no such picture or style, or it has no landmarks and no face is
            found.
        """
        path = Path(style)
        if not path.exists():
            return _built_in(str(style))
        picture = read_image(path)
        image = np.ascontiguousarray(picture[..., :3])
        points, faces = ((np.asarray(landmarks, np.float64), 1) if landmarks is not None
                         else _landmarks_beside(path, image))
        mask_path = path.with_suffix(".mask.png")
        mask = None
        if mask_path.exists():
            mask = read_mask(mask_path).astype(np.float32) / 255.0
            if mask.shape != image.shape[:2]:
                raise UserError(f"{mask_path} must have the size of {path}")
        elif picture.shape[2] == 4 and (picture[..., 3] < 255).any():
            mask = picture[..., 3].astype(np.float32) / 255.0
        return Exemplar(image, points, path.stem, mask, faces, by_hand=_by_hand(path, image))


def _by_hand(path: Path, image: UInt8) -> UInt8 | None:
    """The regions of a painting that were painted over by hand, from the file beside it."""
    beside = path.with_suffix(".regions.png")
    if not beside.exists():
        return None
    values = np.ascontiguousarray(read_image(beside)[..., 0])
    if values.shape != image.shape[:2]:
        raise UserError(f"{beside} must have the size of {path}")
    if values.max(initial=0) >= len(BY_HAND):
        raise UserError(f"{beside} must hold the grey values 0 to {len(BY_HAND) - 1} alone: "
                        f"{', '.join(BY_HAND)}")
    return values


def _built_in(name: str) -> Exemplar:
    """The built-in exemplar ``name``."""
    styles = provided_styles()
    if name in styles:
        exemplar: Exemplar = styles[name]()
        return exemplar
    raise UserError(f"{name!r} is neither a picture nor a built-in style; built-in styles: "
                    f"{', '.join(styles)}")


def _landmarks_beside(path: Path, image: UInt8) -> tuple[Float64, int]:
    """Landmarks from the file beside the picture, else of its largest face; and how many it has."""
    beside = path.with_suffix(".landmarks.txt")
    if beside.exists():
        return np.asarray(face.read_landmarks(beside), np.float64), 1

    def find() -> dict[str, Array]:
        return {"faces": np.array(face.detect_faces(image, thorough=False)).reshape(-1, 68, 2)}

    try:
        found = kept_arrays("faces", hash_of(image, face.detectors_key()), find)["faces"]
    except UserError as error:
        raise UserError(f"the style {path} has no {beside.name} beside it, and its landmarks "
                        f"can't be detected: {error}") from error
    if not len(found):
        raise UserError(f"no face found in the style {path}; give its position with `lfportrait "
                        f"styles add {path.name} --at X Y`, or put its 68 landmarks into "
                        f"{beside.name} beside it, one 'x y' a line")
    return found[0], len(found)
