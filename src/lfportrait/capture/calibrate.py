"""Cameras from photos alone: structure from motion by COLMAP (through pycolmap).

SIFT features in every photo, matches between all pairs (neighbours only for long videos), then
incremental mapping and a last bundle adjustment with a robust loss, which forgives the few wrong
matches that survive. Photos of one size share one camera, as they nearly always come from one
phone; its focal length starts from what the camera noted in the file.

COLMAP works in a temporary folder, so that an interrupted run leaves nothing behind where results
go. Images are numbered in the order of their names, the random seeds are fixed and the mapper runs
on one thread: the same photos give the same cameras.
"""

from __future__ import annotations

import tempfile
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from numpy.typing import NDArray

from ..errors import UserError
from ..files import write_image
from ..progress import Progress
from .camera import Camera
from .capture import Capture
from .distortion import Lens
from .formats import assemble, lens_of
from .frame import portrait_frame_from_cameras
from .photos import Photo, is_video, read_photos
from .sharpness import blurred
from .video import read_video

__all__ = ["CalibrateConfig", "calibrate"]

_ADVICE = ("take 20 to 100 photos of a person who holds still, with small steps between them "
           "(each part of the scene in at least three photos), in focus")


@dataclass(frozen=True)
class CalibrateConfig:
    """Parameters of calibration."""

    features: int = 4096
    """Features (SIFT) in a photo at most."""
    matching: Literal["auto", "exhaustive", "sequential"] = "auto"
    """Which photos are compared: all pairs, or neighbours in the order of their names; auto: all
    pairs up to 200 photos."""
    camera_model: Literal["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV",
                          "OPENCV_FISHEYE"] = "RADIAL"
    """Lens model that is fitted."""
    shared_camera: bool = True
    """Photos of one size come from one camera with one focal length (no zooming)."""
    max_side: int = 1600
    """Photos are reduced to this many pixels on their longer side; 0 keeps them."""
    video_frames: int = 80
    """Frames taken from a video."""
    video_spacing: Literal["parallax", "time"] = "parallax"
    """Frames are taken where the picture has moved on by equal amounts, or at even time."""
    blur_threshold: float = 0.4
    """Photos with less than this part of their neighbours' fine detail, in any direction, are
    blurred and left out, a quarter of all at most; 0 keeps them."""
    holdout: int = 8
    """Every so many photos one is kept for testing the reconstruction; 0 uses all."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of the random sampling in matching and mapping (on the command line: ``--seed``)."""


def _plain_image(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture as features see it: transparent parts become flat grey."""
    if image.shape[2] == 3:
        return image
    alpha = image[..., 3:].astype(np.float32) / 255.0
    return (image[..., :3] * alpha + 128.0 * (1.0 - alpha) + 0.5).astype(np.uint8)


def _write_photos(photos: list[Photo], folder: Path, config: CalibrateConfig) -> dict[str, Photo]:
    """Lay the photos out for COLMAP, one subfolder a size (it shares cameras by folder)."""
    by_path = {}
    for photo in photos:
        height, width = photo.image.shape[:2]
        name = f"{width}x{height}/{Path(photo.name).stem}.png"
        write_image(folder / name, _plain_image(photo.image), compress_level=1)
        if photo.image.shape[2] == 4:
            # COLMAP looks for the mask of IMAGE under IMAGE.png.
            write_image(folder.with_name("masks") / f"{name}.png", photo.image[..., 3])
        by_path[name] = photo
    return dict(sorted(by_path.items()))


def _import(pycolmap: Any, database: Path, folder: Path, photos: dict[str, Photo],
            config: CalibrateConfig) -> tuple[Any, Any]:
    """Number the photos in their order and give each its camera; returns the reader's options."""
    options = pycolmap.ImageReaderOptions()
    options.camera_model = config.camera_model
    masks = folder.with_name("masks")
    if masks.is_dir():
        options.mask_path = masks
    mode = pycolmap.CameraMode.PER_FOLDER if config.shared_camera else pycolmap.CameraMode.PER_IMAGE
    pycolmap.Database.open(database).close()  # makes the file
    pycolmap.import_images(database, folder, mode, image_names=list(photos), options=options)
    with pycolmap.Database.open(database) as base:
        cameras = {camera.camera_id: camera for camera in base.read_all_cameras()}
        noted: dict[int, list[float]] = {}
        for image in base.read_all_images():
            focal = photos[image.name].focal
            if focal:
                noted.setdefault(image.camera_id, []).append(focal)
        for number, focals in noted.items():
            camera = cameras[number]
            for index in camera.focal_length_idxs():
                camera.params[index] = float(np.median(focals))
            camera.has_prior_focal_length = True
            base.update_camera(camera)
    return options, mode


def _match(pycolmap: Any, database: Path, count: int, config: CalibrateConfig) -> None:
    matching = pycolmap.FeatureMatchingOptions()
    matching.use_gpu = False
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = config.seed
    common = {"matching_options": matching, "verification_options": verification,
              "device": pycolmap.Device.cpu}
    exhaustive = config.matching == "exhaustive" or (config.matching == "auto" and count <= 200)
    if exhaustive:
        pycolmap.match_exhaustive(database, **common)
    else:
        pairing = pycolmap.SequentialPairingOptions()
        pairing.overlap = 12
        pairing.quadratic_overlap = True
        pycolmap.match_sequential(database, pairing_options=pairing, **common)


def _map(pycolmap: Any, database: Path, folder: Path, out: Path, config: CalibrateConfig,
         report: Any) -> Any:
    """The largest reconstruction, or None. Weaker starting pairs are tried where none is found."""
    for attempt, (inliers, angle) in enumerate(((100, 16.0), (50, 8.0), (30, 4.0))):
        options = pycolmap.IncrementalPipelineOptions()
        options.random_seed = config.seed
        options.mapper.random_seed = config.seed
        options.triangulation.random_seed = config.seed
        options.num_threads = 1
        options.min_model_size = 3
        options.extract_colors = False
        options.mapper.init_min_num_inliers = inliers
        options.mapper.init_min_tri_angle = angle
        place = out / str(attempt)
        place.mkdir(parents=True)
        models = pycolmap.incremental_mapping(database, folder, place, options=options,
                                              next_image_callback=report)
        if models:
            return max(models.values(), key=lambda model: model.num_reg_images())
    return None


def _refine(pycolmap: Any, model: Any) -> None:
    """Bundle adjustment with a Cauchy loss: large residuals are wrong matches, not information."""
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.max_num_iterations = 50
    scope = pycolmap.BundleAdjustmentConfig()
    for number, image in model.images.items():
        if image.has_pose:
            scope.add_image(number)
    scope.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    # pycolmap.bundle_adjustment does the same, but turns COLMAP's log on again.
    pycolmap.create_default_bundle_adjuster(options, scope, model).solve()
    model.update_point_3d_errors()


def _reconstruct(photos: list[Photo], config: CalibrateConfig, progress: Progress | None,
                 work: Path) -> tuple[dict[str, tuple[NDArray[np.float64], Lens]], dict[str, Any]]:
    """Pose (camera-to-world) and lens of every registered photo by its name, and figures."""
    import pycolmap

    def say(note: str) -> None:
        if progress is not None:
            progress.update(0, note)

    pycolmap.logging.minloglevel = pycolmap.logging.Level.FATAL.value
    pycolmap.set_random_seed(config.seed)
    folder, database = work / "photos", work / "database.db"
    by_path = _write_photos(photos, folder, config)
    reader, mode = _import(pycolmap, database, folder, by_path, config)
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.use_gpu = False
    extraction.sift.max_num_features = config.features
    names = list(by_path)
    for first in range(0, len(names), 4):
        say(f"features in photo {first + 1} of {len(names)}")
        pycolmap.extract_features(database, folder, image_names=names[first:first + 4],
                                  camera_mode=mode, reader_options=reader,
                                  extraction_options=extraction, device=pycolmap.Device.cpu)
    say("comparing photos")
    _match(pycolmap, database, len(names), config)
    registered = [2]

    def report() -> None:
        registered[0] += 1
        say(f"placing photo {min(registered[0], len(names))} of {len(names)}")

    model = _map(pycolmap, database, folder, work / "models", config, report)
    if model is None:
        return {}, {}
    say("refining the cameras")
    _refine(pycolmap, model)
    found = {}
    for image in model.images.values():
        if image.has_pose:
            camera = model.cameras[image.camera_id]
            pose = np.eye(4)
            pose[:3] = image.cam_from_world().inverse().matrix()
            found[by_path[image.name].name] = pose, lens_of(
                camera.model.name, camera.width, camera.height, camera.params)
    figures = {"points": int(model.num_points3D()),
               "reprojection_error_px": float(model.compute_mean_reprojection_error())}
    return found, figures


def calibrate(photos: str | Path, config: CalibrateConfig | None = None,
              progress: Progress | None = None) -> Capture:
    """Find the cameras of photos or of a video.

    Parameters
    ----------
    photos
        Folder of photos, or a video file.
    config
        Parameters.
    progress
        Progress line.

    Returns
    -------
    capture
        The photos that could be placed, undistorted, in the portrait frame guessed from the cameras
        (`portrait_frame_from_cameras`; `portrait_frame_from_landmarks` is better once the face is
        known). ``capture.figures``: ``photos``, ``registered``, ``left_out`` (could not be placed),
        ``blurred`` (not tried), ``points``, ``reprojection_error_px``, ``focal_px``.

    Raises
    ------
    UserError
        If there are fewer than 3 usable photos, or they do not overlap.
    """
    config = config or CalibrateConfig()
    path = Path(photos)
    if progress is not None:
        progress.update(0, "reading photos")
    loaded = (read_video(path, config.video_frames, config.max_side, config.video_spacing)
              if is_video(path) else read_photos(path, config.max_side))
    count = len(loaded)
    soft = [loaded[index].name for index in blurred([photo.image for photo in loaded],
                                                    config.blur_threshold)]
    if soft:
        warnings.warn(f"{len(soft)} of {count} photos are blurred and are left out: "
                      f"{_listed(soft)} (--blur-threshold 0 keeps them)", stacklevel=2)
        loaded = [photo for photo in loaded if photo.name not in soft]
    if len(loaded) < 3:
        raise UserError(f"{path} has only {len(loaded)} usable "
                        f"{'photo' if len(loaded) == 1 else 'photos'}; {_ADVICE}")
    with tempfile.TemporaryDirectory(prefix="lfportrait-") as work:
        found, figures = _reconstruct(loaded, config, progress, Path(work))
    if len(found) < max(3, 0.4 * len(loaded)):
        how_many = f"only {len(found)}" if found else "none"
        raise UserError(f"the photos in {path} do not overlap enough: {how_many} of {len(loaded)} "
                        f"could be placed together; {_ADVICE}")
    left_out = [photo.name for photo in loaded if photo.name not in found]
    if left_out:
        warnings.warn(f"{len(left_out)} of {len(loaded)} photos could not be placed and are left "
                      f"out: {_listed(left_out)}", stacklevel=2)
    kept = [photo for photo in loaded if photo.name in found]
    lenses = [found[photo.name][1] for photo in kept]
    poses = np.array([found[photo.name][0] for photo in kept])
    similarity = portrait_frame_from_cameras(_pinholes(poses, lenses))
    poses = similarity @ poses
    poses[:, :3, :3] /= np.cbrt(np.linalg.det(similarity[:3, :3]))
    capture = Capture(*assemble(poses, lenses, [photo.image for photo in kept],
                                [photo.name for photo in kept], None, config.holdout))
    figures.update(photos=count, registered=len(kept), left_out=left_out, blurred=soft,
                   focal_px=float(np.median([lens.focal[0] for lens in lenses])))
    return replace(capture, frame=capture.frame @ similarity, figures=figures)


def _listed(names: list[str]) -> str:
    """The first few names, for a message of one line."""
    return f"{', '.join(names[:5])}{', ...' if len(names) > 5 else ''}"


def _pinholes(poses: NDArray[np.float64], lenses: list[Lens]) -> Camera:
    return Camera(poses, np.array([lens.focal for lens in lenses]),
                  np.array([lens.center for lens in lenses]),
                  np.array([lens.width for lens in lenses]),
                  np.array([lens.height for lens in lenses]))
