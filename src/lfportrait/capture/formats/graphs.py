"""Readers of Meshroom and OpenMVG files (views, poses and intrinsics that refer to each other).

AliceVision (``cameras.sfm``, ``sfm.json``) writes all numbers as text, rotations camera-to-world by
rows; from version 1.2.1 the centre is noted from the picture's middle, from 1.2.2 the focal length
in millimetres of the sensor. OpenMVG (``sfm_data.json``) wraps its records, rotations are
world-to-camera. Both have OpenCV's axes and distortion.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...files import read_json
from ..distortion import Lens
from .placed import Placed, resizable, warn_left_out

__all__ = ["is_graph", "read_graph"]

Float64 = NDArray[np.float64]


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
