"""Moving light fields: coded frames of a head that turns or moves through the panel's plane.

Frames are coded and written one at a time, so that a sequence takes the memory of one. A folder of
pictures is resumed after an interruption; a video is restarted.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..cache import key_of
from ..errors import UserError
from ..field import VoxelField
from ..files import read_json, write_json
from ..lightfield import Display, EncodeConfig, Placement, ViewMask, encode, write_coded
from .video import write_video

__all__ = ["SequenceConfig", "each_frame", "write_sequence"]

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
        return dataclasses.replace(config, turn=config.turn + share * (turn - config.turn),
                                   focus=config.focus + share * (focus - config.focus))


def each_frame(field: VoxelField, display: Display, config: EncodeConfig,
               sequence: SequenceConfig) -> Iterator[NDArray[np.uint8]]:
    """Frames of a sequence, coded one at a time.

    Parameters
    ----------
    field, display, config
        As for `encode`; ``config`` is the beginning of the motion.
    sequence
        The motion.

    Yields
    ------
    image
        uint8 [H, W, 3], as the viewer sees the panel.
    """
    mask = ViewMask.build(display)
    for frame in range(sequence.frames):
        yield encode(field, display, sequence.at(config, frame), mask=mask)


def _key(field: VoxelField, display: Display, config: EncodeConfig, sequence: SequenceConfig,
         ) -> str:
    """What decides the frames' pixels."""
    digest = hashlib.sha256()
    texels = () if field.texture is None else (field.texture.texels,)
    if field.backdrop is not None:
        texels = (*texels, field.backdrop.picture, field.backdrop.light)
    for array in (field.links, field.density, field.sh, field.center, field.radius, *texels):
        digest.update(np.ascontiguousarray(array).data)
    motion = dataclasses.replace(sequence, fps=1.0, video="lossless")
    return key_of(__name__, digest.hexdigest(), display, config, motion)


def _names(sequence: SequenceConfig) -> list[str]:
    digits = max(4, len(str(sequence.frames - 1)))
    return [f"{frame:0{digits}d}.png" for frame in range(sequence.frames)]


def _write_folder(field: VoxelField, display: Display, config: EncodeConfig,
                  sequence: SequenceConfig, out: Path, step: Callable[[], None]) -> int:
    """The missing pictures of a folder; returns how many were there."""
    key = _key(field, display, config, sequence)
    names = _names(sequence)
    record = out / _RECORD
    if record.is_file():
        if read_json(record).get("key") != key:
            raise UserError(f"{out} holds frames of another sequence; empty it, or choose another "
                            "folder with --out")
    elif out.is_dir() and any(out.glob("*.png")):
        raise UserError(f"{out} holds other pictures; choose another folder with --out")
    write_json(record, {"key": key, "display": display.name, "frames": sequence.frames,
                        "fps": sequence.fps})
    mask = ViewMask.build(display)
    there = 0
    for frame, name in enumerate(names):
        # A picture appears under its name only when it is complete.
        if (out / name).is_file():
            there += 1
        else:
            image = encode(field, display, sequence.at(config, frame), mask=mask)
            write_coded(out / name, image, display)
        step()
    return there


def write_sequence(field: VoxelField, display: Display, config: EncodeConfig,
                   sequence: SequenceConfig, out: str | Path,
                   step: Callable[[], None] = lambda: None) -> dict[str, Any]:
    """Write a moving light field as a video or as a folder of pictures.

    Parameters
    ----------
    field, display, config, sequence
        As for `each_frame`.
    out
        ``.mp4``, ``.mov`` or ``.mkv``: a video, which appears when it is complete; a name without a
        suffix: a folder of PNG files, which is resumed if some of them exist.
    step
        Called after each frame.

    Returns
    -------
    figures
        ``frames``: their number; ``kept``: how many of them were there.

    Raises
    ------
    UserError
        If there are no frames, ``out`` is neither a video nor a folder, or the folder holds
        pictures of another sequence.
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

    def frames() -> Iterator[NDArray[np.uint8]]:
        for image in each_frame(field, display, config, sequence):
            yield display.to_panel(image)
            step()

    write_video(out, frames(), sequence.fps,
                coding="lossless" if sequence.video == "lossless" else "444")
    return {"frames": sequence.frames, "kept": 0}
