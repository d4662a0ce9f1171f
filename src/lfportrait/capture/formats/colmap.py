"""COLMAP models, binary and text, read without COLMAP.

A model is a folder with ``cameras`` and ``images``, both ``.bin`` or both ``.txt`` (the sparse
points are not needed). COLMAP's image frame is ours: x right, y down, z forward, pixel centres at
+0.5; its poses are world-to-camera, as a unit quaternion (w, x, y, z) and a translation.
"""

import re
import struct
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ...arrays import Float64
from ...errors import UserError
from ...media.folders import Finder
from ..lenses import Lens
from .assembly import CaptureFormat, DataSet, Shot

# At COLMAP's own model ids: name, number of parameters, how many of these are focal lengths, and
# our name of how it bends; empty where that is not supported.
_MODELS = (
    ("SIMPLE_PINHOLE", 3, 1, "opencv"), ("PINHOLE", 4, 2, "opencv"),
    ("SIMPLE_RADIAL", 4, 1, "opencv"), ("RADIAL", 5, 1, "opencv"), ("OPENCV", 8, 2, "opencv"),
    ("OPENCV_FISHEYE", 8, 2, "fisheye"), ("FULL_OPENCV", 12, 2, "opencv"), ("FOV", 5, 2, "fov"),
    ("SIMPLE_RADIAL_FISHEYE", 4, 1, "fisheye"), ("RADIAL_FISHEYE", 5, 1, "fisheye"),
    ("THIN_PRISM_FISHEYE", 12, 2, "thin_prism"), ("RAD_TAN_THIN_PRISM_FISHEYE", 16, 2, ""),
    ("SIMPLE_DIVISION", 4, 1, ""), ("DIVISION", 5, 2, ""), ("SIMPLE_FISHEYE", 3, 1, "fisheye"),
    ("FISHEYE", 4, 2, "fisheye"), ("EUCM", 6, 2, ""), ("EQUIRECTANGULAR", 2, 0, ""),
)
_BY_NAME = {name: (count, focals, bends) for name, count, focals, bends in _MODELS}
_IMAGE_FOLDERS = ("images", "input", "rgb", "images_2", "images_4", "images_8")


@dataclass(frozen=True)
class ColmapImage:
    """One registered photo: its name, its camera's id and its pose.

    The pose is camera-to-world, float64 [4, 4], with OpenCV axes.
    """

    name: str
    camera: int
    pose: Float64


def lens_of(model: str, width: int, height: int, parameters: Iterable[float]) -> Lens:
    """A COLMAP camera of this model and size in pixels as a lens; parameters in COLMAP's order.

    Raises `UserError` if they make no sense, or the model is none of SIMPLE_PINHOLE, PINHOLE,
    SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, FOV, SIMPLE_FISHEYE, FISHEYE, OPENCV_FISHEYE,
    SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE and THIN_PRISM_FISHEYE.
    """
    if min(width, height) < 1:
        raise UserError(f"a COLMAP camera has pictures of {width} x {height} pixels; export the "
                        "model again")
    p = [float(value) for value in parameters]
    count, focals, bends = _BY_NAME.get(model, (len(p), 0, ""))
    if len(p) != count:
        raise UserError(f"a COLMAP camera of model {model} has {len(p)} parameters instead of "
                        f"{count}; export the model again")
    if not bends:
        raise UserError(f"COLMAP's camera model {model} is not supported; undistort the pictures "
                        "first (colmap image_undistorter) or calibrate them again")
    x, y, *rest = p[focals:]
    lens = Lens(width, height, (p[0], p[focals - 1]), (x, y), bends, tuple(rest))
    if bends in ("opencv", "thin_prism") and len(rest) > 2:
        # Tangential terms stand behind two radial ones, those of the prism at the end.
        radial = (*rest[:2], *rest[4:])
        lens = replace(lens, k=radial, p=(rest[2], rest[3]))
        if bends == "thin_prism":
            lens = replace(lens, k=radial[:4], s=(radial[4], radial[5]))
    return lens


def _pose(quaternion: Iterable[float], translation: Iterable[float]) -> Float64:
    """Camera-to-world [4, 4] from COLMAP's world-to-camera quaternion and translation."""
    w, x, y, z = np.array(list(quaternion)) / np.linalg.norm(list(quaternion))
    rotation = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])
    pose = np.eye(4)
    pose[:3, :3] = rotation.T
    pose[:3, 3] = -rotation.T @ np.array(list(translation))
    return pose


def _unpack(stream: BinaryIO, layout: str) -> tuple[float, ...]:
    size = struct.calcsize("<" + layout)
    data = stream.read(size)
    if len(data) < size:
        raise ValueError("the file ends too early")
    return struct.unpack("<" + layout, data)


def _name(stream: BinaryIO) -> str:
    letters = bytearray()
    while (letter := stream.read(1)) != b"\0":
        if not letter:
            raise ValueError("the file ends too early")
        letters += letter
    return letters.decode()


def _read_binary(folder: Path) -> tuple[dict[int, Lens], list[ColmapImage]]:
    lenses: dict[int, Lens] = {}
    images = []
    with open(folder / "cameras.bin", "rb") as stream:
        for _ in range(int(_unpack(stream, "Q")[0])):
            number, model, width, height = map(int, _unpack(stream, "iiQQ"))
            name, count = (_MODELS[model][:2] if 0 <= model < len(_MODELS)
                           else (f"number {model}", 0))
            lenses[number] = lens_of(name, width, height, _unpack(stream, f"{count}d"))
    with open(folder / "images.bin", "rb") as stream:
        for _ in range(int(_unpack(stream, "Q")[0])):
            values = _unpack(stream, "I7dI")
            name = _name(stream)
            stream.seek(24 * int(_unpack(stream, "Q")[0]), 1)  # the image's points
            images.append(ColmapImage(name, int(values[8]), _pose(values[1:5], values[5:8])))
    return lenses, images


def _read_text(folder: Path) -> tuple[dict[int, Lens], list[ColmapImage]]:
    lenses: dict[int, Lens] = {}
    for line in (folder / "cameras.txt").read_text("utf-8-sig").split("\n"):
        if line.strip() and not line.startswith("#"):
            number, model, width, height, *values = line.split()
            lenses[int(number)] = lens_of(model, int(width), int(height), map(float, values))
    return lenses, _images_of((folder / "images.txt").read_text("utf-8-sig"))


def _images_of(text: str) -> list[ColmapImage]:
    """The images of ``images.txt``.

    Each has two lines; the second lists its points, may be empty and is left out by some programs.
    """
    images: list[ColmapImage] = []
    stated: int | None = None
    after_image = False
    for number, line in enumerate(text.split("\n"), 1):
        if line.startswith("#"):
            noted = re.match(r"#\s*Number of images:\s*(\d+)", line)
            stated = int(noted[1]) if noted else stated
        elif after_image and _lists_points(line):
            after_image = False
        elif line.strip():
            try:
                images.append(_image_of(line))
            except (ValueError, IndexError) as error:
                raise ValueError(f"line {number} of images.txt is no image") from error
            after_image = True
    if stated is not None and stated != len(images):
        raise ValueError(f"images.txt says that it lists {stated} images, but lists {len(images)}; "
                         "export it again")
    return images


def _lists_points(line: str) -> bool:
    """Whether a line is an image's second one: triples x, y, point's id; or nothing."""
    parts = line.split()
    if len(parts) % 3:
        return False
    try:
        for first in range(0, len(parts), 3):
            float(parts[first]), float(parts[first + 1]), int(parts[first + 2])
    except ValueError:
        return False
    return True


def _image_of(line: str) -> ColmapImage:
    """An image's first line: id, quaternion, translation, camera's id, name."""
    number, *parts = line.split(maxsplit=9)
    int(number)
    values = [float(part) for part in parts[:7]]
    return ColmapImage(parts[8].strip(), int(parts[7]), _pose(values[:4], values[4:]))


def read_model(folder: Path) -> tuple[dict[int, Lens], list[ColmapImage]]:
    """Read a COLMAP model: its cameras by their id, and its registered photos sorted by name.

    The folder holds ``cameras.bin`` and ``images.bin``, or both as ``.txt``. Raises `UserError` if
    the model is missing, damaged or uses a camera model that is not supported.
    """
    try:
        binary = (folder / "cameras.bin").is_file()
        lenses, images = _read_binary(folder) if binary else _read_text(folder)
    except FileNotFoundError as error:
        raise UserError(f"{error.filename} is missing: a COLMAP model needs cameras and images, "
                        "both .bin or both .txt") from error
    except (OSError, ValueError, IndexError, struct.error) as error:
        raise UserError(f"the COLMAP model in {folder} is damaged: {error}") from error
    if not images:
        raise UserError(f"the COLMAP model in {folder} has no registered photos; calibrate again")
    orphans = [image.name for image in images if image.camera not in lenses]
    if orphans:
        raise UserError(f"the COLMAP model in {folder} is damaged: no camera for {orphans[0]}")
    return lenses, sorted(images, key=lambda image: image.name)


def _photo_folder(model: Path, root: Path, names: list[str], finder: Finder) -> Path:
    """The folder that holds the model's photos: ``images`` beside the model, or above it."""
    roots = dict.fromkeys([root, model, *list(model.parents)[:3]])
    for base in roots:
        for folder in [base / name for name in _IMAGE_FOLDERS] + [base]:
            if any(finder.find(folder, name) is not None for name in names):
                return folder
    raise UserError(f"the photos of the COLMAP model in {model} were not found; put them into "
                    f"{root / 'images'}")


def _photo_count(model: Path) -> int:
    """Photos of a COLMAP model; 0 where it can't be read."""
    try:
        return len(read_model(model)[1])
    except UserError:
        return 0


class Colmap(CaptureFormat):
    """COLMAP's models.

    Masks, by COLMAP's custom ``masks/NAME.png`` for the photo ``NAME``, suffix included, become
    the photos' alpha.
    """

    name, files = "COLMAP", "COLMAP model"

    def recognises(self, path: Path) -> bool:
        return path.is_dir() and bool(_colmap_models(path))

    def read(self, path: Path, holdout: int) -> DataSet:
        model = _largest_model(_colmap_models(path), path)
        lenses, images = read_model(model)
        finder = Finder()
        folder = _photo_folder(model, path, [image.name for image in images], finder)
        return DataSet(self.name, [
            _shot(image, lenses[image.camera], finder.find(folder, image.name)
                  or folder / image.name, path) for image in images], model)


def _colmap_models(path: Path) -> list[Path]:
    """Folders with a COLMAP model: where COLMAP and programs that call it leave them."""
    found = []
    for part in ("", "sparse", "colmap/sparse", "dense/sparse", "dense/0/sparse",
                 "distorted/sparse", "colmap"):
        folder = path / part
        numbered = (sorted((one for one in folder.iterdir() if one.is_dir() and one.name.isdigit()),
                           key=lambda one: int(one.name)) if folder.is_dir() else [])
        found += [place for place in (folder, *numbered)
                  if any((place / f"cameras.{kind}").is_file() for kind in ("bin", "txt"))]
        if found:
            break
    return found


def _largest_model(models: list[Path], root: Path) -> Path:
    """The model with the most photos; a line says so where there are others."""
    if len(models) == 1:
        return models[0]
    counts = [_photo_count(model) for model in models]
    best = int(np.argmax(counts))
    warnings.warn(f"{root} has {len(models)} COLMAP models; the largest, "
                  f"{models[best].relative_to(root)} with {counts[best]} photos, is taken",
                  stacklevel=2)
    return models[best]


def _shot(image: ColmapImage, lens: Lens, path: Path, root: Path) -> Shot:
    return Shot(path, image.name.replace("/", "_"), image.pose, lens.resized,
                (lens.width, lens.height), (root / "masks",), image.name)
