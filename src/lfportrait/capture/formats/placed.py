"""A photo with its camera from a photogrammetry program, the lens models of these, and two readers.

The readers of Meshroom's and OpenMVG's files stand here, as `transforms` needs to know them: views,
poses and intrinsics that refer to each other.

AliceVision (``cameras.sfm``, ``sfm.json``) writes all numbers as text, rotations camera-to-world by
rows; from version 1.2.1 the centre is noted from the picture's middle, from 1.2.2 the focal length
in millimetres of the sensor. OpenMVG (``sfm_data.json``) wraps its records, rotations are
world-to-camera. Both have OpenCV's axes and distortion.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Float64
from ...files import read_json
from ..lenses import Lens


@dataclass(frozen=True)
class Placed:
    """One aligned photo of a program's file.

    Attributes
    ----------
    name : File name, path or label.
    pose : float64 [4, 4], camera-to-world, OpenCV axes; a common scale is allowed.
    lens : Makes the lens of the picture as it was calibrated from its width and height in pixels.
    size : Width and height that were calibrated, where the file says.
    """

    name: str
    pose: Float64
    lens: Callable[[int, int], Lens]
    size: tuple[int, int] | None = None


def resizable(lens: Lens) -> tuple[Callable[[int, int], Lens], tuple[int, int]]:
    """A lens of known picture size as `Placed` has it: for reduced copies too."""
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

    Parameters
    ----------
    pictures, cameras : The names by which they belong together; hidden files don't count.
    folder, place : Where the pictures and the cameras are.
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


def read_graph(file: Path) -> list[Placed]:
    """The photos with poses of Meshroom's or OpenMVG's file."""
    data = read_json(file)
    found = _openmvg(data) if "sfm_data_version" in data else _alicevision(data)
    warn_left_out(len(data["views"]) - len(found), len(data["views"]), file)
    return found


def _alicevision(data: dict[str, Any]) -> list[Placed]:
    version = tuple(int(part) for part in data["version"])
    lenses = {record["intrinsicId"]: _alicevision_lens(record, version)
              for record in data.get("intrinsics") or []}
    poses = {}
    for record in data.get("poses") or []:
        transform = record["pose"]["transform"]
        poses[record["poseId"]] = _pose(np.array(transform["rotation"], np.float64).reshape(3, 3),
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
        found.append(Placed(str(view["path"]), pose, *resizable(lens)))
    return found


def _pose(rotation: Float64, center: Any) -> Float64:
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


def _openmvg(data: dict[str, Any]) -> list[Placed]:
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
    poses = {record["key"]: _pose(np.array(record["value"]["rotation"], np.float64).T,
                                  record["value"]["center"])
             for record in data.get("extrinsics") or []}
    found = []
    for record in data["views"]:
        view = record["value"]["ptr_wrapper"]["data"]
        pose, lens = poses.get(view["id_pose"]), lenses.get(view["id_intrinsic"])
        if pose is not None and lens is not None:
            place = "/".join(part for part in (str(view.get("local_path") or ""),
                                               str(view["filename"])) if part)
            found.append(Placed(place, pose, *resizable(lens)))
    return found
