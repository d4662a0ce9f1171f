"""The gallery: built-in styles, the user's paintings, and those of a project.

A painting is a picture with files beside it that the commands read, too: ``NAME.landmarks.txt``,
and ``NAME.regions.png`` with what was painted over by hand.
"""

import io
import os
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from ..arrays import UInt8
from ..files import atomic_path, file_state, image_bytes, write_bytes
from ..labels import BY_HAND
from ..media.folders import visible
from ..media.kinds import PHOTOS
from ..media.pictures import open_picture, read_image
from .answers import Refusal, file_name, folder_name, free_name, free_place, id_of, stamp_of
from .projects import OWN, Project, Projects, record_in

LARGEST = 128 << 20  # Bytes of a painting's file.
_SHOWN = 4096  # Longest side of a painting's picture on the page.
_BESIDE = ("landmarks.txt", "landmarks.png", "mask.png", "check.png", "regions.png")
"""Endings of what lies beside a painting."""

_GROUPS = {"jaw": (0, 17), "right_brow": (17, 22), "left_brow": (22, 27), "nose": (27, 36),
           "right_eye": (36, 42), "left_eye": (42, 48), "mouth": (48, 68)}
GROUPS = {name: list(range(*ends)) for name, ends in _GROUPS.items()}
"""Landmarks that are moved together; right is the sitter's right."""
_RUNS = ((0, 17), (17, 22), (22, 27), (27, 31), (31, 36), (36, 42), (42, 48), (48, 60), (60, 68))
LINES = [[*range(*ends), *([ends[0]] if ends[0] in (36, 42, 48, 60) else [])] for ends in _RUNS]
"""Landmarks that are joined by lines; closed ones end where they begin."""
MIRROR = [*range(16, -1, -1), *range(26, 16, -1), 27, 28, 29, 30, 35, 34, 33, 32, 31,
          45, 44, 43, 42, 47, 46, 39, 38, 37, 36, 41, 40,
          54, 53, 52, 51, 50, 49, 48, 59, 58, 57, 56, 55, 64, 63, 62, 61, 60, 67, 66, 65]
"""What each landmark is in the mirror image."""


@dataclass(frozen=True)
class Style:
    """One style of the gallery."""

    # id, kind: ``builtin``, ``mine`` or ``project``.
    id: str
    kind: str
    name: str  # For people: the file's name without its ending, or the built-in one.
    path: Path | None = None  # The picture; None for a built-in style.

    @property
    def source(self) -> str:
        """What the commands call ``--style``."""
        return self.name if self.path is None else str(self.path)

    def beside(self, ending: str) -> Path:
        """A file beside the picture."""
        if self.path is None:
            raise Refusal("exists", "a built-in style can't be changed: make a copy of it first")
        return self.path.with_suffix(f".{ending}")

    def stamp(self) -> str:
        """Changes when the painting or a file beside it does."""
        return "0" if self.path is None else stamp_of(file_states(sources(self.path)), 12)


class Styles:
    """The gallery of a studio."""

    def __init__(self, projects: Projects) -> None:
        self._projects = projects

    def folder(self, project: Project | None) -> Path:
        """Where paintings of a project, or the user's own, lie."""
        return (project or self._projects).folder / "paintings"

    def all(self, project: Project | None) -> list[Style]:
        """All styles: the built-in ones, the user's, the project's."""
        found = [Style(f"builtin-{id_of(name)}", "builtin", name) for name in _built_in()]
        for owner in (None,) if project is None else (None, project):
            found += [self._of(path, owner) for path in _paintings(self.folder(owner))]
        return found

    def get(self, style: str, project: Project | None) -> Style:
        """A style by its id."""
        found = next((one for one in self.all(project) if one.id == style), None)
        if found is None:
            raise Refusal("not_found", "there is no such painting any more")
        return found

    def add(self, name: str, data: bytes, project: Project | None) -> tuple[Style, bool]:
        """Take in a painting; whether it is new."""
        name, suffix = file_name(name)
        if suffix not in PHOTOS:
            raise Refusal("bad_type", f"{name} is no picture: use PNG or JPEG", name=name)
        folder = self.folder(project)
        folder.mkdir(parents=True, exist_ok=True)
        for path in _paintings(folder):
            if path.stat().st_size == len(data) and path.read_bytes() == data:
                return self._of(path, project), False
        stems = [path.stem for path in _paintings(folder)]
        target = folder / (free_name(Path(name).stem.replace(".", "-"), stems) + suffix)
        _check(data, target)
        write_bytes(target, data)
        return self._of(target, project), True

    def _of(self, path: Path, project: Project | None) -> Style:
        word = "mine" if project is None else "own"
        return Style(f"{word}-{id_of(path.stem)}", "mine" if project is None else "project",
                     path.stem, path)

    def rename(self, style: Style, name: str, project: Project | None) -> Style:
        """Give a painting, and the files beside it, another name."""
        if style.path is None:
            raise Refusal("exists", "a built-in style can't be renamed: make a copy of it first")
        stem = folder_name(name).replace(".", "-")
        folder = style.path.parent
        if stem.lower() in {path.stem.lower() for path in _paintings(folder)}:
            raise Refusal("exists", f"there is a painting {stem!r} already; choose another name")
        target = folder / f"{stem}{style.path.suffix}"
        for path in _with_files(style.path):
            os.replace(path, folder / (stem + path.name[len(style.path.stem):]))
        return Style(f"{style.id.partition('-')[0]}-{id_of(stem)}", style.kind, stem, target)

    def remove(self, style: Style) -> None:
        """Move a painting, and the files beside it, into the trash."""
        if style.path is None:
            raise Refusal("exists", "a built-in style can't be removed")
        trash = style.path.parent.parent / OWN / "trash"
        for path in _with_files(style.path):
            shutil.move(path, free_place(trash, path.name))

    def own(self, project: Project | None) -> Path:
        """Folder for what is found in paintings."""
        return (project.own if project is not None else self._projects.own) / "styles"

    def faces_file(self, style: Style, project: Project | None) -> Path:
        """File for the faces that are found in a painting."""
        stamp = "0" if style.path is None else f"{style.path.stat().st_mtime_ns:x}"
        return self.own(project) / f"{style.id}-{stamp}.faces.json"

    def entry(self, style: Style, project: Project | None) -> dict[str, Any]:
        """A style as the page sees it."""
        query = f"project={project.id}&" if project is not None else ""
        stamp = style.stamp()
        address = f"/api/styles/{style.id}/picture?{query}"
        faces = record_in(self.faces_file(style, project))
        edited = style.path is not None and style.path.with_suffix(".landmarks.txt").is_file()
        landmarks = "file" if edited or style.path is None else (
            "found" if faces is None or faces["faces"] else "none")
        width, height = _size(style.path) if style.path is not None else (768, 1024)
        preview = None
        if project is not None and (kept := preview_file(project, style)).is_file():
            preview = (f"/api/projects/{project.id}/previews/{style.id}"
                       f"?v={stamp}{kept.stat().st_mtime_ns:x}")
        return {"id": style.id, "name": style.name, "kind": style.kind, "width": width,
                "height": height, "picture": f"{address}size=320&v={stamp}",
                "full": f"{address}size=0&v={stamp}", "landmarks": landmarks,
                "faces": 1 if faces is None else len(faces["faces"]), "edited": edited,
                "regions": style.path is not None
                and style.path.with_suffix(".regions.png").is_file(), "preview": preview}


def sources(path: Path) -> list[Path]:
    """A painting's picture, and the files beside it that say what lies in it."""
    return [path, *(path.with_suffix(f".{ending}")
                    for ending in ("landmarks.txt", "mask.png", "regions.png"))]


def file_states(paths: Iterable[Path]) -> list[tuple[int, ...] | None]:
    """The states of files; None of those that are not there."""
    return [file_state(path) if path.is_file() else None for path in paths]

def preview_file(project: Project, style: Style) -> Path:
    """Where the picture of a sitter in a style is kept."""
    field = project.job / "field.npz"
    state = f"{field.stat().st_mtime_ns:x}" if field.is_file() else "0"
    return project.own / "previews" / f"{style.id}-{style.stamp()}-{state}.jpg"


def _built_in() -> list[str]:
    from ..plugins import provided_styles

    return list(provided_styles())


def _paintings(folder: Path) -> list[Path]:
    """The pictures of a folder that are paintings: not masks, drawings or checks of one."""
    return [path for path in visible(folder) if path.is_file() and path.suffix.lower() in PHOTOS
            and Path(path.stem).suffix not in (".mask", ".landmarks", ".check", ".regions")]


def _with_files(path: Path) -> list[Path]:
    """A painting, and the files beside it."""
    return [path, *(one for ending in _BESIDE if (one := path.with_suffix(f".{ending}")).is_file())]


def _size(path: Path) -> tuple[int, int]:
    """Width and height of a picture as it is shown."""
    try:
        with open_picture(path) as picture:
            turned = picture.getexif().get(0x0112, 1) >= 5
            width, height = picture.size
    except (OSError, ValueError, SyntaxError):
        return 0, 0
    return (height, width) if turned else (width, height)


def _check(data: bytes, target: Path) -> None:
    """Raise a `Refusal` where bytes are no picture that can be read."""
    probe = target.with_name(f".{target.name}")
    if not data:
        raise Refusal("user_error", f"{target.name} is empty")
    try:
        write_bytes(probe, data)
        with open_picture(probe) as picture:
            picture.load()
            width, height = picture.size
    except (OSError, ValueError, SyntaxError, RuntimeError) as error:
        raise Refusal("user_error", f"{target.name} can't be read: it is damaged, or no picture"
                      ) from error
    finally:
        probe.unlink(missing_ok=True)
    if min(width, height) < 64:
        raise Refusal("user_error", f"{target.name} has {width} x {height} pixels; a painting "
                      "needs at least 64")


def write_picture(source: Path | UInt8, size: int, target: Path) -> None:
    """Write a painting, a file or uint8 [H, W, 3 or 4], with sides of at most ``size`` pixels.

    0: as large as a browser shows it well. The target's name says of which kind it is.
    """
    image = read_image(source) if isinstance(source, Path) else source
    picture = Image.fromarray(np.ascontiguousarray(image[..., :3]))
    picture.thumbnail((size or _SHOWN,) * 2, Image.Resampling.LANCZOS)
    with atomic_path(target) as temporary:
        picture.save(temporary, quality=92)


def write_regions(style: Style, data: bytes, size: tuple[int, int]) -> None:
    """Write a picture of regions, a PNG of places in `BY_HAND`, beside a painting of this size."""
    try:
        with Image.open(io.BytesIO(data), formats=["PNG"]) as picture:
            if picture.size != size:
                raise Refusal("bad_request", f"the picture of regions must have {size[0]} x "
                              f"{size[1]} pixels", field="size")
            values = np.asarray(picture if picture.mode in ("L", "P") else picture.convert("RGB"))
    except (OSError, ValueError, SyntaxError) as error:
        raise Refusal("bad_request", "the regions must come as a PNG", field="body") from error
    values = values[..., 0] if values.ndim == 3 else values
    if values.max(initial=0) >= len(BY_HAND):
        raise Refusal("bad_request", f"the regions' values must be 0 to {len(BY_HAND) - 1}",
                      field="body")
    target = style.beside("regions.png")
    if not values.any():
        target.unlink(missing_ok=True)
        return
    write_bytes(target, image_bytes(values.astype(np.uint8), "PNG"))
