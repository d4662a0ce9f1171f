"""Quilts for a display that a name asks for, and the drive of a Looking Glass that stands alone.

Such a frame is a USB drive to a computer. It plays what ``currentlyPlaying.json`` in its root
names, else the first ``.m3u`` there, else all pictures there. All files are put in the root, and
the playlist holds bare names: so they are found whichever of the three a frame's version looks at,
and whether it reads names from the root or from where the playlist lies.

Nothing is written before all quilts are made and known to fit; the list that makes the frame play
them comes last.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from ... import lightfield
from ...arrays import UInt8
from ...errors import UserError
from ...field import VoxelField
from ...files import atomic_path, atomic_write, write_bytes
from ...lightfield import Display, EncodeConfig, QuiltHint, QuiltLayout, quilt_of
from ...media.pictures import open_picture
from ...temporary import temporary_folder
from .files import (
    SECONDS,
    FrameConfig,
    QuiltName,
    check_picture,
    picture_bytes,
    quilt_exif,
    quilt_settings,
    safe_names,
)

_MOST_PIXELS = 8192  # Pixels a side that the graphics cards of all who look at quilts take.
_SAME = 0.01  # Names give the aspect in a few digits.


@dataclass(frozen=True)
class QuiltPlan:
    """A quilt that is to be made."""

    display: Display  # The panel, with the quilt's size in ``quilt_size``.
    layout: QuiltLayout  # Columns, rows and aspect.

    @staticmethod
    def of(name: str, config: FrameConfig, *, display: Display | None = None) -> QuiltPlan:
        """The quilt that a file's name and the parameters ask for.

        The panel is ``display``, where it is known; otherwise the parameters name it, or the layout
        does.
        """
        asked = QuiltName.of(name)
        if display is None:
            display = Display.resolve(config.display) if config.display else _fitting(asked)
        if asked.aspect and abs(asked.aspect / display.aspect - 1) > _SAME:
            raise UserError(f"{name} asks for views of the aspect {asked.aspect:g}, but those of "
                            f"{display.name} have {display.aspect:.4g}: change the name, or "
                            "--display")
        columns, rows = (asked.columns, asked.rows) if asked.columns else display.quilt
        layout = QuiltLayout(columns, rows, asked.aspect or display.aspect)
        size = config.pixels if config.pixels[0] else _size(display, layout)
        if size[0] < columns or size[1] < rows:
            raise UserError(f"a quilt of {columns} x {rows} views needs more than {size[0]} x "
                            f"{size[1]} pixels")
        return QuiltPlan(replace(display, quilt=(columns, rows), quilt_size=size), layout)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the quilt in pixels."""
        return self.display.quilt_size

    def picture(self, field: VoxelField, encode: EncodeConfig) -> UInt8:
        """The quilt of a field, uint8 [H, W, 3]; view 0, the leftmost, is at the bottom left."""
        return quilt_of(field, self.display, encode, name=f"x{self.layout.suffix()}")[0]


def _fitting(asked: QuiltName) -> Display:
    """The preset for a layout: one with this very quilt, or at least of this aspect."""
    if not asked.aspect:
        return Display.preset("lookingglass-portrait")
    known = [Display.preset(name) for name in Display.names() if name.startswith("lookingglass")]
    fits = [panel for panel in known if abs(asked.aspect / panel.aspect - 1) <= _SAME]
    if not fits:
        raise UserError(f"no Looking Glass shows views of the aspect {asked.aspect:g}: name your "
                        "display with --display")
    # The smallest of them: frames at home are small.
    return min(fits, key=lambda panel: (panel.quilt != (asked.columns, asked.rows),
                                        panel.panel_height))


def _size(display: Display, layout: QuiltLayout) -> tuple[int, int]:
    """Size of a quilt: the customary one, or as many customary tiles as may lie side by side."""
    if (layout.columns, layout.rows) == display.quilt:
        return display.quilt_size
    tile = [display.quilt_size[axis] / display.quilt[axis] for axis in (0, 1)]
    whole = layout.columns * tile[0], layout.rows * tile[1]
    factor = min(1.0, _MOST_PIXELS / max(whole))
    # Whole tiles: a rest at the edge would belong to no view.
    return (layout.columns * max(1, int(tile[0] * factor)),
            layout.rows * max(1, int(tile[1] * factor)))


def write_quilt(path: Path, quilt: UInt8, layout: QuiltLayout, *,
                seconds: float = SECONDS, beside: bool = True) -> dict[str, Any]:
    """Write a quilt uint8 [H, W, 3] as PNG, JPEG or WebP with its EXIF block; its ``bytes``.

    Its side file ``PATH.json``, if there is to be one ``beside``, says how many ``seconds`` a frame
    shows it.
    """
    check_picture(path, quilt.shape[1], quilt.shape[0])
    contents = picture_bytes(path.suffix, quilt, quilt_exif(layout))
    if not beside:
        write_bytes(path, contents)
        return {"bytes": len(contents)}
    side = (json.dumps(quilt_settings(layout, seconds=seconds), indent=1) + "\n").encode()
    # Both are whole under their temporary names before either gets its own.
    with (atomic_write(path.with_name(path.name + ".json")) as second, atomic_write(path) as first):
        first.write(contents)
        second.write(side)
        second.flush()
    return {"bytes": len(contents) + len(side)}


_PLAYING, _PLAYLIST = "currentlyPlaying.json", "lfportrait.m3u"
_CALIBRATION = Path("LKG_calibration") / "visual.json"
_PLAYED = {"PNG": ".png", "JPEG": ".jpg"}
"""What a frame that stands alone plays, by Pillow's names."""
_EVERYBODYS = ("styled", "field", "quilt")
_FAT_FILE = (4 << 30) - 1  # Bytes of the largest file that FAT holds.
_SPARE = 1 << 20  # Bytes left free for folders and clusters.


@dataclass(frozen=True)
class DrivePlan:
    """What goes to a drive."""

    drive: Path  # The drive's root.
    sources: Sequence[Path]  # Fields (.npz) and quilts (PNG, JPEG), in their order.
    title: str = "lfportrait"  # The playlist's title.
    # The frame; by default the calibration on the drive, else the preset of the Go.
    display: str = ""
    picture: Literal["png", "jpg"] = "png"  # Format of quilts of fields.
    seconds: float = SECONDS  # How long each is shown.
    encode: EncodeConfig = field(default_factory=EncodeConfig)  # Placement of the fields' heads.
    asked: QuiltHint | None = None  # The quilts' layout, as the user says.

    def panel(self) -> Display:
        """The frame's display."""
        if self.display:
            return Display.resolve(self.display)
        if (self.drive / _CALIBRATION).is_file():
            return Display.load(self.drive / _CALIBRATION)
        return Display.preset("lookingglass-go")


def _trouble(drive: Path, error: OSError) -> UserError:
    """What is wrong with a drive, in one line."""
    reasons = {errno.ENOSPC: "is full: free some space", errno.EDQUOT: "is full: free some space",
               errno.EROFS: "can only be read: open its lock, or mount it for writing",
               errno.EACCES: "may not be written to by you: change its permissions",
               errno.EPERM: "may not be written to by you: change its permissions",
               errno.EFBIG: "can't hold a file this large: use --picture jpg"}
    reason = reasons.get(error.errno or 0, f"can't be written to ({error.strerror or error}): "
                                           "check that it is still plugged in")
    return UserError(f"the drive {drive} {reason}")


def _check_drive(drive: Path) -> None:
    """Whether one can write there; asked before quilts are rendered."""
    if not drive.is_dir():
        raise UserError(f"no such drive: {drive} (name the folder where the frame's drive is "
                        "mounted, or its letter)")
    try:
        with tempfile.TemporaryFile(dir=drive) as probe:
            probe.write(b"\0" * 4096)
    except OSError as error:
        raise _trouble(drive, error) from error


def _layout(source: Path, panel: Display, asked: QuiltHint | None) -> tuple[str, QuiltLayout]:
    """Suffix and layout of a quilt that exists."""
    try:
        with open_picture(source) as picture:
            suffix = _PLAYED.get(picture.format or "")
    except FileNotFoundError as error:
        raise UserError(f"no such file: {source}") from error
    except (OSError, ValueError, SyntaxError) as error:
        raise UserError(f"{source} is neither a field (.npz) nor a picture: {error}") from error
    if suffix is None:
        raise UserError(f"a frame that stands alone plays PNG and JPEG only: convert {source}")
    return suffix, lightfield.layout_for(source, panel, asked=asked)


def _title(source: Path) -> str:
    """Whose portrait it is: what every job calls the same has its name from the job's folder."""
    part = lightfield.quilt_part(source.stem)
    stem = source.stem[:part.start()] if part else source.stem
    return source.resolve().parent.name or stem if stem in _EVERYBODYS else stem


def _prepared(plan: DrivePlan, place: Path, step: Callable[[int, int], None],
              ) -> tuple[list[tuple[Path, str]], dict[str, Any]]:
    """All quilts with their side files, in a folder of this machine; and the figures."""
    panel, files, entries = plan.panel(), [], []
    layouts = [None if source.suffix.lower() == ".npz" else _layout(source, panel, plan.asked)
               for source in plan.sources]
    names = safe_names(_title(source) for source in plan.sources)
    for number, (source, name, known) in enumerate(zip(plan.sources, names, layouts, strict=True)):
        step(number, len(names))
        if known is None:
            quilt = QuiltPlan.of("", FrameConfig(), display=panel)
            out = place / f"{name}{quilt.layout.suffix()}.{plan.picture}"
            write_quilt(out, quilt.picture(VoxelField.load(source), plan.encode), quilt.layout,
                        seconds=plan.seconds)
            files += [(out, out.name), (Path(f"{out}.json"), f"{out.name}.json")]
            layout = quilt.layout
        else:
            suffix, layout = known
            final = f"{name}{layout.suffix()}{suffix}"
            side = place / f"{final}.json"
            side.write_text(json.dumps(quilt_settings(layout, seconds=plan.seconds), indent=1),
                            "utf-8")
            files += [(source, final), (side, side.name)]
        entries.append({"name": files[-2][1], "views": layout.count,
                        "layout": [layout.columns, layout.rows], "aspect": layout.aspect})
    return files, {"display": panel.name, "quilts": entries}


@contextmanager
def _all_or_nothing(drive: Path) -> Iterator[list[Path]]:
    """New files of a drive; they are removed again if not all of them get there."""
    made: list[Path] = []
    try:
        yield made
    except BaseException as error:
        for path in made:
            with suppress(OSError):
                path.unlink()
        cause = error.__cause__ if isinstance(error, UserError) else error
        if isinstance(cause, OSError):
            raise _trouble(drive, cause) from cause
        raise


def _copy(source: Path, target: Path, made: list[Path]) -> None:
    old = target.exists()
    with (atomic_path(target) as temporary, open(source, "rb") as file,
          open(temporary, "wb") as copy):
        shutil.copyfileobj(file, copy, 1 << 20)
        copy.flush()
        # People pull drives out: what is reported as done lies on it.
        os.fsync(copy.fileno())
    if not old:
        made.append(target)


def _free(plan: DrivePlan, files: Sequence[tuple[Path, str]]) -> None:
    """Whether the files fit on the drive."""
    sizes = [path.stat().st_size for path, _ in files]
    if max(sizes) > _FAT_FILE:
        raise _trouble(plan.drive, OSError(errno.EFBIG, ""))
    # What lies there under the same names is replaced only when the new file is whole.
    free = shutil.disk_usage(plan.drive).free
    if sum(sizes) + _SPARE > free:
        raise UserError(f"the drive {plan.drive} is full: {sum(sizes) / 1e6:.1f} MB are to go "
                        f"there, {free / 1e6:.1f} MB are free; nothing was written")


def _keep_old(drive: Path, folder: Path, made: list[Path]) -> None:
    """Keep the frame's own list of what it plays, once, beside ours."""
    playing, kept = drive / _PLAYING, drive / f"{_PLAYING}.before"
    if playing.is_file() and not kept.exists():
        text = playing.read_bytes()
        if f'"/{_PLAYLIST}"'.encode() not in text:
            (folder / "before").write_bytes(text)
            _copy(folder / "before", kept, made)


def fill_drive(plan: DrivePlan, step: Callable[[int, int], None] = lambda at, count: None,
               ) -> dict[str, Any]:
    """Make quilts and a playlist on a frame's drive, so that it plays them standing alone.

    Where that fails nothing of this call is left on the drive. ``step`` is called before each quilt
    with its number and their count. Returns ``display``, ``quilts`` (name, layout, views),
    ``playlist``, ``bytes``.
    """
    _check_drive(plan.drive)
    if not plan.sources:
        raise UserError("name the portraits for the drive: lfportrait cast styled.npz --drive "
                        f"{plan.drive}")
    for source in plan.sources:
        if not source.is_file():
            raise UserError(f"no such file: {source}")
    with temporary_folder() as folder:
        files, figures = _prepared(plan, folder, step)
        playlist = folder / _PLAYLIST
        playlist.write_bytes("".join(f"{entry['name']}\n" for entry in figures["quilts"]).encode())
        playing = folder / _PLAYING
        playing.write_text(json.dumps({
            "model": "toolkit", "schema": "0.1",
            "playlists": [{"title": plan.title, "path": f"/{_PLAYLIST}"}]}, indent=1), "utf-8")
        files += [(playlist, _PLAYLIST), (playing, _PLAYING)]
        _free(plan, files)
        with _all_or_nothing(plan.drive) as made:
            _keep_old(plan.drive, folder, made)
            for path, name in files:
                _copy(path, plan.drive / name, made)
        return figures | {"playlist": str(plan.drive / _PLAYLIST),
                          "bytes": sum(path.stat().st_size for path, _ in files)}
