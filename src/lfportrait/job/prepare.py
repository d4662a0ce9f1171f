"""Prepare a capture for a portrait from photos, a video or a calibrated data set.

Cameras where there are none, the face's landmarks in space, mattes of the person (or object), and
cameras that follow a head that moved: each only where it is not known already.

For stylisation, the contents of a calibrated data set are kept in the user's cache, keyed by the
names, sizes and dates of its files (`capture_of_face`): cameras and landmarks at once, pictures on
access. A preview need not decode a hundred photos to know where they were taken from.
"""

import functools
import json
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import capture as captures
from .. import models
from ..arrays import Array, Float32, Float64, UInt8
from ..cache import kept_arrays, key_of
from ..capture import (
    CalibrateConfig,
    Camera,
    Capture,
    LatePictures,
    Photo,
    PhotosError,
    calibrate,
    read_source,
    refine_matte,
)
from ..color import to_uint8
from ..errors import UserError
from ..files import file_state
from ..media.depth import DepthMap
from ..media.folders import files_below
from ..progress import Progress, note, say
from ..simd.threads import side_by_side
from .made_from import NotTogether, fit_to_face, head_way, reason_to_fit
from .photo_check import problem_sheet

_OUTLIERS = 0.6  # Share of a face's landmarks that do not fit cameras which are wrong.
_PLACED = 0.8  # Share of placed photos below which cameras are estimated from the face.
_FAR = 10.0  # Pixels by which a head's features are off, by cameras that are of something else.


def find_face(capture: Capture, progress: Progress | None = None, *,
              reframe: bool = False) -> Capture:
    """A calibrated capture with the landmarks of its face, if it shows one.

    It is turned into the frame of its face if ``reframe`` says so; else its frame is kept. With the
    landmarks a reconstruction closes the back of a head and trims its frayed end. Nothing is
    downloaded for that: without the network for landmarks the capture stays as it is, and a warning
    says so.
    """
    if capture.landmarks is not None:
        points = np.asarray(capture.landmarks, np.float64)
        return _in_portrait_frame(capture, points) if reframe else capture
    if reframe:
        found = _with_landmarks(capture, False, True, progress)[0]
        if found.landmarks is None:
            raise UserError("no face was found in the photos, so the portrait frame is not known; "
                            "leave out --portrait-frame")
        return found
    if models.missing(["face-landmarker"]):
        warnings.warn("no face detection: the head is neither closed behind nor trimmed below; run "
                      "`lfportrait models fetch face-landmarker` first", stacklevel=2)
        return capture
    return _with_landmarks(capture, False, False, progress)[0]


def _with_landmarks(capture: Capture, fresh: bool, reframe: bool, progress: Progress | None,
                    ) -> tuple[Capture, dict[str, Any]]:
    """The capture with the face's landmarks, and in its frame if ``reframe`` says so; figures.

    Those of a data set that was calibrated elsewhere (not ``fresh``) are kept in the user's cache,
    as each command looks for them.
    """
    from ..face import landmarks_of_capture

    points, figures = (landmarks_of_capture if fresh else _kept_landmarks)(capture, progress)
    if points is None:
        return capture, figures
    if reframe:
        return _in_portrait_frame(capture, points), figures
    return replace(capture, landmarks=points), figures


def _in_portrait_frame(capture: Capture, points: Float64) -> Capture:
    """The capture with a face's landmarks [68, 3], turned into its frame."""
    similarity = captures.portrait_frame_from_landmarks(points, capture.cameras)
    if np.allclose(similarity, np.eye(4), atol=1e-3):
        return replace(capture, landmarks=points)
    points = points @ similarity[:3, :3].T + similarity[:3, 3]
    return replace(capture.reframed(similarity), landmarks=points)


def _kept_landmarks(capture: Capture, progress: Progress | None,
                    ) -> tuple[Float64 | None, dict[str, Any]]:
    from ..face import detectors_key, landmarks_of_capture

    def find() -> dict[str, Array]:
        points, figures = landmarks_of_capture(capture, progress)
        return {"figures": np.array(json.dumps(figures)),
                **({} if points is None else {"points": points})}

    cameras = capture.cameras
    key = key_of(__name__, capture.images, capture.alphas, cameras.pose, cameras.focal,
                 cameras.center, detectors_key())
    kept = kept_arrays("landmarks", key, find)
    return kept.get("points"), json.loads(str(kept["figures"]))


def _following(capture: Capture, soft: list[Float32], config: CalibrateConfig,
               progress: Progress | None) -> tuple[Capture, list[Float32], dict[str, Any]]:
    """The capture and its rough mattes, its cameras following a head that moved; figures."""
    note(progress, "checking whether the head moved")
    followed, motion = captures.follow_head(capture, soft, config.seed,
                                            None if progress is None else progress.say)
    figures = {"moved": motion.moved, "followed": bool(motion.followed),
               "pixels": motion.pixels if np.isfinite(motion.pixels) else None,
               "pixels_after": motion.after if np.isfinite(motion.after) else None,
               "degrees": motion.degrees,
               "left_out": [name for name in capture.names if name not in followed.names]}
    if not motion.followed:
        return capture, soft, figures
    return followed, [soft[view] for view in motion.followed], figures


def _tell_left_out(figures: dict[str, Any], photos: Path, config: CalibrateConfig,
                   sheet: Path | None) -> None:
    """Warn of the photos that following the head leaves out, and mark them, too."""
    left_out = figures["head_motion"]["left_out"]
    if not left_out:
        return
    where = ""
    if sheet is not None:
        marks = _marks(figures["calibration"]) | dict.fromkeys(left_out, "head not seen")
        problem_sheet(photos, marks, sheet, config.video_frames)
        where = f"; which: {sheet}"
    warnings.warn(f"{len(left_out)} photos show too little of the head, which moved, and are left "
                  f"out: {', '.join(left_out)}{where}", stacklevel=2)


def _marks(calibration: dict[str, Any]) -> dict[str, str]:
    """What is wrong with the photos that calibration leaves out, by their names."""
    return (dict.fromkeys(calibration["blurred"], "blurred")
            | dict.fromkeys(calibration["left_out"], "not placed"))


def _placed_photos(photos: Path, config: CalibrateConfig, few: bool, progress: Progress | None,
                   sheet: Path | None, read: list[Photo] | None,
                   ) -> tuple[Capture, dict[str, Any]]:
    """Photos with the cameras that structure from motion finds, or else the face; figures."""
    figures: dict[str, Any] = {"source": "photos"}
    try:
        capture = (_few_placed(photos, config, progress) if few
                   else calibrate(photos, config, progress, read=read))
    except PhotosError as error:
        found = _by_the_face(photos, config, progress, figures, 3)
        if found is not None:
            return found, figures
        if sheet is not None:
            problem_sheet(photos, error.marks, sheet, config.video_frames)
            raise UserError(f"{error}; see {sheet}") from error
        raise
    figures["calibration"] = capture.figures
    marks = _marks(capture.figures)
    if marks and sheet is not None:
        problem_sheet(photos, marks, sheet, config.video_frames)
        warnings.warn(f"the photos that are left out: see {sheet}", stacklevel=2)
    return capture, figures


def _tried(capture: Capture) -> int:
    """How many photos calibration tried to place, or left out as blurred."""
    return int(capture.figures.get("photos", 0)) - len(capture.figures.get("spare", ()))


def _few_placed(photos: Path, config: CalibrateConfig, progress: Progress | None) -> Capture:
    """A few photos with the cameras that structure from motion finds; raises `NotTogether`."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            capture = calibrate(photos, config, progress)
        except UserError as error:
            raise NotTogether(error) from error
    count = _tried(capture)
    if len(capture) < _PLACED * count:
        raise NotTogether(UserError(f"only {len(capture)} of the {count} photos in {photos} could "
                                    "be placed together"))
    for one in caught:  # of photos that are left out, which a fitted head need not be
        warnings.warn(str(one.message), stacklevel=3)
    return capture


def _by_the_face(photos: Path, config: CalibrateConfig, progress: Progress | None,
                 figures: dict[str, Any], least: float) -> Capture | None:
    """A capture with landmarks and cameras from the face; None below ``least`` photos."""
    from ..face import capture_from_faces

    if models.missing(["face-landmarker", "person-segmentation"]):
        return None
    say(progress, "the background of the photos is inconsistent: the cameras are estimated from "
                  "the face and the head alone")
    capture = capture_from_faces(photos, config, progress)
    if capture is None or len(capture) < max(least, 3):
        return None
    capture, how = _with_landmarks(capture, True, True, progress)
    if capture.landmarks is None:
        return None
    figures["calibration"], figures["landmarks"] = capture.figures, how
    say(progress, f"{len(capture)} of {capture.figures['photos']} photos are placed by the face "
                  "and the head; these cameras are used")
    left_out = capture.figures["left_out"]
    if left_out:
        warnings.warn(f"{len(left_out)} photos could not be placed by the face and are left out: "
                      f"{', '.join(left_out[:5])}{', ...' if len(left_out) > 5 else ''}",
                      stacklevel=2)
    return capture


def _wrong_cameras(photos: Path) -> UserError:
    """What is said of a few photos with cameras of something else than the head."""
    return UserError(f"the photos in {photos} are placed by something else than the head")


def _least_by_face(capture: Capture, landmarks: dict[str, Any], need_face: bool) -> float | None:
    """Photos that the face must place to do better than these cameras; None: these will do."""
    if "outliers" in landmarks:
        wrong = landmarks["outliers"] > _OUTLIERS
    else:
        wrong = need_face or landmarks.get("views", 0) > 0
    if wrong:
        return 0.5 * len(capture)
    few = len(capture) < _PLACED * _tried(capture)
    return len(capture) + 1 if few else None


def prepare_capture(photos: Path, config: CalibrateConfig, *, keep_background: bool = False,
                    need_face: bool = False, made_from: str = "auto",
                    progress: Progress | None = None, sheet: Path | None = None,
                    ) -> tuple[Capture, dict[str, Any]]:
    """Photos, a video or a calibrated data set -> a capture in the portrait frame.

    Finds the cameras where there are none, the landmarks of the face in 3D and, for photos without
    an alpha channel, the person's mattes.

    Parameters
    ----------
    photos : Folder, video file or data set.
    keep_background : Keep the room behind the person.
    need_face : Raise `UserError` where no face is found, instead of going on without landmarks;
        turn data sets that were calibrated elsewhere into the frame of their face, too.
    made_from : ``"face"``: a head is fitted to the face; ``"photos"``: cameras by what the
        photos share; ``"auto"``: as above, and a line says which.
    sheet : File for a contact sheet, written where photos are left out or can't be placed:
        which.

    Returns
    -------
    capture, figures : The capture and the run's figures: views, how they were calibrated,
        landmark errors.
    """
    photos = Path(photos)
    if not photos.exists():
        raise UserError(f"there is no folder or file {photos}; name the folder of your photos")
    way = head_way(photos, made_from)
    if way == "face":
        return fit_to_face(photos, config, progress, keep_background=keep_background)
    read: list[Photo] | None = None
    if (way == "photos" and made_from == "auto" and not keep_background
            and not captures.is_calibrated(photos)):
        note(progress, "reading photos")
        read = read_source(photos, config.max_side, config.video_frames)
        reason = reason_to_fit(read, progress)
        if reason:
            try:
                return fit_to_face(photos, config, progress, reason=reason, read=read)
            except UserError as error:
                say(progress, f"{error}; so all pictures are used (--from photos)")
    try:
        capture, figures = _shared(photos, config, keep_background, need_face, way == "either",
                                   progress, sheet, read)
    except NotTogether as found:
        try:
            return fit_to_face(photos, config, progress, why=str(found),
                               keep_background=keep_background)
        except UserError as error:
            text = f"{found.error}; nor can a head be fitted: {error}"
            if sheet is not None and isinstance(found.error, PhotosError):
                problem_sheet(photos, found.error.marks, sheet, config.video_frames)
                text += f"; see {sheet}"
            raise UserError(text) from error
    if way == "either":
        say(progress, f"{len(capture)} photos are placed together: the head is made from what they "
                      "share (--from photos; --from face fits one to the face)")
    return capture, figures


def _shared(photos: Path, config: CalibrateConfig, keep_background: bool, need_face: bool,
            few: bool, progress: Progress | None, sheet: Path | None,
            read: list[Photo] | None) -> tuple[Capture, dict[str, Any]]:
    """A capture by what photos, a video or a data set share; ``read`` as `calibrate` has it.

    Raises `NotTogether` if photos are ``few`` and the cameras of too many of them are not found, or
    are wrong.
    """
    if captures.is_calibrated(photos):
        capture = Capture.load(photos)
        figures: dict[str, Any] = {"source": "calibrated"}
        fresh = False
    else:
        capture, figures = _placed_photos(photos, config, few, progress, sheet, read)
        fresh = True
    least = None
    if capture.landmarks is None:
        # A portrait is shown upright and in the middle, whatever frame a data set has.
        capture, figures["landmarks"] = _with_landmarks(capture, fresh, fresh or need_face,
                                                        progress)
        least = _least_by_face(capture, figures["landmarks"], need_face) if fresh else None
        if least is not None and few:
            raise NotTogether(_wrong_cameras(photos))
        if least is not None:
            capture = _by_the_face(photos, config, progress, figures, least) or capture
        if capture.landmarks is None and need_face:
            raise UserError(f"no face was found in the photos of {photos}; a portrait needs a few "
                            "photos that show the face from the front, upright and in focus")
    elif need_face:
        capture = _in_portrait_frame(capture, np.asarray(capture.landmarks, np.float64))
    if capture.alphas is None and not keep_background:
        soft = rough_mattes(capture, progress)
        # Cameras that come from the face follow the head already.
        if fresh and "face" not in str(figures.get("calibration", {}).get("placed", "")):
            capture, soft, figures["head_motion"] = _following(capture, soft, config, progress)
            if figures["head_motion"]["followed"]:
                capture, figures["landmarks"] = _with_landmarks(capture, True, True, progress)
            elif few and (figures["head_motion"]["pixels"] or 0.0) > _FAR:
                raise NotTogether(_wrong_cameras(photos))
            elif least is None and (figures["head_motion"]["pixels"] or 0.0) > _FAR:
                other = _by_the_face(photos, config, progress, figures, 0.5 * len(capture))
                if other is not None:
                    capture, soft = other, rough_mattes(other, progress)
            _tell_left_out(figures, photos, config, sheet)
        capture, figures["mattes"] = cut_person(capture, progress, soft=soft)
    figures["views"] = len(capture)
    figures["held_out"] = int(capture.held_out.sum())
    return capture, figures


# A network that is right has most of its mattes overlap with their common solid by this much; one
# of which only few do is wrong.
_OVERLAP, _MOST, _FEWEST = 0.6, 0.8, 0.25
_NOBODY = 0.01  # share of all pixels below which the network sees nobody


def rough_mattes(capture: Capture, progress: Progress | None = None) -> list[Float32]:
    """A network's mattes of each photo separately, V times float32 [H, W] in [0, 1].

    Photos are in the portrait frame. Raises `UserError` if the network's weights are missing.
    """
    from ..face import person_matte

    soft = []
    for view, image in enumerate(capture.images):
        soft.append(person_matte(image, _up_in_image(capture, view)))
        note(progress, f"cutting out the person: {view + 1} of {len(capture)}")
    return soft


def cut_person(capture: Capture, progress: Progress | None = None,
               soft: list[Float32] | None = None) -> tuple[Capture, str]:
    """Cut the person out of every photo.

    A network's mattes where they agree: corrected by what other photos show behind the person
    (`lfportrait.field.geometry.clean_plates`), or else made consistent over the views and freed of
    what the photos' depth puts elsewhere, and sharpened along the photos' edges. Where they do not
    agree, as with a sculpture, the object that the cameras look at, cut out by its geometry
    (`lfportrait.field.geometry.mattes`). Raises `UserError` if the network's weights are missing.

    Parameters
    ----------
    capture : Photos without mattes, in the portrait frame.
    soft : What a network has said already (`rough_mattes`).

    Returns
    -------
    capture, how : The capture with mattes, or the same if nothing was found; ``"network"``,
        ``"geometry"`` or why there are none. The capture's figures contain the first two as
        ``mattes``.
    """
    from ..field.geometry import cut_out

    if soft is None:
        soft = rough_mattes(capture, progress)
    # A few views leave too much of space undecided.
    agree = (captures.matte_agreement(capture.cameras, soft) > _OVERLAP if len(capture) >= 6
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
    alphas = [to_uint8(matte) for matte in mattes]
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
    note(progress, "cutting out the person: edges")
    # Two at a time at the most: each photo's planes take a few hundred megabytes.
    views = range(len(capture))
    refined = side_by_side(lambda view: refine_matte(capture.images[view], soft[view]), views, 2)
    note(progress, "cutting out the person: votes of the views")
    agreed = captures.consistent_mattes(capture, refined)
    if sure and len(capture.training()) >= 6:
        agreed = trim(capture, agreed, progress)
    return side_by_side(lambda view: captures.refine_changes(capture.images[view], refined[view],
                                                             agreed[view]), views, 2)


def _up_in_image(capture: Capture, view: int) -> Float64:
    """The world's up direction in a picture, [2] (x right, y down), unit length."""
    up = capture.cameras.pose[view, :3, :3].T @ np.array([0.0, 1.0, 0.0])
    flat = up[:2]
    return np.asarray(flat / max(float(np.linalg.norm(flat)), 1e-9))


_CAMERA = ("pose", "focal", "center", "width", "height")


def capture_of_face(photos: Path) -> Capture:
    """Photos, a video or a calibrated data set as a capture with the landmarks of its face.

    It is `prepare_capture`'s, the room behind the person included; of a calibrated data set that
    was read before, with `LatePictures`.
    """
    if not photos.exists() or not captures.is_calibrated(photos):
        return _read(photos)
    read: list[Capture] = []

    def find() -> dict[str, Array]:
        read.append(_read(photos))
        return _told(read[0])

    kept = kept_arrays("captures", _key(photos), find)
    return read[0] if read else _late(photos, kept)


def _read(photos: Path) -> Capture:
    # Here: what calibrates photos is not needed for those that have cameras.
    from ..capture import CalibrateConfig

    return prepare_capture(photos, CalibrateConfig(), keep_background=True, need_face=True)[0]


def _key(photos: Path) -> str:
    """Hash of the data set's files, by name and state, and of what finds faces."""
    from ..face import detectors_key

    root = photos if photos.is_dir() else photos.parent
    try:
        files = sorted((str(path.relative_to(root)), file_state(path))
                       for path in files_below(root))
    except OSError as error:
        raise UserError(f"can't read {photos}: {error.strerror}") from error
    return key_of(__name__, str(photos.resolve()), files, detectors_key())


def _told(capture: Capture) -> dict[str, Array]:
    """All of a capture besides its pictures, as arrays."""
    assert capture.landmarks is not None
    return {**{name: getattr(capture.cameras, name) for name in _CAMERA},
            "names": np.array(capture.names), "held_out": capture.held_out,
            "frame": capture.frame, "landmarks": capture.landmarks,
            "figures": np.array(json.dumps(capture.figures)),
            "mattes": np.array(capture.alphas is not None),
            "depths": np.array(capture.depths is not None)}


def _late(photos: Path, stored: dict[str, Array]) -> Capture:
    """The capture that was read before, its pictures still to be decoded."""
    @functools.cache
    def again() -> Capture:
        return Capture.load(photos)

    def mattes() -> Sequence[UInt8]:
        found = again().alphas
        assert found is not None
        return found

    def depths() -> Sequence[DepthMap | None]:
        found = again().depths
        assert found is not None
        return found

    names = stored["names"].tolist()
    return Capture(
        Camera(*(stored[name] for name in _CAMERA)),
        LatePictures(len(names), lambda: again().images),
        LatePictures(len(names), mattes) if stored["mattes"] else None,
        names, stored["held_out"], stored["frame"], stored["landmarks"],
        json.loads(str(stored["figures"])),
        LatePictures(len(names), depths) if stored["depths"] else None)
