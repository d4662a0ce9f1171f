"""Camera paths about a head, videos of them, moving light fields and loops.

Videos are H.264 that every browser and player opens, or HEVC or VP9 for what is larger than H.264
takes and for panels that play nothing else. Fixed encoder settings on one thread and no time stamps
in the file: the same frames give the same bytes. Colors are converted and tagged as BT.709.

Pictures coded for a light-field panel need more than the usual 4:2:0, which keeps colors at half
the size. ``444`` keeps all colors, ``lossless`` all values, as RGB. Browsers play neither; mpv, VLC
and ffplay do.

A moving light field is a sequence of coded frames, coded and written one at a time. A folder of
pictures is resumed after an interruption; a video is restarted.

The loop for messengers is short: a camera goes around an ellipse in front of the face. That shows
parallax in both directions and has no turning points, at which a sweep seems to stop.
"""

from __future__ import annotations

import hashlib
import math
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image

from .. import field as fields
from .. import lightfield
from ..arrays import Array, Float64, UInt8
from ..cache import key_of
from ..capture import Camera
from ..color import to_uint8
from ..errors import UserError
from ..files import atomic_path, read_json, write_json
from ..lightfield import Display, EncodeConfig, Placement
from ..measure import usable_cores
from .kinds import ExportContext, LoopConfig

DISTANCE = 4.0  # Of the cameras from what they look at, in world units.
_MARGIN = 1.04


def head_extent(field: fields.VoxelField | None) -> tuple[float, float, float]:
    """Extent that a picture must show: half width, lowest and highest point about the axis.

    The head lies in [-1, 1]^3; of the shoulders, only what is as wide and as low as that is shown.
    """
    if field is None:
        return 1.0, -1.0, 1.0
    reach, low, high = field.solid_extent
    # The lattice points' own reach: interpolation fades to nothing one voxel further out.
    voxel = float((2.0 * field.radius / field.links.shape[::-1]).max())
    reach, low, high = reach + voxel, low - voxel, high + voxel
    return min(max(reach, 0.5), 0.9), max(low, -1.0), min(high, 1.2)


def _arc(degrees: Float64, size: int, field: fields.VoxelField | None,
         pitch: float = 0.0) -> Camera:
    """Cameras on an arc that see the whole head, framed the same in all of them."""
    reach, low, high = head_extent(field)
    half = _MARGIN * max(reach, (high - low) / 2)
    # The nearest point of the head's cylinder is the one that must fit.
    focal = 0.5 * size * np.sqrt(DISTANCE ** 2 - reach ** 2) / half
    target = (0.0, (low + high) / 2, 0.0)
    return Camera.arc(degrees, distance=DISTANCE, width=size, height=size, focal=focal,
                      target=target, pitch=pitch)


def good_cone(field: fields.VoxelField, cone: float) -> float:
    """A cone in degrees, as far as the field can be looked at (`VoxelField.cone`)."""
    return min(cone, field.cone) if field.cone else cone


def sweep_degrees(frames: int, cone: float) -> Float64:
    """Yaw of each frame of a sweep there and back, degrees, float64 [frames].

    Over the full width ``cone`` in degrees it runs 0, +cone/2, 0, -cone/2, 0, slowly at the ends,
    and without a seam in a loop.
    """
    return 0.5 * cone * np.sin(2.0 * np.pi * np.arange(frames) / frames)


def sweep_cameras(cone: float = 40.0, frames: int = 60, size: int = 512,
                  field: fields.VoxelField | None = None) -> Camera:
    """Cameras of a horizontal sweep there and back over a cone, its full width in degrees.

    ``frames`` of one loop, ``size`` pixels wide and high; the field's extent is framed, by default
    the cube [-1, 1]^3 that holds a head.
    """
    return _arc(sweep_degrees(frames, cone), size, field)


def orbit_cameras(frames: int = 90, size: int = 512, field: fields.VoxelField | None = None,
                  pitch: float = 0.0) -> Camera:
    """Cameras once around the head, from the front to its left side and on.

    Parameters
    ----------
    frames : Number of cameras.
    size : Width and height of the pictures in pixels.
    field : Whose extent to frame; by default the cube [-1, 1]^3 that holds a head.
    pitch : Degrees above the horizon.
    """
    return _arc(360.0 * np.arange(frames) / frames, size, field, pitch)


def path_cameras(path: Literal["sweep", "orbit"], *, frames: int = 60, cone: float = 40.0,
                 size: int = 512, field: fields.VoxelField | None = None) -> Camera:
    """Cameras of a path by its name (`sweep_cameras`, `orbit_cameras`)."""
    if frames < 1 or size < 2:
        raise UserError("a path needs at least one frame of at least 2 pixels")
    if path == "sweep":
        return sweep_cameras(cone, frames, size, field)
    if path == "orbit":
        return orbit_cameras(frames, size, field)
    raise UserError(f"there is no path {path!r}; choose sweep or orbit")


def sweep_ground(field: fields.VoxelField, config: EncodeConfig,
                 cameras: Camera) -> lightfield.Ground | None:
    """The ground behind a field for cameras of `sweep_cameras`, or None where there is none."""
    return lightfield.world_ground(field, config, DISTANCE / float(cameras.focal[0].mean()))


def sweep_frames(field: fields.VoxelField, cone: float = 40.0, frames: int = 60, size: int = 512, *,
                 background: float | Array = 1.0, ground: EncodeConfig | None = None,
                 ) -> Iterator[UInt8]:
    """Frames of a sweep (`sweep_cameras`), uint8 [size, size, 3], rendered one at a time.

    ``background`` is a grey level or RGB in [0, 1] behind the head; what panels show there, by
    ``ground``, is shown instead where there is such a ground.
    """
    cameras = sweep_cameras(cone, frames, size, field)
    plane = None if ground is None else sweep_ground(field, ground, cameras)
    # There and back pass the same places: each is rendered once.
    yaw, first, places = np.unique(np.round(sweep_degrees(frames, cone), 9), return_index=True,
                                   return_inverse=True)
    last = np.array([np.flatnonzero(places == place)[-1] for place in range(len(yaw))])
    fresh = lightfield.render_views(field, cameras, np.sort(first).tolist(), background=background,
                                    ground=plane)
    kept: dict[int, UInt8] = {}
    for frame, place in enumerate(places.ravel().tolist()):
        if frame == first[place]:
            kept[place] = lightfield.eight_bit(next(fresh).color)
        yield kept[place] if frame < last[place] else kept.pop(place)


Codec = Literal["h264", "hevc", "vp9"]
ENCODERS: dict[Codec, str] = {"h264": "libx264", "hevc": "libx265", "vp9": "libvpx-vp9"}
"""FFmpeg's encoders."""
_BT709 = 1
_FORMATS = {"420": "yuv420p", "444": "yuv444p", "lossless": "rgb24"}
_SUFFIXES = {".mp4", ".mov", ".mkv"}


def has_encoder(codec: Codec) -> bool:
    """Whether the installed FFmpeg codes this."""
    import av

    return ENCODERS[codec] in av.codecs_available


def _picture(frame: Array, even: bool) -> UInt8:
    """One frame as uint8; with even sides, the last row and column are repeated where needed."""
    if frame.ndim != 3 or frame.shape[2] < 3:
        raise ValueError(f"a frame must be [H, W, 3], not {list(frame.shape)}")
    frame = to_uint8(frame[..., :3])
    if not even:
        return np.ascontiguousarray(frame)
    height, width = frame.shape[:2]
    return np.ascontiguousarray(
        np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge"))


def write_video(path: str | Path, frames: Iterable[Array], fps: float = 30.0, *,
                quality: int = 17, coding: Literal["420", "444", "lossless"] = "420",
                preset: Literal["medium", "veryfast", "superfast"] = "medium",
                codec: Codec = "h264", comment: str = "") -> int:
    """Write a video.

    Parameters
    ----------
    path : ``.mp4``, ``.mov`` or ``.mkv``, or ``.webm`` for VP9; it appears when it is complete.
    frames : Frames [H, W, 3] of one size, uint8 or float in [0, 1]; taken one at a time, so a
        generator needs the memory of one frame only. With ``"420"`` odd sides grow by one
        pixel.
    quality : The encoder's constant rate factor, 0 (finest) to 51 (VP9: 63); 17 looks like the
        original. Not used where ``coding`` is ``"lossless"``.
    coding : ``"420"`` for people; ``"444"`` and ``"lossless"`` for pictures coded for a panel.
        The latter two hold no frames back, which would take gigabytes at a panel's size. Only
        H.264 has them.
    preset : How thoroughly ``"420"`` is coded: ``"veryfast"`` takes less than half the time of
        ``"medium"`` for files that are a twentieth larger, ``"superfast"`` a quarter of it for
        files that are a third larger. H.264 alone.
    codec : ``"h264"``, ``"hevc"`` or ``"vp9"``.
    comment : Written into the file's metadata.

    Returns
    -------
    count : Number of frames written.
    """
    import av

    if fps <= 0:
        raise UserError(f"a video needs more than {fps:g} frames per second")
    suffix = Path(path).suffix.lower()
    if suffix not in (_SUFFIXES | {".webm"} if codec == "vp9" else _SUFFIXES):
        raise UserError(f"can't write a video named {path}; end the name in .mp4")
    if codec != "h264" and coding != "420":
        raise ValueError(f"{codec} is written as 4:2:0 only")
    count, size = 0, None
    with atomic_path(path) as temporary:
        options = {"movflags": "+faststart"} if suffix in (".mp4", ".mov") else {}
        with av.open(str(temporary), "w", options=options) as container:
            bitexact: Any = av.container.Flags.bitexact.value  # no time of writing in the file
            container.flags |= bitexact
            if comment:
                container.metadata["comment"] = comment
            stream: Any = None
            for frame in frames:
                picture = _picture(frame, coding == "420")
                if stream is None:
                    size = picture.shape
                    stream = (_stream(container, size, fps, quality, coding, preset)
                              if codec == "h264" else
                              _large_stream(container, size, fps, quality, codec))
                if picture.shape != size:
                    raise ValueError(f"frame {count} is {picture.shape}, the first {size}")
                video_frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
                if coding != "lossless":
                    video_frame = video_frame.reformat(
                        format=_FORMATS[coding], dst_colorspace="ITU709", dst_color_range="MPEG")
                video_frame.pts = count
                container.mux(stream.encode(video_frame))
                count += 1
            if stream is None:
                raise UserError(f"there are no frames for {path}")
            container.mux(stream.encode(None))
    return count


def _added(container: Any, encoder: str, size: tuple[int, ...], fps: float, coding: str) -> Any:
    """A stream with its size and speed, and its colors tagged."""
    stream = container.add_stream(encoder, rate=Fraction(fps).limit_denominator(1001))
    stream.height, stream.width = size[0], size[1]
    stream.pix_fmt = _FORMATS[coding]
    context = stream.codec_context
    context.color_primaries = context.color_trc = _BT709
    context.colorspace = 0 if coding == "lossless" else _BT709
    context.color_range = 2 if coding == "lossless" else 1  # 0..255, 16..235
    return stream


def _large_stream(container: Any, size: tuple[int, ...], fps: float, quality: int, codec: Codec,
                  ) -> Any:
    """HEVC or VP9. A quilt's frame has up to 100 MB: few of them are held back."""
    stream = _added(container, ENCODERS[codec], size, fps, "420")
    if codec == "hevc":
        stream.codec_context.codec_tag = "hvc1"  # by which Apple's players know it
        # Without B-frames: at the end of one or two frames libx265's threads now and then hand on
        # what the container refuses.
        stream.options = {
            "crf": str(quality), "preset": "fast", "x265-params":
            "log-level=error:frame-threads=1:rc-lookahead=5:bframes=0:info=0"}
    else:
        stream.codec_context.thread_count = usable_cores()
        stream.options = {"crf": str(quality), "b": "0", "deadline": "good", "cpu-used": "4",
                          "lag-in-frames": "5", "tile-columns": "4"}
    return stream


def _stream(container: Any, size: tuple[int, ...], fps: float, quality: int, coding: str,
            preset: str) -> Any:
    """An H.264 stream with a fixed encoder."""
    lossless = coding == "lossless"
    stream = _added(container, "libx264rgb" if lossless else "libx264", size, fps, coding)
    stream.codec_context.thread_count = 1
    # Without the macroblock tree: for small frames it gives other bytes from run to run.
    options = {"crf": str(quality), "preset": preset, "threads": "1", "x264-params": "mbtree=0"}
    if coding != "420":
        options |= {"preset": "superfast", "tune": "zerolatency"}
    if lossless:
        del options["crf"]
        options["qp"] = "0"
    stream.options = options
    return stream


_VIDEOS = (".mp4", ".mov", ".mkv")
_RECORD = "sequence.json"


@dataclass(frozen=True)
class SequenceConfig:
    """Parameters of a moving light field."""

    frames: int = 0
    """Number of frames; 0 = one still picture."""
    turn_to: float | None = None
    """Final turn of the head in degrees, starting at --turn; by default no turn."""
    focus_to: float | None = None
    """Final focus, starting at --focus; by default constant."""
    motion: Literal["loop", "once"] = "loop"
    """loop: there and back, for seamless repetition; once: one way."""
    fps: float = 30.0
    """Frames per second of a video."""
    video: Literal["lossless", "444"] = "lossless"
    """lossless: H.264 in RGB, keeps every sub-pixel; 444: smaller file, some cross-talk between
    views. The usual 4:2:0 mixes neighbouring pixels, and so their views."""

    def __post_init__(self) -> None:
        if not 0 <= self.frames <= 100_000:
            raise UserError(f"--frames must be 0 to 100000, not {self.frames}")
        if not (math.isfinite(self.fps) and 0 < self.fps <= 1000):
            raise UserError(f"--fps must be more than 0 and at most 1000, not {self.fps:g}")
        if self.frames == 0 and (self.turn_to is not None or self.focus_to is not None):
            raise UserError("--turn-to and --focus-to need the number of --frames")
        if self.turn_to is not None and not -180 <= self.turn_to <= 180:
            raise UserError(f"--turn-to must be -180 to 180 degrees, not {self.turn_to:g}")
        if self.focus_to is not None and not math.isfinite(self.focus_to):
            raise UserError(f"--focus-to must be a number, not {self.focus_to:g}")

    def share(self, frame: int) -> float:
        """How far the motion is at a frame, 0 to 1; slow at both ends."""
        if self.motion == "loop":
            return 0.5 - 0.5 * math.cos(2 * math.pi * frame / self.frames)
        return 0.5 - 0.5 * math.cos(math.pi * frame / max(1, self.frames - 1))

    def at(self, config: EncodeConfig, frame: int) -> EncodeConfig:
        """The coding of one frame."""
        share = self.share(frame)
        turn = config.turn if self.turn_to is None else self.turn_to
        focus = config.focus if self.focus_to is None else self.focus_to
        return replace(config, turn=config.turn + share * (turn - config.turn),
                                   focus=config.focus + share * (focus - config.focus))


def each_frame(field: fields.VoxelField, display: Display, config: EncodeConfig,
               sequence: SequenceConfig) -> Iterator[UInt8]:
    """Frames of a sequence, uint8 [H, W, 3] as the viewer sees the panel, coded one at a time.

    ``config`` is the beginning of the motion.
    """
    mask = lightfield.ViewMask.build(display)
    for frame in range(sequence.frames):
        yield lightfield.encode(field, display, sequence.at(config, frame), mask=mask)


def _key(field: fields.VoxelField, display: Display, config: EncodeConfig, sequence: SequenceConfig,
         ) -> str:
    """What decides the frames' pixels."""
    digest = hashlib.sha256()
    texels = () if field.texture is None else (field.texture.texels,)
    if field.backdrop is not None:
        texels = (*texels, field.backdrop.picture, field.backdrop.light)
    for array in (field.links, field.density, field.sh, field.center, field.radius, *texels):
        digest.update(np.ascontiguousarray(array).data)
    motion = replace(sequence, fps=1.0, video="lossless")
    return key_of(__name__, digest.hexdigest(), display, config, motion)


def _write_folder(field: fields.VoxelField, display: Display, config: EncodeConfig,
                  sequence: SequenceConfig, out: Path, step: Callable[[], None]) -> int:
    """The missing pictures of a folder; returns how many were there."""
    key = _key(field, display, config, sequence)
    digits = max(4, len(str(sequence.frames - 1)))
    names = [f"{frame:0{digits}d}.png" for frame in range(sequence.frames)]
    record = out / _RECORD
    if record.is_file():
        if read_json(record).get("key") != key:
            raise UserError(f"{out} holds frames of another sequence; empty it, or choose another "
                            "folder with --out")
    elif out.is_dir() and any(out.glob("*.png")):
        raise UserError(f"{out} holds other pictures; choose another folder with --out")
    write_json(record, {"key": key, "display": display.name, "frames": sequence.frames,
                        "fps": sequence.fps})
    mask = lightfield.ViewMask.build(display)
    there = 0
    for frame, name in enumerate(names):
        # A picture appears under its name only when it is complete.
        if (out / name).is_file():
            there += 1
        else:
            image = lightfield.encode(field, display, sequence.at(config, frame), mask=mask)
            lightfield.write_coded(out / name, image, display)
        step()
    return there


def write_sequence(field: fields.VoxelField, display: Display, config: EncodeConfig,
                   sequence: SequenceConfig, out: str | Path,
                   step: Callable[[], None] = lambda: None) -> dict[str, Any]:
    """Write a moving light field (`each_frame`) as a video or as a folder of pictures.

    Returns ``frames``: their number; ``kept``: how many of them were there. ``step`` is called
    after each frame. ``out`` is ``.mp4``, ``.mov`` or ``.mkv``: a video, which appears when it is
    complete; or a name without a suffix: a folder of PNG files, which is resumed if some of them
    exist.
    """
    out = Path(out)
    if sequence.frames < 1:
        raise UserError("a sequence needs at least one frame: --frames N")
    for frame in (0, sequence.frames // 2, sequence.frames - 1):
        Placement.of(display, sequence.at(config, frame))
    video = out.suffix.lower() in _VIDEOS
    if not video and (out.suffix or out.is_file()):
        raise UserError(f"frames go to a video (--out NAME.mp4) or to a folder (a name without a "
                        f"suffix), not to {out}")
    if sequence.turn_to is None and sequence.focus_to is None:
        warnings.warn("all frames will be the same: use --turn-to or --focus-to", UserWarning,
                      stacklevel=2)
    if not video:
        kept = _write_folder(field, display, config, sequence, out, step)
        return {"frames": sequence.frames, "kept": kept}

    def frames() -> Iterator[UInt8]:
        for image in each_frame(field, display, config, sequence):
            yield display.to_panel(image)
            step()

    write_video(out, frames(), sequence.fps,
                coding="lossless" if sequence.video == "lossless" else "444")
    return {"frames": sequence.frames, "kept": 0}


_WEBP_QUALITY = 80
"""Of WebP: strokes keep their edges, and a loop of 480 pixels has about half a megabyte."""
_TICK = 10  # Milliseconds in which GIF files count; players show less than two of them as ten.


def loop_cameras(config: LoopConfig, field: fields.VoxelField) -> Camera:
    """The cameras of a loop, from above the middle to the head's left side and on.

    The field's extent is framed, and it may limit the turn (`VoxelField.cone`).
    """
    share = np.arange(config.frames) / config.frames
    wide = good_cone(field, 2 * config.sway)
    yaw = 0.5 * wide * np.sin(2 * np.pi * share)
    pitch = config.rise * np.cos(2 * np.pi * share)
    # One camera of a sweep frames the head for all of them.
    whole = sweep_cameras(0.0, 1, config.size, field)
    height, distance = float(whole.position[0, 1]), float(whole.position[0, 2])
    return Camera.concatenate([
        Camera.arc(np.array([turn]), distance=distance, width=config.size, height=config.size,
                   focal=float(whole.focal[0, 0]), target=(0.0, height, 0.0), pitch=float(up))
        for turn, up in zip(yaw, pitch)])


def _frames(field: fields.VoxelField, config: LoopConfig, context: ExportContext,
            ) -> Iterator[UInt8]:
    """The pictures of a loop, uint8 [size, size, 3]."""
    cameras = loop_cameras(config, field)
    seen = lightfield.render_views(field, cameras, background=context.encode.background,
                                   ground=sweep_ground(field, context.encode, cameras))
    for number in range(len(cameras)):
        context.step(number, len(cameras))
        yield lightfield.eight_bit(next(seen).color)


def write_loop(field: fields.VoxelField, path: Path, config: LoopConfig,
               context: ExportContext) -> dict[str, Any]:
    """Write a loop as MP4, GIF or WebP, by the file's name (`lfportrait.share.Export.write`)."""
    frames = _frames(field, config, context)
    if path.suffix.lower() == ".mp4":
        return {"frames": write_video(path, frames, config.fps, quality=20)}
    pictures = [Image.fromarray(frame) for frame in frames]
    wait = max(_TICK, round(1000 / config.fps / _TICK) * _TICK)
    options: dict[str, Any] = {"quality": _WEBP_QUALITY, "method": 4}
    if path.suffix.lower() == ".gif":
        # One palette for all frames, and no dithering: that would shimmer.
        palette = _palette(pictures)
        pictures = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in pictures]
        options = {"optimize": False, "disposal": 1}
    try:
        with atomic_path(path) as temporary:
            pictures[0].save(temporary, save_all=True, append_images=pictures[1:], loop=0,
                             duration=wait, format=path.suffix[1:].upper(), **options)
    except OSError as error:
        raise UserError(f"can't write {path}: {error.strerror or error}") from error
    return {"frames": len(pictures)}


def _palette(pictures: list[Image.Image]) -> Image.Image:
    """A palette of 256 colors that fits all frames, from a few of them side by side."""
    some = pictures[::max(1, len(pictures) // 6)]
    sheet = np.concatenate([np.asarray(one)[::2, ::2] for one in some], axis=1)
    return Image.fromarray(sheet).quantize(256, method=Image.Quantize.MEDIANCUT)
