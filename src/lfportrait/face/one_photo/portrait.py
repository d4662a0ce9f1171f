"""From photos to a capture with a fitted head, and from that to a field."""

from __future__ import annotations

import functools
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import models
from ...arrays import Bool, Float32, Float64
from ...capture import (
    CalibrateConfig,
    Camera,
    Capture,
    Photo,
    portrait_frame_from_landmarks,
    read_photos,
    refine_matte,
    some_depth,
)
from ...errors import UserError
from ...field import C0, ReconstructConfig, VoxelField, lattice_points
from ...measure import peak_memory_bytes
from ...progress import Progress, note, say
from ..detect import detect_faces, face_yaw
from ..head_fit import (
    Found,
    HeadFit,
    Picture,
    View,
    check_faces,
    deviations_of,
    ear_to_ear,
    fit_head,
    refit,
    unfit,
)
from ..head_prior import HeadPrior, generic_prior, head_prior
from ..landmarks import FIT, PORTRAIT_CONE
from ..segmentation import hair_mask, person_matte
from .beard import Beard, beard_of, beneath
from .beside import faces_of_people, in_one_piece, seen_from_near, sitter_alone
from .cloth import clothes_of
from .depth import Sensed, sensed_depth
from .headwear import headwear, skull_in
from .jaw import jaw_edge
from .lattice import Shell, shell_of
from .matches import found_again, of_one_moment
from .paint import Shot, painted
from .parts import (
    FUZZ,
    LEAST_HAIR,
    Parts,
    clean_colors,
    clean_hair,
    ground_in_blur,
    ground_in_hair,
    parts_of,
    signed_distance,
)
from .piece import METRES
from .samples import MeshSamples, depth_maps
from .skin import clothes, not_skin, open_mouth
from .solid import WORN, solid_of
from .warp import warped_together
from .wires import Wires, wires_of, without_wires

ALIKE, ABOUT_FRONTAL = 0.1, 0.3
"""Faces are turned alike within the first (`face_yaw`: some 5 degrees), up to the second."""
AGREED = 3  # How often several photos are compared and the head is fitted to what they share.
ROUGH = 96
"""Points to two units of the lattice of a head that is looked at before it is made in full."""
NEAR, FADE, MOST = 4.0, 0.3, 0.7
"""Hair is looked for from near, over so many widths of the face, which fades out over the second;
not where these are most of a picture."""
_GROUND = 153  # Grey level on which faces of matted photos are looked for.


Shown = str | Path | NDArray[np.uint8]


def head_from_photos(photos: Shown | Sequence[Shown], config: ReconstructConfig | None = None,
                     *, max_side: int = CalibrateConfig.max_side,
                     progress: Progress | None = None) -> tuple[VoxelField, Capture]:
    """A closed head from one photo of a face or a few: its field, and the capture it was made of.

    A statistical head is fitted to the face; hair and body follow the outline. The photos may be of
    different days. What many photos of one moment show is made by `lfportrait.calibrate` and
    `lfportrait.reconstruct` instead.

    Parameters
    ----------
    photos : A file, a folder, or a picture uint8 [H, W, 3 or 4] in sRGB (with straight alpha, it
        is the matte); or several of these. The most frontal one decides how the head looks, the
        largest of those that are turned alike.
    config : Its resolution counts, and nothing else.
    max_side : Files are reduced to this many pixels on their longer side; 0 keeps them.
    progress : Progress line.

    Returns
    -------
    field : Of degree 0, in the portrait frame. It can be looked at over `PORTRAIT_CONE` degrees
        in all; further out it is guessed.
    capture : The photos with mattes, landmarks and cameras, the decisive one first:
        `lfportrait.stylize` takes both.

    Raises
    ------
    UserError : If there is no photo or one can't be read, shows no face, several or a small one,
        or one turned too far; if no head fits; or if the networks for landmarks and mattes are
        missing.
    """
    given: Sequence[Any] = (
        [photos] if isinstance(photos, (str, Path, np.ndarray)) else list(photos))
    read = [photo for number, one in enumerate(given, 1)
            for photo in _read(one, f"photo {number}", max_side)]
    if not read:
        raise UserError("there is no photo to make a head of")
    capture, _ = portrait_capture(read, progress)
    field, _ = portrait_field(capture, config, progress)
    return field, capture


def _read(photo: Any, name: str, max_side: int) -> list[Photo]:
    """The photos of a file or a folder, or a picture as one."""
    if isinstance(photo, (str, Path)):
        return read_photos(Path(photo), max_side)
    picture = np.asarray(photo)
    if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] not in (3, 4):
        raise UserError(f"{name} must be uint8 [H, W, 3 or 4], not {picture.dtype} "
                        f"{list(picture.shape)}")
    return [Photo(name, picture)]


def portrait_capture(photos: list[Photo], progress: Progress | None = None, *,
                     prior: HeadPrior | None = None) -> tuple[Capture, dict[str, Any]]:
    """Fit a head to photos of one person.

    Parameters
    ----------
    photos : One, or a few of any days and places. With an alpha channel they need no networks
        for mattes. The most frontal one decides how the head looks, the largest of those that are
        turned alike.
    prior : Instead of the installed head.

    Returns
    -------
    capture, figures : With mattes, landmarks and the fit, in the portrait frame, the decisive
        photo first; and figures of the fit. Photos of other moments than the decisive one help to
        shape the head and are not in the capture; a warning and ``other_moments`` name them.

    Raises
    ------
    UserError : If no photo shows a face, or the only one shows several, or a small one; if even
        the most frontal one is turned too far, or no head fits it; or if networks are missing.
        Of several photos those that can't be used are left out, with a warning.
    """
    note(progress, "looking for the face")
    seen = _usable(photos)
    given, prior = prior is not None, prior or head_prior()
    if not given and not models.available("head"):
        say(progress, "no statistical head is installed: the generic one is used, which resembles "
                      "less; see `lfportrait models list`")
    note(progress, "fitting the head")
    fit = fit_head(prior, [one.picture for one in seen], [one.photo.name for one in seen])
    bad = unfit(fit, [one.picture for one in seen])
    if bad:
        for index in bad:
            _leave_out(seen[index].photo.name, "its face is not that of the others, or covered")
        seen = [one for index, one in enumerate(seen) if index not in bad]
        fit = fit_head(prior, [one.picture for one in seen], [one.photo.name for one in seen])
    covered = [one.cover(fit, index) for index, one in enumerate(seen)]
    if any(covered):  # the skull was drawn out to it
        fit = fit_head(prior, [one.picture for one in seen], [one.photo.name for one in seen])
    pictures, shown = [one.picture for one in seen], [one.shown for one in seen]
    fit, alike = _agreed(fit, pictures, shown)
    others = [one.photo.name for index, one in enumerate(seen) if index not in alike]
    fit, seen, used = fit.of(alike), [seen[one] for one in alike], len(seen)
    capture = _captured(fit, seen)
    figures = {**fit.figures(), "hair": [bool(np.any(one.picture.hair)) for one in seen]}
    if others:
        figures["other_moments"] = others
        warnings.warn(f"{', '.join(others)}: of another day or expression than "
                      f"{seen[0].photo.name}, or less sharp; that gives the colors, these help to "
                      "shape the head", stacklevel=2)
    say(progress, f"{fit.prior.name} fits {used} photo{'s' * (used > 1)}: landmarks to "
                  f"{fit.pixels[0]:.1f} pixels, the face turned by "
                  f"{abs(fit.views[0].angles['yaw']):.0f} degrees; it can be looked at over "
                  f"{PORTRAIT_CONE:.0f} degrees in all, further out it is guessed")
    return capture, figures


def _agreed(fit: HeadFit, pictures: list[Picture], shown: list[NDArray[np.uint8]],
            ) -> tuple[HeadFit, list[int]]:
    """A head fitted to what its photos share, too, and which of them are of the first's moment."""
    if len(pictures) == 1:
        return fit, [0]

    def further(fit: HeadFit, some: list[int]) -> HeadFit:
        found: list[list[Found]] = [[] for _ in pictures]
        again = found_again(fit.of(some), [pictures[one] for one in some],
                            [shown[one] for one in some])
        for one, places in zip(some, again, strict=True):
            found[one] = places
        return refit(fit, pictures, found)

    # Photos of one moment lie over each other well enough to be known after a round.
    closer = further(fit, list(range(len(pictures))))
    same = of_one_moment(closer, pictures, shown)
    alike = [index for index, one in enumerate(same) if one]
    begun = len(alike) == len(pictures)
    fit = closer if begun else fit
    for _ in range(AGREED - begun if len(alike) > 1 else 0):
        fit = further(fit, alike)
    return fit, alike


def _usable(photos: list[Photo]) -> list[_Seen]:
    """What is seen in the photos that show a face: the decisive one, then by how they are turned.

    It is the most frontal one, and of those that are turned alike the largest.
    """
    seen, first = [], None
    for photo in photos:
        try:
            seen.append(_Seen(photo))
        except UserError as error:
            if len(photos) == 1:
                raise
            first = first or error
            _leave_out(photo.name, str(error))
    if not seen:
        assert first is not None
        raise first
    seen.sort(key=lambda one: abs(face_yaw(one.picture.landmarks)))
    most = min(abs(face_yaw(seen[0].picture.landmarks)) + ALIKE, ABOUT_FRONTAL)
    decisive = max((one for one in seen if abs(face_yaw(one.picture.landmarks)) <= most),
                   key=lambda one: ear_to_ear(one.picture.landmarks), default=seen[0])
    return [decisive, *(one for one in seen if one is not decisive)]


def _leave_out(name: str, why: str) -> None:
    warnings.warn(f"{name} is left out: {why}", stacklevel=4)


class _Seen:
    """What is seen of a face in one photo."""

    def __init__(self, photo: Photo) -> None:
        self.photo = photo
        self.image = np.ascontiguousarray(photo.image[..., :3])
        alpha = photo.image[..., 3] if photo.image.shape[2] == 4 else None
        shown, given = self.image, None
        if alpha is not None and alpha.min() < 255:
            share = alpha[..., None].astype(np.float32) / np.float32(255)
            shown = np.rint(self.image * share + _GROUND * (1 - share)).astype(np.uint8)
            given = np.asarray(share[..., 0], np.float32)
        soft = person_matte(shown) if given is None else given
        faces = faces_of_people(detect_faces(shown), soft)
        landmarks = check_faces(faces, photo.name)
        self.given = given is not None
        self.matte = _matte_of(shown, soft, faces, photo.name) if given is None else given
        self.shown = shown
        hair = _hair_of(shown, self.matte, landmarks)
        self.beard = beard_of(shown, self.matte, landmarks, hair)
        self.picture = _pictured(shown, self.matte, hair, landmarks, photo.focal, self.beard)
        self.skull: tuple[Float64, Float64] | None = None

    def cover(self, fit: HeadFit, view: int) -> bool:
        """Whether something covers the head; it counts as hair from then on."""
        picture, skull = self.picture, skull_in(fit, view)
        assert picture.hair is not None
        worn = headwear(self.shown, self.matte, picture.hair, picture.landmarks, skull, self.given)
        if worn is None:
            return False
        self.skull = skull
        self.picture = _pictured(self.shown, self.matte, picture.hair, picture.landmarks,
                                 picture.focal, self.beard, worn)
        return True


def _knows_hair() -> bool:
    """Whether a network that sees hair is at hand."""
    return models.available("hair-segmentation") or models.available("multiclass-segmentation")


def _matte_of(image: NDArray[np.uint8], soft: Float32, faces: list[Float64], name: str) -> Float32:
    """Where a photo shows its sitter, float32 [H, W], whose face is the first; ``soft``: people."""
    if _knows_hair():
        hair = hair_mask(image)
        soft = seen_from_near(image, soft, hair, faces[0])
        alone = sitter_alone(image, soft, hair, faces)
        if alone is not None:
            soft = alone
            warnings.warn(f"{name} shows other people, too: they are cut away; look at the "
                          "outline, or take a photo of one person", stacklevel=5)
    return in_one_piece(np.asarray(refine_matte(image, soft), np.float32), faces[0])


def _hair_of(image: NDArray[np.uint8], matte: NDArray[np.floating], landmarks: Float64) -> Float32:
    """Where a photo shows hair, float32 [H, W]; by the network, else all above the brows."""
    if _knows_hair():
        return clean_hair(image, _hair_seen(image, landmarks), matte, landmarks)
    rows = np.arange(matte.shape[0])[:, None]
    high = landmarks[17:27, 1].min() - 0.45 * (landmarks[8, 1] - landmarks[27, 1])
    return np.asarray((matte > 0.5) & (rows < high), np.float32)


def _hair_seen(image: NDArray[np.uint8], landmarks: Float64) -> Float32:
    """Hair as the network sees it, float32 [H, W], around the head from near.

    In a picture of half a person a strand beside an ear is a pixel or two wide to it.
    """
    whole = hair_mask(image)
    size, width = np.array(image.shape[1::-1]), ear_to_ear(landmarks)
    reach = 0.5 * NEAR * width
    low = np.clip(landmarks[27] - reach, 0, size).astype(int)
    high = np.clip(landmarks[27] + reach, 0, size).astype(int)
    if not (high > low).all() or (high - low).prod() > MOST * size.prod():
        return whole
    place = tuple(slice(one, two) for one, two in zip(low[::-1], high[::-1], strict=True))
    near = hair_mask(np.ascontiguousarray(image[place]))
    # Towards its edges, where the picture goes on, the whole says more and more.
    away = []
    for one, two, end in zip(low, high, size, strict=True):
        steps, far = np.arange(two - one), np.full(two - one, size.max())
        away.append(np.minimum(steps if one else far, steps[::-1] if two < end else far))
    share = np.clip(np.minimum(away[0], away[1][:, None]) / (FADE * width), 0, 1)
    whole[place] += share.astype(np.float32) * (near - whole[place])
    return whole


def _pictured(image: NDArray[np.uint8], matte: Float32, hair: Float32, landmarks: Float64,
              focal: float | None, beard: Beard | None, worn: Bool | None = None) -> Picture:
    """A photo as the fit takes it; what is ``worn`` on the head is hair, but no beard is."""
    if worn is not None:
        bare = worn if beard is None else worn & (beard.whole <= 0.5)
        hair = np.maximum(hair, bare.astype(np.float32))
    hidden = clothes(image, hair, landmarks)
    if beard is not None:  # it hides the head's outline, too
        hidden = hidden | (beard.whole > 0.5)
    jaw = jaw_edge(image, landmarks) if beard is None else None
    return Picture(matte.shape[::-1], landmarks, focal, signed_distance(matte), hair, hidden, jaw)


def _captured(fit: HeadFit, seen: list[_Seen]) -> Capture:
    """The capture of fitted photos; the world is the first one's head."""
    base = fit.views[0]
    vertices = _laid_over(fit, [one.picture for one in seen], [one.shown for one in seen])
    # Landmarks lie where detectors see them, and as deep as they would be triangulated.
    points = vertices[fit.prior.landmarks].copy()
    if fit.prior.lean is not None:
        eyes = float(np.linalg.norm(points[45] - points[36]))
        points[:, 2] += eyes * fit.prior.lean[:, 2] * base.rotation[2, 2]
    points[:, :2] = (seen[0].picture.landmarks - base.center) / base.focal * points[:, 2:]
    poses = []
    for view in fit.views:
        pose = np.eye(4)  # of this camera in the first one's frame
        pose[:3, :3] = base.rotation @ view.rotation.T
        pose[:3, 3] = base.shift - pose[:3, :3] @ view.shift
        poses.append(pose)
    sizes = np.array([one.picture.size for one in seen])
    cameras = Camera(np.stack(poses), np.array([[view.focal] * 2 for view in fit.views]),
                     np.array([view.center for view in fit.views]), sizes[:, 0], sizes[:, 1])
    known = {"model": fit.prior.name, "identity": fit.identity.tolist(),
             "views": [{"rotation": view.rotation.tolist(), "shift": view.shift.tolist(),
                        "focal": view.focal, "center": view.center.tolist(),
                        "expression": view.expression.tolist(),
                        "landmarks": one.picture.landmarks.tolist(), "cut_out": one.given,
                        "skull": None if one.skull is None else [p.tolist() for p in one.skull]}
                       for view, one in zip(fit.views, seen, strict=True)]}
    capture = Capture(
        cameras, [one.image for one in seen],
        [np.rint(255 * np.clip(one.matte, 0, 1)).astype(np.uint8) for one in seen],
        [one.photo.name for one in seen], np.zeros(len(seen), bool), np.eye(4), points,
        {FIT: known, "mattes": "given" if all(one.given for one in seen) else "network"},
        some_depth([one.photo.depth for one in seen]))
    return capture.reframed(portrait_frame_from_landmarks(points, cameras))


def _laid_over(fit: HeadFit, pictures: list[Picture], shown: list[NDArray[np.uint8]]) -> Float64:
    """The head laid over its photos, float64 [N, 3] in the first camera's frame, metres."""
    return warped_together(fit, pictures, found_again(fit, pictures, shown))


def portrait_field(capture: Capture, config: ReconstructConfig | None = None,
                   progress: Progress | None = None, *,
                   look: Callable[[Callable[[], VoxelField]], None] | None = None,
                   ) -> tuple[VoxelField, dict[str, Any]]:
    """The field of a head that was fitted to photos.

    Parameters
    ----------
    capture : Of `portrait_capture`.
    config : Its resolution counts, and nothing else.
    progress : Progress line. It is shown the head on a coarse lattice before the fine one is
        filled.
    look : Is called then, too, with what gives that head; what it raises ends this.

    Returns
    -------
    field, figures : Of degree 0, in the portrait frame; ``voxels``, ``resolution``, and the
        angle over which it can be looked at as ``geometry.span_degrees``.

    Raises
    ------
    UserError : If the head that was fitted is not installed any more.
    """
    begun = time.perf_counter()
    config = config or ReconstructConfig()
    points = config.resolution or min(lattice_points(capture.cameras.pixel), config.max_resolution)

    fit, views = _kept_fit(capture), range(len(capture))
    assert capture.landmarks is not None
    looks = [_looked_at(capture, view) for view in views]
    pictures, camera = [picture for picture, _ in looks], capture.cameras[0]
    picture, beard = looks[0]
    note(progress, "laying the head over its photo")
    local = _laid_over(fit, pictures, [_shown(capture, view) for view in views])
    # Metres in the first camera's frame -> the portrait frame.
    vertices = local @ capture.frame[:3, :3].T + capture.frame[:3, 3]
    assert picture.hair is not None and capture.alphas is not None
    matte = capture.alphas[0].astype(np.float32) / 255
    parts = parts_of(camera, matte, picture.hair, float(np.linalg.norm(camera.position[0])),
                     vertices, None if beard is None else beard.below)
    samples = MeshSamples.of(vertices, fit.prior.outer, fit.prior.rest)
    note(progress, "hair and body from the outline")
    sensed = _sensed(capture, parts, samples, progress)
    wires, images = _bare(capture, fit, pictures, local, samples)
    shots = [_shot(capture, view, image, *looked, samples)
             for view, image, looked in zip(views, images, looks, strict=True)]
    worn = shots[0].clothes
    solid = solid_of(parts, samples, sensed,
                     None if worn is None else parts.of_photo(worn, camera) > 0.5)
    bald = _bald(picture, matte, _shown(capture, 0))
    seconds = 0.0
    if points > ROUGH:
        looked = time.perf_counter()
        rough = functools.cache(
            lambda: _colored(capture, shell_of(solid, ROUGH, wires), shots, wires, bald))
        if progress is not None:
            progress.show(rough, at_once=True)
        if look is not None:
            look(rough)
        seconds = time.perf_counter() - looked
    note(progress, "lattice")
    shell = shell_of(solid, points, wires)
    note(progress, "colors")
    field = _colored(capture, shell, shots, wires, bald)
    figures = {"voxels": len(field.density), "resolution": points, "device": "cpu",
               "train": {"rays": 0, "views": len(capture), "rays_per_second": 0.0},
               "geometry": {"span_degrees": PORTRAIT_CONE}, "head": fit.figures(),
               "peak_memory_bytes": peak_memory_bytes(),
               "seconds": {"train": round(time.perf_counter() - begun - seconds, 3), "test": 0.0}}
    if sensed is not None:
        figures["depth"] = {"off_mm": round(1000 * METRES * sensed.off, 1)}
    return field, figures


def _shot(capture: Capture, view: int, image: NDArray[np.uint8], picture: Picture,
          beard: Beard | None, samples: MeshSamples) -> Shot:
    """A photo that colors the head; ``image`` is it without spectacles."""
    assert capture.alphas is not None
    hair, fuzz = picture.hair, None
    camera, matte = capture.cameras[view], capture.alphas[view] / np.float32(255)
    unit = float(camera.focal[0, 0]) / float(np.linalg.norm(camera.position[0]))
    if not _cut_out(capture, view):
        fuzz = ground_in_blur(image, matte, hair, unit)
        if hair is not None:
            fuzz |= ground_in_hair(image, matte, hair, FUZZ * unit)
    colors = clean_colors(image, matte, fuzz)
    below = None if beard is None else beneath(beard.below, unit)
    whole, worn = None if beard is None else beard.whole, None
    if _knows_hair():
        worn = clothes_of(image, colors, matte, hair, whole, picture.landmarks, camera, samples)
    other = not_skin(colors, hair, picture.landmarks, camera, samples, worn)
    return Shot.of(camera, colors, hair, other, whole, below,
                   open_mouth(picture.landmarks, matte.shape), worn)


def _bare(capture: Capture, fit: HeadFit, pictures: list[Picture], local: Float64,
          samples: MeshSamples) -> tuple[Wires | None, list[NDArray[np.uint8]]]:
    """The spectacles that the first photo shows, and the photos without any."""
    wires, images = None, []
    for view, picture in enumerate(pictures):
        shown = bare = _shown(capture, view)
        if view:
            bare = without_wires(shown, picture.landmarks)
        else:
            found = wires_of(shown, picture.landmarks, fit.prior, fit.views[0], local,
                             capture.frame, samples, picture.hair)
            if found is not None:
                wires, bare = found
        same = (bare == shown).all(axis=-1, keepdims=True)
        images.append(np.where(same, capture.images[view], bare))
    return wires, images


def _bald(picture: Picture, matte: NDArray[np.floating], shown: NDArray[np.uint8]) -> bool:
    """Whether a photo shows a whole head, and the network no hair on it, like skin or not."""
    if np.any(picture.hair) or not _knows_hair():
        return False
    low, high = np.clip(picture.landmarks[[0, 16], 0].astype(int), 0, matte.shape[1])
    cut_off = bool((matte[0, min(low, high):max(low, high)] > 0.5).any())
    hair = (_hair_seen(shown, picture.landmarks) > 0.5) & (matte > 0.5)
    return not cut_off and hair.sum() < LEAST_HAIR * ear_to_ear(picture.landmarks) ** 2


def _colored(capture: Capture, shell: Shell, shots: list[Shot], wires: Wires | None, bald: bool,
             ) -> VoxelField:
    """A shell in its colors, as a field; ``bald``: of a head that is known to have no hair."""
    sh, hair, clothes = painted(shell, shots)
    if wires is not None:
        worn = shell.owner == WORN
        sh[worn, :, 0] = (wires.colors_at(shell.points[worn]) - 0.5) / C0
    field = shell.field(sh)
    field.frame, field.cone = capture.frame, PORTRAIT_CONE
    if _knows_hair():
        hair[shell.owner == WORN] = 0
        if bald or hair.any():
            field.hair = hair  # else it would be a guess by place
        field.clothes = clothes
    return field


def _sensed(capture: Capture, parts: Parts, samples: MeshSamples, progress: Progress | None,
            ) -> Sensed | None:
    """The depth that the first photo keeps, where it has one that fits the head."""
    depth = capture.depths[0] if capture.depths is not None else None
    if depth is None:
        return None
    found = sensed_depth(depth, capture.cameras[0], parts, depth_maps(samples, parts)[0])
    say(progress, "the depth that the photo keeps does not fit the face and is not used"
                  if found is None else
                  "hair and shoulders follow the depth that the photo keeps; in the face it is "
                  f"{1000 * METRES * found.off:.0f} mm off")
    return found


def _kept_fit(capture: Capture) -> HeadFit:
    """The fit that a capture was saved with."""
    kept = capture.figures[FIT]
    prior: HeadPrior = head_prior()
    if kept["model"] != prior.name:
        prior = generic_prior()
    if kept["model"] != prior.name:
        raise UserError(f"the photo was fitted with {kept['model']}, which is not installed here; "
                        "see `lfportrait models list`")
    views = [View(np.array(one["rotation"]), np.array(one["shift"]), float(one["focal"]),
                  np.array(one["center"]), np.array(one["expression"])) for one in kept["views"]]
    identity = np.array(kept["identity"])
    return HeadFit(prior, identity, views, [0.0] * len(views),
                   deviations_of(identity))


def _cut_out(capture: Capture, view: int) -> bool:
    """Whether a photo came with its matte: beyond that it shows nothing."""
    kept = capture.figures[FIT]["views"][view]
    return bool(kept.get("cut_out", capture.figures.get("mattes") == "given"))


def _shown(capture: Capture, view: int) -> NDArray[np.uint8]:
    """A photo of a saved capture as networks see it: on grey where its matte was given."""
    assert capture.alphas is not None
    if not _cut_out(capture, view):
        return np.ascontiguousarray(capture.images[view])
    share = capture.alphas[view][..., None].astype(np.float32) / np.float32(255)
    return np.rint(capture.images[view] * share + _GROUND * (1 - share)).astype(np.uint8)


def _looked_at(capture: Capture, view: int) -> tuple[Picture, Beard | None]:
    """A photo of a saved capture as the fit takes it, and its beard."""
    assert capture.alphas is not None
    camera, known = capture.cameras[view], capture.figures[FIT]["views"][view]
    kept, skull = known.get("landmarks"), known.get("skull")
    landmarks = (camera.project(np.asarray(capture.landmarks, np.float64))[0][0] if kept is None
                 else np.array(kept))
    matte = np.asarray(capture.alphas[view] / np.float32(255), np.float32)
    shown = _shown(capture, view)
    hair, worn = _hair_of(shown, matte, landmarks), None
    if skull is not None:
        worn = headwear(shown, matte, hair, landmarks, (np.array(skull[0]), np.array(skull[1])),
                        _cut_out(capture, view))
    beard = beard_of(shown, matte, landmarks, hair)
    return _pictured(shown, matte, hair, landmarks, float(camera.focal[0, 0]), beard, worn), beard
