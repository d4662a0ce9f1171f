"""Commands of the style: ``transfer`` on photos and videos, ``stylize``, ``restyle``."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from dataclasses import field as option
from itertools import chain, islice
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import tyro

from .. import example
from ..arrays import Float32, Float64, UInt8
from ..errors import UserError
from ..example import Exemplar, Lids, Method, MethodConfig, TransferConfig, face_landmarks
from ..face import detect_landmarks, face_pose
from ..files import picture_format, write_image
from ..labels import LABELS, RegionStyle, members, read_regions, read_value
from ..media.folders import list_pictures, say_left_out
from ..media.pictures import read_image
from ..progress import Progress
from ..stylize import MixConfig, StyledField, StylizeConfig
from .common import Common

DOUBTFUL = 77.0  # Degrees beyond which the landmarks of a turned photo are often wrong.


class _Painter:
    """Exemplars prepared when they are first needed, and used for all photos."""

    def __init__(self, exemplar: Exemplar, config: MethodConfig,
                 choices: Sequence[RegionStyle]) -> None:
        self.exemplar, self.config, self.choices = exemplar, config, choices
        self.others = {choice.style: Exemplar.load(choice.style)
                       for choice in choices if choice.style}
        self.prepared: dict[tuple[str, bool, Lids], Any] = {}
        self.lids: Lids = (False, False)
        self._coming: Future[Any] | None = None

    def begin(self) -> None:
        """Prepare the exemplar as it is in another thread, while a face is looked for."""
        if isinstance(self.config, TransferConfig):
            _note_missing(self.exemplar, self.config)
            aside = ThreadPoolExecutor(1)
            self._coming = aside.submit(lambda: example.prepare(
                example.as_painted(self.exemplar, self.config.wear), self.config))
            aside.shutdown(wait=False)

    def _apply(self, style: str, photo: UInt8, points: Float64) -> Any:
        exemplar = self.others[style] if style else self.exemplar
        # Other methods take a painting as it is.
        chosen = (example.fitting(exemplar, points, photo, self.config.eyes, self.config.wear)
                  if isinstance(self.config, TransferConfig) else exemplar)
        self.lids = chosen.lids
        own = np.array_equal((chosen.opened or chosen).landmarks, exemplar.landmarks)
        key = style, own, chosen.lids
        if key == ("", True, (False, False)) and self._coming is not None:
            self.prepared[key], self._coming = self._coming.result(), None
        if key not in self.prepared:
            self.prepared[key] = example.prepare(chosen, self.config, own=[(photo, points)])
        return self.prepared[key].apply(photo, points)

    def paint(self, photo: UInt8, points: Float64) -> tuple[Float32, Any]:
        """The picture of a photo with landmarks, float32 [H, W, 3], and the result as a whole."""
        result = self._apply("", photo, points)
        if not self.choices:
            return result.image, result
        others = {style: self._apply(style, photo, points).image for style in self.others}
        return example.mix_regions(photo, points, result.image, self.choices, others), result


def _note_missing(exemplar: Exemplar, config: TransferConfig) -> None:
    for note in example.not_worn(exemplar, config.wear):
        print(f"note: {note}", file=sys.stderr)


def transfer_photo(path: Path, out: Path, exemplar: Exemplar, config: MethodConfig,
                   choices: Sequence[RegionStyle], dump: Path | None) -> dict[str, Any]:
    """Paint one photo; returns the seconds of the steps."""
    picture_format(out)
    painter = _Painter(exemplar, config, choices)
    painter.begin()
    photo = read_image(path)[..., :3]
    points = np.asarray(face_landmarks(photo), np.float64)
    image, result = painter.paint(photo, points)
    write_image(out, image)
    turned = abs(face_pose(points).yaw)
    if turned > DOUBTFUL:
        print(f"note: the face in {path.name} is turned by {turned:.0f} degrees: landmarks of its "
              f"far side are guesses (reliable up to {DOUBTFUL:.0f} degrees)", file=sys.stderr)
    if any(painter.lids) and not any(one.region in ("eyes", "features") for one in choices):
        print(f"note: {example.closed_words(painter.lids)} closed, and painted so: --eyes painted "
              f"opens {'them' if all(painter.lids) else 'it'}, --region eyes=off leaves the "
              "photo's", file=sys.stderr)
    if dump is not None:
        result.dump(dump)
    return dict(result.seconds)


def transfer_folder(folder: Path, out: Path, exemplar: Exemplar, config: MethodConfig,
                    choices: Sequence[RegionStyle], progress: Progress) -> dict[str, Any]:
    """Paint all photos of a folder into another; those without a face are named and left out."""
    if out.suffix:
        raise UserError(f"{folder} is a folder: name a folder with --out, not {out}")
    listing = list_pictures(folder)
    say_left_out(listing, folder)
    pictures = [path for path in listing.files
                if Path(path.stem).suffix not in (".mask", ".regions", ".landmarks", ".check")]
    if not pictures:
        raise UserError(f"there are no pictures in {folder}")
    painter = _Painter(exemplar, config, choices)
    skipped: dict[str, str] = {}
    for number, path in enumerate(pictures):
        progress.update(number, path.name)
        try:
            photo = read_image(path)[..., :3]
            image, _ = painter.paint(photo, np.asarray(face_landmarks(photo), np.float64))
        except UserError as error:
            skipped[path.name] = str(error)
            continue
        write_image(out / f"{path.stem}.png", image)
    if len(skipped) == len(pictures):
        raise UserError(f"no picture in {folder} could be painted: {next(iter(skipped.values()))}")
    return {"pictures": len(pictures) - len(skipped), "skipped": skipped}


def transfer_video(path: Path, out: Path, exemplar: Exemplar, config: TransferConfig,
                   progress: Progress) -> dict[str, Any]:
    """Paint a video frame by frame, strokes carried along; returns frames, seconds, flicker."""
    from ..capture import video_frames
    from ..share import write_video

    if out.suffix.lower() not in (".mp4", ".mov", ".mkv"):
        raise UserError(f"{path} is a video: name one with --out, for example out.mp4")
    if config.wear:
        raise UserError(f"{path} is a video: --wear is for photos, leave it out")
    rate, frames = video_frames(path)
    frames, points = _first_face(frames)
    if points is not None:
        # Eyes blink in a video: they are painted open.
        exemplar = example.as_painted(example.suited(exemplar, points))
    video = example.VideoTransfer(example.Transfer(exemplar, config))
    start = time.perf_counter()

    def painted() -> Iterator[UInt8]:
        for number, frame in enumerate(video.frames(frames)):
            progress.update(number, f"frame {number + 1}")
            yield frame

    count = write_video(out, painted(), rate, quality=18, preset="superfast")
    seconds = time.perf_counter() - start
    flicker = float(np.mean(video.flicker)) if video.flicker else None
    return {"frames": count, "fps": rate, "seconds": seconds,
            "frames_per_second": count / seconds, "flicker": flicker}


def _first_face(frames: Iterator[UInt8]) -> tuple[Iterator[UInt8], Float64 | None]:
    """All frames, and the landmarks of the first face among the first 30, or None."""
    looked_at: list[UInt8] = []
    points = None
    for frame in islice(frames, 30):
        looked_at.append(frame)
        points = detect_landmarks(frame)
        if points is not None:
            break
    return chain(looked_at, frames), points


@dataclass
class TransferPhoto(Common):
    """Stylise photos or a video by example (StyleBlit or another method)."""

    photo: tyro.conf.Positional[Path]
    """Photo of a face, a folder of photos, or a video."""
    style: str
    """Exemplar: a picture (landmarks beside it or detected) or a name from `lfportrait styles`."""
    out: Path = Path("out.png")
    """File for the stylised picture; for a folder of photos a folder, for a video a .mp4."""
    region: Annotated[tuple[tuple[str, ...], ...], tyro.conf.UseAppendAction] = ()
    """Strength or style of one region: NAME=NUMBER multiplies its strength (0 keeps the photo,
    above 1 exaggerates, 4 at most), NAME=STYLE or NAME=STYLE:NUMBER paints it like another picture,
    e.g. hair=other.png:0.5 lips=0.3; where regions overlap, the last one wins. Regions are brows,
    eyes, nose, lips, skin, ears, hair, neck, clothes, background, and the groups features and
    body."""
    config: Annotated[TransferConfig, tyro.conf.arg(name="")] = option(
        default_factory=lambda: TransferConfig(quality="best"))
    """Transfer by StyleBlit; a video is always painted with --quality fast."""
    method: Method = "styleblit"
    """styleblit: the default; the others are published methods for comparison, with their own
    parameters (docs/methods.md)."""
    dump: Path | None = None
    """Folder for pictures of every intermediate: guides, labels, table error, chunks, mask."""

    groups: ClassVar[dict[str, str]] = {"": "lfportrait.transfer_methods"}
    usual: ClassVar[tuple[str, ...]] = ("quality", "extent", "strength")

    def run(self) -> dict[str, Any]:
        from ..capture import is_video

        exemplar = Exemplar.load(self.style)
        choices = self._choices()
        if is_video(self.photo):
            if self.method != "styleblit" or choices:
                raise UserError("a video is painted by --method styleblit, without --region")
            with self.progress("transfer") as progress:
                return transfer_video(self.photo, self.out, exemplar,
                                      replace(self.config, seed=self.seed, quality="fast"),
                                      progress)
        if self.photo.is_dir():
            with self.progress("transfer") as progress:
                return transfer_folder(self.photo, self.out, exemplar, self._config(), choices,
                                       progress)
        seconds = transfer_photo(self.photo, self.out, exemplar, self._config(), choices, self.dump)
        return {"method": self.method, **seconds}

    def _choices(self) -> list[RegionStyle]:
        found = read_regions(self.region)
        for name in found:
            members(name, LABELS)
        return [read_value(name, value) for name, value in found.items()]

    def _config(self) -> MethodConfig:
        if self.method == "styleblit":
            return replace(self.config, seed=self.seed)
        kind = example.photo_method(self.method).parameters
        config = next((one for one in self.given if isinstance(one, kind)), kind())
        common = {"seed": self.seed, "device": self.device}
        return replace(config, **{entry.name: common[entry.name] for entry in fields(kind)
                                  if entry.name in common})


@dataclass
class Stylize(Common):
    """Stylise a field by an exemplar."""

    field: tyro.conf.Positional[Path]
    """Field file (.npz)."""
    capture: Path
    """The capture that the field was reconstructed from."""
    style: Annotated[list[str], tyro.conf.UseAppendAction]
    """Exemplar: a picture or a name from `lfportrait styles`. Several are all kept in the file; the
    field shows the first, `lfportrait restyle` selects another."""
    out: Path = Path("styled.npz")
    """File for the stylised field."""
    config: Annotated[StylizeConfig, tyro.conf.arg(name="")] = option(default_factory=StylizeConfig)
    """Stylisation."""
    dump: Path | None = None
    """Folder for pictures of every intermediate."""

    groups: ClassVar[dict[str, str]] = {"": "lfportrait.field_methods"}
    usual: ClassVar[tuple[str, ...]] = ("method", "preview", "strength", "keep", "pixels",
                                        "texture")

    def run(self) -> dict[str, Any]:
        from ..field import VoxelField, check_field_path
        from ..job import capture_of_face
        from ..stylize import kept_skin, stylize_with_figures

        if not self.style:
            raise UserError("no style is given; name a painting: --style PICTURE")
        if not self.field.exists():  # before the painting is looked for
            raise UserError(f"no such field file: {self.field}")
        with self.progress("stylize") as progress:
            check_field_path(self.out)
            with ThreadPoolExecutor(1) as aside:
                coming = aside.submit(VoxelField.load, self.field)
                exemplars = [Exemplar.load(style) for style in self.style]
                capture = capture_of_face(self.capture)
                skin = (kept_skin(self.field, coming.result, capture, self.config.pixels)
                        if self.config.on_skin and capture.landmarks is not None else None)
                field = coming.result()
            config = replace(self.config, seed=self.seed, parameters=self.given)
            styled, figures = stylize_with_figures(field, capture, exemplars, config, progress,
                                                   device=self.device, dump=self.dump, skin=skin)
            styled.save(self.out)
        for notice in figures["notices"]:
            print(f"note: {notice}", file=sys.stderr)
        return figures


@dataclass
class Restyle(Common):
    """Change the strength, likeness, regions or style of a stylised field."""

    field: tyro.conf.Positional[Path]
    """Stylised field (.npz), from `lfportrait stylize` or from this command."""
    out: Path = Path("mixed.npz")
    """File for the field in its new colors; all styles stay in it."""
    config: Annotated[MixConfig, tyro.conf.arg(name="")] = option(default_factory=MixConfig)
    """Mix."""

    def run(self) -> dict[str, Any]:
        asked = self.config.arguments()
        begin = time.perf_counter()
        styled = StyledField.load(self.field)
        loaded = time.perf_counter()
        mixed = styled.mix(**asked)
        ready = time.perf_counter()
        mixed.save(self.out)
        end = time.perf_counter()
        return {"seconds": {"load": round(loaded - begin, 3), "mix": round(ready - loaded, 3),
                            "save": round(end - ready, 3)},
                "styles": list(mixed.styles), "regions": list(mixed.regions),
                "mix": mixed.mixture, "voxels": len(mixed.density)}
