"""Projects: one folder for each sitter, with the files that the commands read and write.

::

    FOLDER/                      all projects
        .studio/                 the studio's own: jobs, logs
        paintings/               the user's paintings, for all sitters
        displays/                the user's panels, as display files
        anna/                    a project
            studio.json          what was last chosen
            photos/              photos, or one video; a calibrated data set
            left-out/            photos that are left out
            paintings/           paintings of this project, with NAME.landmarks.txt beside them
            portrait/            the job's folder: capture/, field.npz, as `lfportrait make` does
            painted/STYLE/       the head painted in full, one folder a painting
            versions/NAME/       a version: version.json, styled.npz, lightfield.png, ...
            exports/             what was exported
            .studio/             small pictures, checks, unfinished uploads: may be deleted

``lfportrait make anna/photos --style anna/paintings/ken.png --out anna/portrait`` goes on where the
studio stopped, and the reverse: nothing of a project's state lies anywhere else.
"""

import shutil
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from filelock import Timeout

from ..errors import UserError
from ..files import lock, read_json, write_json
from ..media.folders import visible
from ..media.kinds import PHOTOS, VIDEOS
from ..temporary import sweep_below
from .answers import Refusal, folder_name, free_place, id_of, is_id

OWN = ".studio"  # Folder of the studio's own files, in the projects' folder and in each project.
_TAKEN = ("paintings", "displays", "exports")
_MARKS = ("studio.json", "photos", "portrait", "capture", "field.npz")
"""A folder with one of these is a project."""


ADVICE = {"photos": "add photos of the sitter first",
          "capture": "make the head first: its cameras are not known yet",
          "field": "make the head first: its field is not there yet"}
"""What to do where something is missing."""


class Project:
    """One sitter's folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.id = id_of(folder.name)
        self.photos = folder / "photos"  # Or a data set.
        self.left_out = folder / "left-out"
        self.own = folder / OWN  # What may be deleted.

    # -- places -----------------------------------------------------------------------------------

    @property
    def job(self) -> Path:
        """Folder of the job: ``portrait/``, or the project's where it is a job's folder itself."""
        inside = self.folder / "portrait"
        plain = not inside.exists() and any((self.folder / name).exists()
                                            for name in ("capture", "field.npz"))
        return self.folder if plain else inside

    @property
    def source(self) -> Path:
        """What a capture is made of: the folder of photos, or the video in it."""
        videos = [path for path in self.files() if path.suffix.lower() in VIDEOS]
        return videos[0] if videos else self.photos

    @property
    def calibrated(self) -> bool:
        """Whether the photos are a data set with cameras, so that none can be left out."""
        return any(self.photos.glob("transforms*.json"))

    def files(self, place: Path | None = None) -> list[Path]:
        """The photos and videos in a folder, by default those that are used."""
        place = place or self.photos
        if place == self.photos and (place / "images").is_dir():
            place = place / "images"
        return _files(place)

    # -- state ------------------------------------------------------------------------------------

    def settings(self) -> dict[str, Any]:
        """What was last chosen."""
        return record_in(self.folder / "studio.json") or {}

    def change(self, **entries: Any) -> None:
        """Keep choices."""
        with _WRITING:
            write_json(self.folder / "studio.json", {**self.settings(), **entries})

    @property
    def name(self) -> str:
        """For people."""
        return str(self.settings().get("name") or self.folder.name)

    @property
    def display(self) -> str:
        """Id of the panel that the portrait is made for."""
        return str(self.settings().get("display") or "generic-4k")

    def has(self) -> dict[str, bool]:
        """What of the work is there."""
        return {"photos": bool(self.files()) or self.settings().get("demo", False),
                "checked": (self.own / "check.json").is_file(),
                "capture": (self.job / "capture" / "transforms.json").is_file(),
                "field": (self.job / "field.npz").is_file(),
                "styled": any(self._styled())}

    def _styled(self) -> Iterator[Path]:
        yield from (path for path in (self.job / "styled.npz",) if path.is_file())
        yield from (self.folder / "versions").glob("*/styled.npz")

    def need(self, *things: str) -> None:
        """Raise a `Refusal` where something is missing."""
        has = self.has()
        for thing in things:
            if not has[thing]:
                raise Refusal("not_ready", ADVICE[thing], needs=thing)

    def entry(self) -> dict[str, Any]:
        """As the page sees it, but for its job."""
        settings = self.settings()
        files = self.files()
        return {"id": self.id, "name": self.name,
                "created": settings.get("created", self.folder.stat().st_mtime),
                "changed": self._changed(), "photos": len(files),
                "left_out": len(self.files(self.left_out)),
                "video": any(path.suffix.lower() in VIDEOS for path in files), "has": self.has(),
                "display": self.display, "style": settings.get("style"),
                "version": settings.get("version"), "demo": bool(settings.get("demo")),
                "options": settings.get("options", {}),
                "placement": settings.get("placement", {}), "size_bytes": folder_bytes(self.folder)}

    def _changed(self) -> float:
        places = (self.folder / "studio.json", self.photos, self.job, self.job / "field.npz",
                  self.folder / "versions")
        return max([self.folder.stat().st_mtime, *(path.stat().st_mtime for path in places
                                                   if path.exists())])


class Projects:
    """All projects in one folder, made if missing, which one studio has open at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.absolute()
        self.own = self.folder / OWN  # The studio's own files.
        try:
            self.own.mkdir(parents=True, exist_ok=True)
            self._lock = lock(self.own / "lock")
        except Timeout as error:
            raise UserError(f"another studio has {folder} open; use that one, or choose another "
                            "folder with --folder") from error
        except OSError as error:
            raise UserError(f"can't write to {folder}: {error.strerror}; choose another folder "
                            "with --folder") from error
        sweep_below(self.folder)  # of jobs that were killed with the studio

    def close(self) -> None:
        """Let another studio open the folder."""
        self._lock.release()

    def all(self) -> list[Project]:
        """All projects, by name."""
        folders = sorted(path for path in self.folder.iterdir()
                         if path.is_dir() and path.name[0] != "." and path.name not in _TAKEN)
        return [Project(path) for path in folders if any((path / mark).exists() for mark in _MARKS)]

    def get(self, name: str) -> Project:
        """A project by its id."""
        if is_id(name):
            for project in self.all():
                if project.id == name:
                    return project
        raise Refusal("not_found", "there is no such project any more")

    def create(self, name: str, demo: bool = False) -> Project:
        """A new project."""
        folder = folder_name(name)
        if folder.lower() in _TAKEN:
            raise Refusal("bad_name", f"{name!r} is taken by the studio's own folders")
        self._sweep(folder)
        if folder.lower() in {path.name.lower() for path in self.folder.iterdir()}:
            raise Refusal("exists", f"there is a project or folder {name!r} already; choose "
                          "another name")
        project = Project(self.folder / folder)
        project.photos.mkdir(parents=True)
        project.change(name=name, created=round(time.time(), 3), demo=demo,
                       display="generic-1080p" if demo else "generic-4k",
                       **({"options": {"quick": True}} if demo else {}))
        return project

    def remove(self, project: Project) -> str:
        """Move a project into the trash; its name there."""
        target = free_place(self.folder / ".trash", project.folder.name)
        shutil.move(project.folder, target)
        return target.name

    def restore(self, name: str) -> Project:
        """Take a project out of the trash again, by its name there."""
        trash = self.folder / ".trash"
        found = [path for path in trash.iterdir() if path.name == name] if trash.is_dir() else []
        if not found:
            raise Refusal("not_found", "this sitter is not in .trash any more")
        self._sweep(name)
        target = free_place(self.folder, name)
        shutil.move(found[0], target)
        return Project(target)

    def _sweep(self, name: str) -> None:
        """Remove what may be left of a sitter of this name who is gone.

        A small picture that was made while the folder went into the trash makes it again, with
        nothing but the studio's own files in it.
        """
        for path in [*self.folder.iterdir()]:
            if (path.name.lower() == name.lower() and path.is_dir() and not path.is_symlink()
                    and [one.name for one in path.iterdir()] == [OWN]):
                shutil.rmtree(path, ignore_errors=True)


_WRITING = threading.RLock()


def record_in(path: Path) -> dict[str, Any] | None:
    """What a file of JSON records; None where there is none, or it is damaged."""
    try:
        found = read_json(path)
    except UserError:
        return None
    return found if isinstance(found, dict) else None


def _files(place: Path) -> list[Path]:
    return [path for path in visible(place)
            if path.suffix.lower() in PHOTOS | VIDEOS and path.is_file()]


def folder_bytes(folder: Path) -> int:
    """Bytes of all files of a folder."""
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.stat().st_size if path.is_file() else 0
        except OSError:
            continue
    return total
