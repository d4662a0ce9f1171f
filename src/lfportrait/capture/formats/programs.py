"""Cameras of other programs: Metashape (``cameras.xml``), Bundler (``bundle.out``), VisualSfM.

Each reader makes `Shot`s of its file: a photo's name, its pose and its lens. The photos are found
by name beside the file or in ``images``, with or without suffix, in any case.

Metashape's formulas are those of its manual (appendix "Camera models"), Bundler's those of its own
(Snavely et al. 2006), VisualSfM's those of ``README`` in its ``NVM_V3``.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...errors import UserError
from ...files import read_images
from ..distortion import Lens
from .assembly import Views, assemble, with_mask

__all__ = ["load_program", "program_file"]

Float64 = NDArray[np.float64]

_SUFFIXES = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp"}
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Shot:
    """One aligned photo of a program's file.

    Attributes
    ----------
    name
        File name or label.
    pose
        float64 [4, 4], camera-to-world, OpenCV axes; a common scale is allowed.
    lens
        Makes the lens of a picture of a width and a height in pixels.
    """

    name: str
    pose: Float64
    lens: Callable[[int, int], Lens]


def program_file(path: Path) -> Path | None:
    """The file with a program's cameras that ``path`` is, or that lies in this folder."""
    if path.is_file():
        return path if path.suffix.lower() in (".xml", ".out", ".nvm") else None
    for pattern in ("cameras.xml", "bundle.out", "bundle/bundle.out", "*.nvm"):
        for file in sorted(path.glob(pattern)):
            return file
    return None


def load_program(file: Path, holdout: int) -> Views:
    """Read the cameras of Metashape, Bundler or VisualSfM with their photos as a capture.

    Raises
    ------
    UserError
        If the file is damaged, or its photos are not found.
    """
    readers = {".xml": _metashape, ".out": _bundler, ".nvm": _visualsfm}
    try:
        shots = readers[file.suffix.lower()](file)
    except OSError as error:
        raise UserError(f"can't read {file}: {error.strerror or error}") from error
    except (ValueError, LookupError, AttributeError, TypeError, OverflowError,
            np.linalg.LinAlgError, ElementTree.ParseError) as error:
        raise UserError(f"{file} can't be read: {' '.join(str(error).split())}") from error
    if not shots:
        raise UserError(f"{file} has no aligned cameras")
    found = _photos(file.parent)
    known = [(shot, found[key]) for shot in shots if (key := _key(shot.name, found)) is not None]
    if not known:
        raise UserError(f"none of the photos named in {file} were found; put them into "
                        f"{file.parent / 'images'}")
    if len(known) < len(shots):
        warnings.warn(f"{len(shots) - len(known)} photos named in {file} are not there",
                      stacklevel=2)
    known.sort(key=lambda one: one[1].name)
    poses, lenses, pictures, names = [], [], [], []
    for (shot, path), picture in zip(known, read_images(path for _, path in known)):
        if isinstance(picture, UserError):
            warnings.warn(f"{picture}; left out", stacklevel=2)
            continue
        masks = [folder / "masks" / f"{stem}.png" for folder in (file.parent, path.parent.parent)
                 for stem in (path.name, path.stem, f"{path.stem}_mask")]
        pictures.append(with_mask(picture, masks))
        lenses.append(shot.lens(picture.shape[1], picture.shape[0]))
        poses.append(shot.pose)
        names.append(path.name)
    if not poses:
        raise UserError(f"none of the photos named in {file} can be read")
    return assemble(np.array(poses), lenses, pictures, names, None, holdout)


def _photos(folder: Path) -> dict[str, Path]:
    """Photos in a folder and in ``images`` by their names and stems in lower case."""
    found: dict[str, Path] = {}
    places = [folder / "images", folder, folder.parent / "images", folder.parent]
    for place in places:
        for path in sorted(place.iterdir()) if place.is_dir() else []:
            if path.suffix.lower() in _SUFFIXES and path.is_file():
                found.setdefault(path.name.lower(), path)
                found.setdefault(path.stem.lower(), path)
        if found:
            break
    return found


def _key(name: str, found: dict[str, Path]) -> str | None:
    """The key of a photo by the name or label that a program gives it."""
    own = name.replace("\\", "/").rsplit("/", 1)[-1].lower()
    stem = Path(own).stem if Path(own).suffix in _SUFFIXES else own
    return next((key for key in (own, stem) if key in found), None)


def _centred(name: str, focal: float, k: tuple[float, ...]) -> Callable[[int, int], Lens]:
    """A lens whose centre is the picture's, by its focal length in the picture's pixels."""
    if not focal > 0:
        raise ValueError(f"the focal length of {name} is {focal:g}")
    return lambda width, height: Lens(width, height, (focal, focal), (width / 2, height / 2), k=k)


def _metashape(file: Path) -> list[Shot]:
    """Agisoft Metashape's ``cameras.xml``."""
    text = file.read_bytes()
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise ValueError("it declares entities, which no camera file does")
    shots: list[Shot] = []
    for chunk in ElementTree.fromstring(text).iter("chunk"):
        lenses = {sensor.get("id"): _metashape_lens(sensor) for sensor in chunk.iter("sensor")}
        world = _chunk_transform(chunk.find("transform"))
        for camera in chunk.iter("camera"):
            transform = camera.find("transform")
            if transform is None or camera.get("enabled") in ("0", "false"):
                continue  # not aligned
            lens = lenses.get(camera.get("sensor_id"))
            if lens is None:
                raise ValueError(f"the sensor of {camera.get('label')} is not calibrated")
            pose = world @ np.array(str(transform.text).split(), np.float64).reshape(4, 4)
            pose[:3, :3] /= np.cbrt(np.linalg.det(pose[:3, :3]))
            shots.append(Shot(str(camera.get("label")), pose, lens))
    return shots


def _chunk_transform(transform: ElementTree.Element | None) -> Float64:
    """The similarity from a chunk to the world."""
    world = np.eye(4)
    if transform is None:
        return world
    rotation, shift, scale = (transform.find(name) for name in ("rotation", "translation", "scale"))
    if rotation is not None:
        world[:3, :3] = np.array(str(rotation.text).split(), np.float64).reshape(3, 3)
    if scale is not None:
        world[:3, :3] *= float(str(scale.text))
    if shift is not None:
        world[:3, 3] = np.array(str(shift.text).split(), np.float64)
    return world


def _metashape_lens(sensor: ElementTree.Element) -> Callable[[int, int], Lens] | None:
    """The adjusted calibration of a sensor; None where it has none."""
    calibrations = sensor.findall("calibration")
    adjusted = [one for one in calibrations if one.get("class") == "adjusted"] or calibrations
    if not adjusted:
        return None
    calibration = adjusted[0]
    kind = str(calibration.get("type") or sensor.get("type") or "frame")
    if kind not in ("frame", "fisheye"):
        raise ValueError(f"pictures of the type {kind} are not supported")

    def value(name: str) -> float:
        found = calibration.find(name)
        return 0.0 if found is None else float(str(found.text))

    size = calibration.find("resolution")
    size = sensor.find("resolution") if size is None else size
    if size is None:
        raise ValueError("a sensor has no resolution")
    width, height = int(size.get("width", 0)), int(size.get("height", 0))
    focal = value("f") or value("fx")
    if not focal > 0:
        raise ValueError("a sensor has no focal length")
    if value("b2") or (kind == "frame" and value("k4")):
        raise ValueError("skew (b2) and a fourth radial term (k4) are not supported; optimise the "
                         "cameras without them")
    k = tuple(value(f"k{i}") for i in range(1, 5 if kind == "fisheye" else 4))
    # Metashape numbers the tangential terms the other way round.
    lens = Lens(width, height, (focal + value("b1"), focal),
                (width / 2 + value("cx"), height / 2 + value("cy")),
                "fisheye" if kind == "fisheye" else "opencv", k, (value("p2"), value("p1")))

    def of_picture(wide: int, high: int) -> Lens:
        if abs(wide * height - high * width) > 2 * max(wide, high):
            raise UserError(f"the photos are {wide} x {high} pixels, their cameras {width} x "
                            f"{height}: turn the photos as the program saw them")
        return lens.resized(wide, high)

    return of_picture


def _bundler(file: Path) -> list[Shot]:
    """Bundler's ``bundle.out``, with the photos' names in ``list.txt``."""
    lists = [place / name for place in (file.parent, file.parent.parent)
             for name in ("list.txt", f"{file.stem}.list.txt", f"{file.name}.list.txt")]
    names = next(([line.split()[0] for line in place.read_text(encoding="utf-8").splitlines()
                   if line.strip()] for place in lists if place.is_file()), None)
    if names is None:
        raise ValueError("list.txt with the photos' names is missing beside it")
    lines = [line for line in file.read_text(encoding="utf-8").splitlines()
             if line.strip() and not line.startswith("#")]
    count = int(lines[0].split()[0])
    if count > len(names):
        raise ValueError(f"it has {count} cameras, list.txt {len(names)} photos")
    shots = []
    for number in range(count):
        part = [np.array(line.split(), np.float64) for line in lines[1 + 5 * number:][:5]]
        focal, k1, k2 = part[0]
        if focal == 0:
            continue  # not aligned
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = np.stack(part[1:4]), part[4]
        # Its cameras look along -z, y is up.
        shots.append(Shot(names[number], np.asarray(np.linalg.inv(_FLIP @ matrix), np.float64),
                          _centred(names[number], float(focal), (float(k1), float(k2)))))
    return shots


def _visualsfm(file: Path) -> list[Shot]:
    """VisualSfM's ``.nvm``, its first model."""
    lines = [line.strip() for line in file.read_text(encoding="utf-8").splitlines()]
    if not lines or not lines[0].startswith("NVM_V3"):
        raise ValueError("it does not begin with NVM_V3")
    rest = [line for line in lines[1:] if line and not line.startswith("#")]
    count = int(rest[0])
    shots = []
    for line in rest[1:1 + count]:
        name, numbers = (line.split("\t", 1) if "\t" in line else line.split(" ", 1))
        focal, w, x, y, z, *place, radial = np.array(numbers.split()[:9], np.float64)
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix().T
        pose[:3, 3] = place
        shots.append(Shot(name.strip('"'), pose,
                          _centred(name, float(focal), _undoing(float(radial)))))
    if len(shots) < count:
        raise ValueError(f"it ends after {len(shots)} of {count} cameras")
    return shots


def _undoing(radial: float) -> tuple[float, ...]:
    """Radial terms k1, k2, k3 that bend as VisualSfM's one term straightens.

    Straight = bent (1 + r |bent|^2), in units of the focal length; the terms are fitted within the
    field of a usual lens.
    """
    if radial == 0:
        return ()
    bent = np.linspace(0.01, 0.7, 200)
    straight = bent * (1 + radial * bent ** 2)
    if (np.diff(straight) <= 0).any():
        raise ValueError(f"its distortion {radial:g} folds the picture back")
    square = straight ** 2
    terms = np.linalg.lstsq(np.stack([square, square ** 2, square ** 3], axis=1),
                            bent / straight - 1, rcond=None)[0]
    return tuple(float(term) for term in terms)
