"""Captures from the camera files of photogrammetry programs.

- Agisoft Metashape: ``cameras.xml``;
- RealityCapture and RealityScan: the CSV of "internal/external camera parameters";
- Meshroom (AliceVision) and OpenMVG: ``cameras.sfm``, ``sfm.json``, ``sfm_data.json``;
- Bundler: ``bundle.out`` with ``list.txt``; VisualSfM: ``.nvm``.

Each reader makes shots of its file. They are found by their names beside the file or in
``images``, with or without folder and suffix, in any case.

Agisoft Metashape: the formulas are those of its manual (appendix "Camera models"). In a rig
("multi-camera system") only photos of the master have poses. The sensor of another photo has
``rotation`` and ``location``: how it lies in its master, in the units of the chunk. So its pose is
the master's times that, as ``metashape_to_krt.py`` of Meta's EyefulTower has it, which its authors
test on rigs of 9 and 22 cameras.

AliceVision (``cameras.sfm``, ``sfm.json``) writes all numbers as text, rotations camera-to-world by
rows; from version 1.2.1 the centre is noted from the picture's middle, from 1.2.2 the focal length
in millimetres of the sensor. OpenMVG (``sfm_data.json``) wraps its records, rotations are
world-to-camera. Both have OpenCV's axes and distortion; in both views, poses and intrinsics refer
to each other, as `transforms` needs to know, too.

The text formats: Bundler's formulas are those of its manual (Snavely et al. 2006), VisualSfM's
those of the README to its ``NVM_V3``. RealityCapture (RealityScan) writes focal lengths as of 35-mm
film, centre and distortion in parts of the longer side and of the focal length, and poses as x, y,
height, heading, pitch, roll in degrees, where a camera without any of them looks straight down with
its upper edge to the north (Epic's "camera math" of its XMP files).
"""

import csv
import warnings
from abc import abstractmethod
from collections.abc import Callable, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar
from xml.etree import ElementTree

import numpy as np

from ...arrays import Float64
from ...errors import UserError
from ...files import read_json
from ...media.folders import folded, folders_below, is_junk, natural_key, visible
from ...media.kinds import PHOTOS
from ..lenses import Lens
from .assembly import FLIP, CaptureFormat, DataSet, Shot

_UNFOUND = Path()  # The picture's file until `_Program` has looked for it.


def resizable(lens: Lens) -> tuple[Callable[[int, int], Lens], tuple[int, int]]:
    """A lens of known picture size as a `Shot` has it: for reduced copies too."""
    return lens.resized, (lens.width, lens.height)


def centred(name: str, focal: float, k: tuple[float, ...]) -> Callable[[int, int], Lens]:
    """A lens whose centre is the picture's, by its focal length in the picture's pixels."""
    if not focal > 0:
        raise ValueError(f"the focal length of {name} is {focal:g}")
    return lambda width, height: Lens(width, height, (focal, focal), (width / 2, height / 2), k=k)


def brown(lens: Lens, k: tuple[float, float, float, float]) -> Lens:
    """The lens with the radial polynomial 1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8.

    So Metashape, RealityCapture and nerfstudio bend; OpenCV's fourth term is another one.
    """
    return replace(lens, model="brown", k=k) if k[3] else replace(lens, model="opencv", k=k[:3])


def fisheye(lens: Lens, k: tuple[float, float, float, float]) -> Lens:
    """The fisheye lens with the tangential terms ``lens.p``, of the bent coordinates.

    So Metashape and nerfstudio bend; OpenCV's fisheye has no such terms.
    """
    return replace(lens, model="thin_prism" if any(lens.p) else "fisheye", k=k)


def warn_left_out(count: int, total: int, file: Path, why: str = "are not aligned") -> None:
    """Say in one line that ``count`` of the ``total`` photos of a file are left out.

    Where that is none, nothing is to be said; where it is all, the reader says more.
    """
    if 0 < count < total:
        warnings.warn(f"{count} of {total} photos in {file} {why} and are left out", stacklevel=3)


def warn_unmatched(pictures: Set[str], cameras: Set[str], folder: Path, place: Path) -> None:
    """Say which pictures of a folder have no camera, and which cameras no picture: a line each.

    They belong together by their names, among which hidden files don't count.
    """
    pictures, cameras = ({name for name in names if not name.startswith(".")}
                         for names in (pictures, cameras))
    warn_left_out(len(pictures - cameras), len(pictures), folder, f"have no camera in {place}")
    lost = len(cameras - pictures)
    if lost:
        warnings.warn(f"{lost} of {len(cameras)} cameras in {place} have no photo in {folder} and "
                      "are left out", stacklevel=3)


def is_graph(file: Path) -> bool:
    """Whether a JSON file begins as these programs' files do (they can be of 100 MB)."""
    try:
        with open(file, encoding="utf-8-sig") as stream:
            head = stream.read(4096)
    except (OSError, ValueError):
        return False
    return ('"sfm_data_version"' in head
            or ('"version"' in head and ('"views"' in head or '"featuresFolders"' in head)))


def read_graph(file: Path) -> list[Shot]:
    """The photos with poses of Meshroom's or OpenMVG's file."""
    data = read_json(file)
    found = _openmvg(data) if "sfm_data_version" in data else _alicevision(data)
    warn_left_out(len(data["views"]) - len(found), len(data["views"]), file)
    return found


def _alicevision(data: dict[str, Any]) -> list[Shot]:
    version = tuple(int(part) for part in data["version"])
    lenses = {record["intrinsicId"]: _alicevision_lens(record, version)
              for record in data.get("intrinsics") or []}
    poses = {}
    for record in data.get("poses") or []:
        transform = record["pose"]["transform"]
        poses[record["poseId"]] = pose_of(np.array(transform["rotation"], np.float64).reshape(3, 3),
                                        transform["center"])
    found = []
    for view in data["views"]:
        pose, lens = poses.get(view["poseId"]), lenses.get(view["intrinsicId"])
        if pose is None:
            continue  # not aligned
        if lens is None:
            raise ValueError(f"the camera of {view['path']} is missing")
        if int(view.get("subPoseId", -1)) not in (-1, 4294967295):
            raise ValueError("it has rigs of cameras; export it without rigs")
        found.append(Shot(_UNFOUND, str(view["path"]), pose, *resizable(lens)))
    return found


def pose_of(rotation: Float64, center: Any) -> Float64:
    """Camera-to-world [4, 4]."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, np.array(center, np.float64)
    return pose


def _alicevision_lens(record: dict[str, Any], version: tuple[int, ...]) -> Lens:
    width, height = int(record["width"]), int(record["height"])
    if float(record.get("pixelRatio", 1)) != 1:
        raise ValueError("anamorphic lenses are not supported")
    if version >= (1, 2, 2):
        focal = float(record["focalLength"]) * width / float(record["sensorWidth"])
        pair = focal, focal
    else:
        noted = record["pxFocalLength"]
        noted = noted if isinstance(noted, list) else [noted, noted]
        pair = float(noted[0]), float(noted[1])
    x, y = (float(value) for value in record["principalPoint"])
    if version >= (1, 2, 1):
        x, y = x + width / 2, y + height / 2
    kind = str(record.get("type"))
    bend = str(record.get("distortionType", "none"))
    terms = [float(term) for term in record.get("distortionParams") or []]
    return _bent(Lens(width, height, pair, (x, y)), kind if bend == "none" else bend, terms)


def _bent(lens: Lens, kind: str, terms: list[float]) -> Lens:
    """A lens with the distortion that both programs name so."""
    if not any(terms):
        if kind.startswith(("fisheye", "equidistant", "spherical")):
            raise ValueError(f"cameras of the type {kind} are not supported")
        return lens
    if kind in ("radial1", "radialk1", "pinhole_radial_k1", "radial3", "radialk3",
                "pinhole_radial_k3"):
        k1, k2, k3, t1, t2 = (*terms, 0.0, 0.0, 0.0, 0.0)[:5]
    elif kind in ("brown", "brownt2", "pinhole_brown_t2") and len(terms) == 5:
        k1, k2, k3, t1, t2 = terms
    elif kind in ("fisheye", "fisheye4") and len(terms) == 4:
        return Lens(lens.width, lens.height, lens.focal, lens.center, "fisheye", tuple(terms))
    else:
        raise ValueError(f"cameras of the type {kind} are not supported; calibrate with a "
                         "radial, brown or fisheye model")
    return replace(lens, k=(k1, k2, k3), p=(t1, t2))


def _openmvg(data: dict[str, Any]) -> list[Shot]:
    lenses = {}
    names: dict[Any, str] = {}  # a kind is named where it is used first
    for record in data.get("intrinsics") or []:
        value = record["value"]
        number = value.get("polymorphic_id", 0) & 0x7FFFFFFF
        kind = names.setdefault(number, str(value.get("polymorphic_name", "pinhole")))
        inner = value["ptr_wrapper"]["data"]
        base = inner.get("value0", inner)
        terms = [float(term) for key, terms in inner.items()
                 if key.startswith(("disto", "fisheye")) for term in terms]
        focal = float(base["focal_length"])
        x, y = (float(number) for number in base["principal_point"])
        lenses[record["key"]] = _bent(Lens(int(base["width"]), int(base["height"]),
                                           (focal, focal), (x, y)), kind, terms)
    poses = {record["key"]: pose_of(np.array(record["value"]["rotation"], np.float64).T,
                                  record["value"]["center"])
             for record in data.get("extrinsics") or []}
    found = []
    for record in data["views"]:
        view = record["value"]["ptr_wrapper"]["data"]
        pose, lens = poses.get(view["id_pose"]), lenses.get(view["id_intrinsic"])
        if pose is not None and lens is not None:
            place = "/".join(part for part in (str(view.get("local_path") or ""),
                                               str(view["filename"])) if part)
            found.append(Shot(_UNFOUND, place, pose, *resizable(lens)))
    return found


def read_metashape(file: Path) -> list[Shot]:
    """The aligned photos of the file's chunks.

    Of a chunk whose photos fell into several components the largest is taken, as nothing says how
    they lie to each other.
    """
    text = file.read_bytes()
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise ValueError("it declares XML entities, which are not allowed")
    found: list[Shot] = []
    total = loose = away = 0
    for chunk in ElementTree.fromstring(text).iter("chunk"):
        photos = _metashape_photos(chunk)
        parts = _components(chunk, photos)
        taken = sorted(parts.values(), key=len)[-1] if parts else []
        kept = sum(map(len, parts.values()))
        if len(parts) > 1:
            warnings.warn(f"{file} has {len(parts)} components that are not aligned to each other; "
                          f"the largest is taken, {len(taken)} of {kept} photos", stacklevel=2)
        hanging = sum(one.loose and one.enabled for one in photos)
        total, loose = total + len(photos), loose + hanging
        away += len(photos) - kept - hanging
        found += taken
    warn_left_out(loose, total, file, "are in a rig whose geometry is not noted (align again, or "
                  "export without the rig)")
    warn_left_out(away, total, file, "are not aligned or switched off")
    return found


@dataclass(frozen=True)
class _Photo:
    """A photo as its chunk has it."""

    record: ElementTree.Element  # Its element.
    component: str | None  # Id of the component that it is aligned in.
    pose: Float64 | None  # float64 [4, 4], camera to component; None where it is not aligned.
    # Whether it hangs on an aligned master in a way that the file does not say.
    loose: bool = False

    @property
    def enabled(self) -> bool:
        """Whether it is in use."""
        return self.record.get("enabled") not in ("0", "false")


def _components(chunk: ElementTree.Element, photos: list[_Photo]) -> dict[str | None, list[Shot]]:
    """The aligned photos that are in use, by their component, in the world."""
    lenses = {sensor.get("id"): _lens(sensor) for sensor in chunk.iter("sensor")}
    whole = _similarity(chunk.find("transform"), np.eye(4))
    worlds = {part.get("id"): _similarity(part.find("transform"), whole)
              for part in chunk.findall("components/component")}
    parts: dict[str | None, list[Shot]] = {}
    for photo in photos:
        if photo.pose is None or not photo.enabled:
            continue
        label = str(photo.record.get("label"))
        lens = lenses.get(photo.record.get("sensor_id"))
        if lens is None:
            raise ValueError(f"the sensor of {label} is not calibrated")
        pose = worlds.get(photo.component, whole) @ photo.pose
        pose[:3, :3] /= np.cbrt(np.linalg.det(pose[:3, :3]))
        parts.setdefault(photo.component, []).append(Shot(_UNFOUND, label, pose, *resizable(lens)))
    return parts


def _metashape_photos(chunk: ElementTree.Element) -> list[_Photo]:
    """The photos of a chunk, those in groups or within their master's element included."""
    sensors = {sensor.get("id"): sensor for sensor in chunk.iter("sensor")}
    cameras = {camera.get("id"): camera for camera in chunk.iter("camera")}
    photos = []
    for camera in chunk.iter("camera"):
        pose, part = _matrix(camera), camera.get("component_id")
        master = cameras.get(camera.get("master_id", ""))
        base = None if master is None else _matrix(master)
        if pose is None and master is not None and base is not None:
            sensor = sensors.get(camera.get("sensor_id"))
            offset = None if sensor is None else _offset(sensor, master.get("sensor_id"))
            photos.append(_Photo(camera, master.get("component_id"),
                                 None if offset is None else base @ offset, offset is None))
        else:
            photos.append(_Photo(camera, part, pose))
    return photos


def _matrix(camera: ElementTree.Element) -> Float64 | None:
    """Camera-to-chunk [4, 4] as a photo has it; None where it has none."""
    transform = camera.find("transform")
    if transform is None:
        return None
    return np.array(str(transform.text).split(), np.float64).reshape(4, 4)


def _offset(sensor: ElementTree.Element, master: str | None) -> Float64 | None:
    """How a rig's sensor lies in its master [4, 4]; None where that is not noted."""
    rotation, location = sensor.find("rotation"), sensor.find("location")
    if sensor.get("master_id") != master or rotation is None:
        return None
    offset = np.eye(4)
    offset[:3, :3] = np.array(str(rotation.text).split(), np.float64).reshape(3, 3)
    if location is not None:  # cameras with one centre, as multispectral ones, have none
        offset[:3, 3] = np.array(str(location.text).split(), np.float64)
    return offset


def _similarity(transform: ElementTree.Element | None, otherwise: Float64) -> Float64:
    """The similarity from a chunk or component to the world; ``otherwise`` where it has none."""
    if transform is None:
        return otherwise
    world = np.eye(4)
    rotation, shift, scale = (transform.find(name) for name in ("rotation", "translation", "scale"))
    if rotation is not None:
        world[:3, :3] = np.array(str(rotation.text).split(), np.float64).reshape(3, 3)
    if scale is not None:
        world[:3, :3] *= float(str(scale.text))
    if shift is not None:
        world[:3, 3] = np.array(str(shift.text).split(), np.float64)
    return world


def _lens(sensor: ElementTree.Element) -> Lens | None:
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
    if value("fx"):
        raise ValueError("its cameras are those of PhotoScan before 1.2 (fx); export them by a "
                         "later version")
    focal = value("f")
    if not focal > 0:
        raise ValueError("a sensor has no focal length")
    for name, what in (("b2", "skew (b2)"), ("p3", "its tangential term p3"),
                       ("p4", "its tangential term p4")):
        if value(name):
            raise ValueError(f"{what} is not supported; optimise the cameras without it")
    k = value("k1"), value("k2"), value("k3"), value("k4")
    # Metashape numbers the tangential terms the other way round.
    lens = Lens(width, height, (focal + value("b1"), focal),
                (width / 2 + value("cx"), height / 2 + value("cy")),
                p=(value("p2"), value("p1")))
    return (fisheye if kind == "fisheye" else brown)(lens, k)


_COLUMNS = {"x", "y", "alt", "heading", "pitch", "roll", "f"}


def is_camera_table(file: Path) -> bool:
    """Whether a CSV file has the columns of RealityCapture's cameras."""
    try:
        with open(file, encoding="utf-8-sig") as stream:
            first = stream.readline(4096)
    except (OSError, ValueError):
        return False
    names = {name.strip().lower() for name in first.split(",")}
    return names >= _COLUMNS and bool(names & {"#name", "name"})


def read_camera_table(file: Path) -> list[Shot]:
    """RealityCapture's and RealityScan's "internal/external camera parameters"."""
    from scipy.spatial.transform import Rotation  # a tenth of a second that few commands need

    if not is_camera_table(file):
        raise ValueError("it lacks the columns name, x, y, alt, heading, pitch, roll, f; export "
                         "the registration as internal/external camera parameters")
    with open(file, encoding="utf-8-sig", newline="") as stream:
        rows = [{str(key).strip().lower().lstrip("#"): value for key, value in row.items()}
                for row in csv.DictReader(stream)]
    found = []
    for row in rows:
        name = str(row["name"] or "").strip()
        if not name:
            continue
        place, angles = ([float(row[key] or "") for key in keys]
                         for keys in (("x", "y", "alt"), ("heading", "pitch", "roll")))
        rotation = Rotation.from_euler("ZXY", [-angles[0], angles[1], angles[2]], degrees=True)
        terms = [float(row.get(key) or 0.0) for key in
                 ("f", "px", "py", "k1", "k2", "k3", "k4", "t1", "t2")]
        if not terms[0] > 0:
            raise ValueError(f"the focal length of {name} is {terms[0]:g}")
        found.append(Shot(_UNFOUND, name, pose_of(rotation.as_matrix(), place) @ FLIP,
                          _of_film(terms)))
    return found


def _of_film(terms: list[float]) -> Callable[[int, int], Lens]:
    """A lens from f in millimetres of 35-mm film, px, py, k1 to k4, t1, t2."""
    focal, px, py, k1, k2, k3, k4, t1, t2 = terms

    def of_picture(width: int, height: int) -> Lens:
        side = max(width, height)
        pixels = focal * side / 36.0
        return brown(Lens(width, height, (pixels, pixels),
                          (width / 2 + px * side, height / 2 + py * side), p=(t1, t2)),
                     (k1, k2, k3, k4))

    return of_picture


def read_bundler(file: Path) -> list[Shot]:
    """Bundler's ``bundle.out``, with the photos' names in ``list.txt``."""
    lists = [place / name for place in (file.parent, file.parent.parent)
             for name in ("list.txt", f"{file.stem}.list.txt", f"{file.name}.list.txt")]
    names = next(([_listed(line) for line in place.read_text("utf-8-sig").splitlines()
                   if line.strip()] for place in lists if place.is_file()), None)
    if names is None:
        raise ValueError("list.txt with the photos' names is missing beside it")
    lines = [line for line in file.read_text("utf-8-sig").splitlines()
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
        # Its cameras look along -z, y is up.
        pose = np.linalg.inv(FLIP @ pose_of(np.stack(part[1:4]), part[4]))
        shots.append(Shot(_UNFOUND, names[number], np.asarray(pose, np.float64),
                          centred(names[number], float(focal), (float(k1), float(k2)))))
    warn_left_out(count - len(shots), count, file)
    return shots


def _listed(line: str) -> str:
    """The photo that a line of ``list.txt`` names, before a zero and its noted focal length."""
    parts = line.strip().rsplit(None, 2)
    return parts[0] if len(parts) == 3 and parts[1] == "0" else line.strip()


def read_visualsfm(file: Path) -> list[Shot]:
    """VisualSfM's ``.nvm``, its first model."""
    from scipy.spatial.transform import Rotation

    lines = [line.strip() for line in file.read_text("utf-8-sig").splitlines()]
    if not lines or not lines[0].startswith("NVM_V3"):
        raise ValueError("it does not begin with NVM_V3")
    if "FixedK" in lines[0]:
        raise ValueError("its calibration was fixed (FixedK), which is not supported; run "
                         "VisualSfM without")
    rest = [line for line in lines[1:] if line and not line.startswith("#")]
    count = int(rest[0])
    shots = []
    for line in rest[1:1 + count]:
        name, numbers = (line.split("\t", 1) if "\t" in line else line.split(" ", 1))
        focal, w, x, y, z, *place, radial = np.array(numbers.split()[:9], np.float64)
        pose = pose_of(Rotation.from_quat([x, y, z, w]).as_matrix().T, place)
        shots.append(Shot(_UNFOUND, name.strip('"'), pose,
                          centred(name, float(focal), _undoing(float(radial)))))
    if len(shots) < count:
        raise ValueError(f"it ends after {len(shots)} of {count} cameras")
    more = _in_other_models(rest[1 + count:])
    warn_left_out(more, count + more, file, f"are not aligned to the first model's {count}")
    return shots


def _in_other_models(lines: list[str]) -> int:
    """Cameras of the models behind the first of a ``.nvm``, whose points begin the lines."""
    cameras = at = 0
    while at < len(lines) and lines[at].isdecimal():
        at += 1 + int(lines[at])  # a model's points
        if at < len(lines) and lines[at].isdecimal():
            cameras += int(lines[at])
            if not int(lines[at]):
                break  # an empty model is the last
            at += 1 + int(lines[at])
    return cameras


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
        raise ValueError(f"its distortion {radial:g} is too strong: the picture folds over itself")
    square = straight ** 2
    terms = np.linalg.lstsq(np.stack([square, square ** 2, square ** 3], axis=1),
                            bent / straight - 1, rcond=None)[0]
    return tuple(float(term) for term in terms)


class _Program(CaptureFormat):
    """A photogrammetry program's file with cameras, which lies beside the photos."""

    patterns: ClassVar[tuple[str, ...]]
    """Names that it may have in a data set's folder; the suffix of the first is that of all."""

    @abstractmethod
    def placed(self, file: Path) -> list[Shot]:
        """The photos that the file names."""

    def is_cameras(self, file: Path) -> bool:
        """Whether a file of this suffix holds cameras: tables and JSON may hold other things."""
        return True

    def _file(self, path: Path) -> Path | None:
        """The file that ``path`` is, or that lies in this folder."""
        suffix = Path(self.patterns[0]).suffix
        if path.is_file():
            return path if path.suffix.lower() == suffix and self.is_cameras(path) else None
        files = (file for pattern in self.patterns if path.is_dir()
                 for file in sorted(path.glob(pattern)))
        return next((one for one in files if not is_junk(one) and self.is_cameras(one)), None)

    def recognises(self, path: Path) -> bool:
        return self._file(path) is not None

    def read(self, path: Path, holdout: int) -> DataSet:
        file = self._file(path)
        assert file is not None
        try:
            shots = self.placed(file)
        except OSError as error:
            raise UserError(f"can't read {file}: {error.strerror or error}") from error
        except (ValueError, LookupError, AttributeError, TypeError, OverflowError,
                np.linalg.LinAlgError, ElementTree.ParseError) as error:
            raise UserError(f"{file} can't be read: {' '.join(str(error).split())}") from error
        if not shots:
            raise UserError(f"{file} has no aligned cameras")
        found = _photos(file.parent)
        known = [(shot, photo) for shot in shots
                 if (photo := _photo(shot.name, found)) is not None]
        if not known:
            raise UserError(f"none of the photos named in {file} were found; put them into "
                            f"{file.parent / 'images'}")
        if len(known) < len(shots):
            warnings.warn(f"{len(shots) - len(known)} photos named in {file} are not there",
                          stacklevel=2)
        known.sort(key=lambda one: natural_key(one[1]))
        bases = [photo.name for _, photo in known]
        views = [replace(shot, path=photo, name=photo.name if bases.count(photo.name) == 1
                         else f"{photo.parent.name}_{photo.name}",
                         masks=(file.parent / "masks", photo.parent.parent / "masks"))
                 for shot, photo in known]
        return DataSet(self.name, views, file)


class Metashape(_Program):
    """Agisoft Metashape."""

    name, files, patterns = "Metashape", "cameras.xml", ("cameras.xml",)
    placed = staticmethod(read_metashape)


class Bundler(_Program):
    """Bundler, with the photos' names in ``list.txt``."""

    name, files, patterns = "Bundler", "bundle.out", ("bundle.out", "bundle/bundle.out")
    placed = staticmethod(read_bundler)


class VisualSfm(_Program):
    """VisualSfM."""

    name, files, patterns = "VisualSfM", ".nvm", ("*.nvm",)
    placed = staticmethod(read_visualsfm)


class Meshroom(_Program):
    """Meshroom (AliceVision)."""

    name, files, patterns = "Meshroom", ".sfm", ("*.sfm",)
    placed = staticmethod(read_graph)


class OpenMvg(_Program):
    """The same as JSON, and OpenMVG's."""

    name, files, patterns = "Meshroom or OpenMVG", "sfm_data.json", ("*.json",)
    placed, is_cameras = staticmethod(read_graph), staticmethod(is_graph)


class CameraTable(_Program):
    """The CSV of RealityCapture and RealityScan, and tables like it."""

    name, files, patterns = "RealityCapture or a camera table", "camera table (.csv)", ("*.csv",)
    placed, is_cameras = staticmethod(read_camera_table), staticmethod(is_camera_table)


def _photos(folder: Path) -> dict[str, list[Path]]:
    """Photos in ``images`` and beside the file, by every end of their path in lower case.

    ``left/a.jpg`` is found as ``left/a.jpg``, ``left/a``, ``a.jpg`` and ``a``.
    """
    found: dict[str, list[Path]] = {}
    for place in (folder / "images", folder, folder.parent / "images", folder.parent):
        for path in _pictures_within(place):
            parts = [folded(part) for part in path.relative_to(place).parts]
            for first in range(len(parts)):
                name = "/".join(parts[first:])
                for key in dict.fromkeys((name, name[:-len(path.suffix)])):
                    found.setdefault(key, []).append(path)
        if found:
            break
    return found


def _pictures_within(place: Path) -> list[Path]:
    """Pictures of a folder and of the folders in it, two deep."""
    folders = [one for one in (place, *folders_below(place, 2))
               if not {"masks", "depth"} & set(one.relative_to(place).parts)]
    return [path for folder in folders for path in visible(folder)
            if path.is_file() and path.suffix.lower() in PHOTOS]


def _photo(name: str, found: dict[str, list[Path]]) -> Path | None:
    """The photo that a program gives this name, path or label; the longest end that fits."""
    parts = folded(name.replace("\\", "/")).split("/")
    for first in range(len(parts)):
        whole = "/".join(parts[first:])
        suffix = Path(whole).suffix
        for key in (whole, whole[:-len(suffix)] if suffix in PHOTOS else whole):
            if len(found.get(key, [])) == 1:
                return found[key][0]
    return None
