"""From photos to a field: ``capture-check``, ``calibrate``, ``reconstruct``, ``render``."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import tyro

from ..capture import CalibrateConfig, Capture
from ..color import to_uint8
from ..errors import UserError
from ..field import ReconstructConfig, VoxelField
from ..files import write_exr, write_image
from ..job import MadeFrom
from .common import Common


@dataclass
class CaptureCheck(Common):
    """Check the sharpness, coverage and lighting of photos or a video, in half a minute.

    Prints advice and draws the camera positions from above with a contact sheet.
    """

    photos: tyro.conf.Positional[Path]
    """Folder of photos, or a video."""
    out: Path = Path("capture-check.png")
    """Picture with the camera positions from above and the contact sheet (.png or .jpg)."""

    def run(self) -> dict[str, Any]:
        from ..job import check_photos, check_picture

        start = time.perf_counter()
        if self.out.suffix.lower() not in (".png", ".jpg", ".jpeg"):
            raise UserError(f"{self.out} must end in .png or .jpg")
        with self.progress("capture-check") as progress:
            check = check_photos(self.photos, progress)
        write_image(self.out, check_picture(check), sheet=True)
        figures = check.figures()
        if not self.quiet:
            print(f"{figures['count']} photos, {figures['count'] - figures['useless']} usable, "
                  f"a face in {figures['faces']}: {self.out}")
            print("\n".join(f"- {line}" for line in check.advice)
                  or "No problems found: these photos are suitable for a portrait.")
            if check.notes:
                print("\n".join(["", *check.notes]))
        return {**figures, "picture": str(self.out),
                "seconds": {"check": time.perf_counter() - start}}


@dataclass
class Calibrate(Common):
    """Calibrate photos: cameras (COLMAP), facial landmarks and mattes of the person."""

    photos: tyro.conf.Positional[Path]
    """Folder of photos, a video, or a data set that already has cameras."""
    out: Path
    """Folder for the capture."""
    config: Annotated[CalibrateConfig, tyro.conf.arg(name="")] = option(
        default_factory=CalibrateConfig)
    """Calibration."""
    keep_background: bool = False
    """Do not cut the person out of photos that have no alpha channel."""
    made_from: MadeFrom = "auto"
    """Fit a head to the face (face), or find cameras by what the photos share (photos); auto: the
    face for one photo or two, for up to nine that can't be placed together, and for the best of
    many pictures, or of a video, where the face moves or is seen from one side only."""

    def run(self) -> dict[str, Any]:
        from ..job import prepare_capture

        sheet = self.out.with_name(f"{self.out.name}-photos.jpg")
        with self.progress("calibrate") as progress:
            capture, figures = prepare_capture(self.photos, replace(self.config, seed=self.seed),
                                               keep_background=self.keep_background,
                                               made_from=self.made_from, progress=progress,
                                               sheet=sheet)
        capture.save(self.out)
        return figures


@dataclass
class Reconstruct(Common):
    """Reconstruct a sparse voxel radiance field (Plenoxels) from a capture.

    One photo, or a few, become a field, too: a head is fitted to the face.
    """

    capture: tyro.conf.Positional[Path]
    """Capture folder, transforms.json data set, COLMAP model, LLFF or NSVF folder; or one photo, or
    a folder of up to nine."""
    out: Path = Path("field.npz")
    """File for the field."""
    usual: ClassVar[tuple[str, ...]] = ("from", "resolution", "max-voxels", "rays", "refine-poses")
    config: Annotated[ReconstructConfig, tyro.conf.arg(name="")] = option(
        default_factory=ReconstructConfig)
    """Reconstruction."""
    keep_background: bool = False
    """Also reconstruct the room: do not use mattes, and do not cut out the person."""
    portrait_frame: bool = False
    """Transform the capture into the portrait frame (face upright, centred), as `make` does;
    otherwise its own frame is kept."""
    log: Path | None = None
    """File for a table of the training (.csv): PSNR, loss, rays per second, voxels."""
    made_from: MadeFrom = "auto"
    """Of photos without cameras: fit a head to the face (face; of a video or of ten photos and
    more to the best one), or find cameras by what up to nine share (photos); auto: the face for one
    or two, and where they can't be placed together."""

    def run(self) -> dict[str, Any]:
        from ..face import fit_to_surface, is_portrait
        from ..field import Curves, reconstruct_with_figures
        from ..job import cut_person, find_face

        capture = self._capture()
        if is_portrait(capture):
            return self._fitted(capture)
        mattes = str(capture.figures.get("mattes", "given"))
        checkpoint = self.out.with_name(f".{self.out.stem}.checkpoint.npz")
        if self.keep_background:
            capture, mattes = replace(capture, alphas=None), "none: the background is kept"
        elif capture.alphas is None:
            try:
                with self.progress("mattes") as progress:
                    capture, mattes = cut_person(capture, progress)
            except UserError as error:
                raise UserError(f"{error}; or keep the room with --keep-background") from error
        if self.portrait_frame or (capture.alphas is not None and (self.config.fill_back
                                                                  or self.config.cut_base)):
            with self.progress("face") as progress:
                capture = find_face(capture, progress, reframe=self.portrait_frame)
        with self.progress("reconstruct") as progress:
            result, figures = reconstruct_with_figures(
                capture, replace(self.config, seed=self.seed), progress, checkpoint=checkpoint,
                curves=None if self.log is None else Curves(self.log), device=self.device,
                fit_head=fit_to_surface)
        result.save(self.out)
        checkpoint.unlink(missing_ok=True)
        return {**figures, "mattes": mattes}

    def _capture(self) -> Capture:
        """The capture, or that of a few photos."""
        from ..job import is_few, prepare_capture

        if not is_few(self.capture) and self.made_from != "face":
            return Capture.load(self.capture)
        with self.progress("capture") as progress:
            return prepare_capture(self.capture, CalibrateConfig(seed=self.seed),
                                   keep_background=self.keep_background,
                                   made_from=self.made_from, progress=progress)[0]

    def _fitted(self, capture: Capture) -> dict[str, Any]:
        """Save the field of a head that was fitted to photos."""
        from ..face import portrait_field

        with self.progress("reconstruct") as progress:
            result, figures = portrait_field(capture, self.config, progress)
        result.save(self.out)
        return {**figures, "mattes": str(capture.figures.get("mattes", "given"))}


@dataclass
class Render(Common):
    """Render pictures or a video of a field."""

    field: tyro.conf.Positional[Path]
    """Field file (.npz)."""
    out: Path
    """Folder for pictures, or a video file (.mp4)."""
    cameras: Path | None = None
    """Capture or transforms.json with the cameras to render; by default a path."""
    path: Literal["sweep", "orbit"] = "sweep"
    """sweep: over the cone and back; orbit: once around the head."""
    cone: float = 40.0
    """Width of the sweep in degrees."""
    frames: int = 60
    """Number of frames of a path."""
    size: int = 512
    """Width and height of a path's pictures in pixels."""
    fps: float = 30.0
    """Frames per second of a video."""
    background: float = 1.0
    """Grey level behind the head, 0 (black) to 1 (white)."""
    ground: str = "black"
    """Behind the head of a sweep, as in `lfportrait encode`: painted, white or a picture's file;
    black: the grey level of --background."""
    depth: bool = False
    """Also write depth (EXR) and opacity."""

    def run(self) -> dict[str, Any]:
        from ..lightfield import EncodeConfig
        from ..share import path_cameras, sweep_ground, write_video

        voxels = VoxelField.load(self.field)
        if self.cameras is not None:
            views = Capture.load(self.cameras).cameras
        else:
            if self.frames < 1:
                raise UserError("--frames must be at least 1")
            views = path_cameras(self.path, frames=self.frames, cone=self.cone, size=self.size,
                                 field=voxels)
        plane = None
        if self.ground != "black":
            if self.cameras is not None or self.path != "sweep":
                raise UserError("--ground is for a sweep, whose cameras stay in front of it")
            plane = sweep_ground(voxels, EncodeConfig(ground=self.ground), views)
        start = time.perf_counter()
        video = self.out.suffix.lower() in (".mp4", ".mov", ".mkv")
        frames: list[np.ndarray] = []
        with self.progress("render", len(views)) as progress:
            for view in range(len(views)):
                behind = self.background if plane is None else plane.seen(views, view)
                rendering = voxels.render(views, view, background=behind, device=self.device)
                if video:
                    frames.append(to_uint8(rendering.color))
                else:
                    write_image(self.out / f"{view:04d}.png", rendering.color)
                    if self.depth:
                        write_image(self.out / f"{view:04d}.alpha.png", rendering.alpha)
                        write_exr(self.out / f"{view:04d}.depth.exr", rendering.depth)
                progress.step()
        if video:
            write_video(self.out, frames, self.fps)
        seconds = time.perf_counter() - start
        rays = int((views.width * views.height).sum())
        return {"seconds": {"render": seconds}, "views": len(views), "rays": rays,
                "rays_per_second": rays / seconds}
