"""Agisoft Metashape's ``cameras.xml``, by the formulas of its manual (appendix "Camera models").

In a rig ("multi-camera system") only photos of the master have poses. The sensor of another photo
has ``rotation`` and ``location``: how it lies in its master, in the units of the chunk. So its pose
is the master's times that, as ``metashape_to_krt.py`` of Meta's EyefulTower has it, which its
authors test on rigs of 9 and 22 cameras.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ..distortion import Lens
from .placed import Placed, brown, fisheye, warn_left_out

__all__ = ["read_metashape"]

Float64 = NDArray[np.float64]


def read_metashape(file: Path) -> list[Placed]:
    """The aligned photos of the file's chunks.

    Of a chunk whose photos fell into several components the largest is taken, as nothing says how
    they lie to each other.
    """
    text = file.read_bytes()
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise ValueError("it declares XML entities, which are not allowed")
    found: list[Placed] = []
    total = loose = away = 0
    for chunk in ElementTree.fromstring(text).iter("chunk"):
        photos = _photos(chunk)
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
    """A photo as its chunk has it.

    Attributes
    ----------
    record
        Its element.
    component
        Id of the component that it is aligned in.
    pose
        float64 [4, 4], camera to component; None where it is not aligned.
    loose
        Whether it hangs on an aligned master in a way that the file does not say.
    """

    record: ElementTree.Element
    component: str | None
    pose: Float64 | None
    loose: bool = False

    @property
    def enabled(self) -> bool:
        """Whether it is in use."""
        return self.record.get("enabled") not in ("0", "false")


def _components(chunk: ElementTree.Element, photos: list[_Photo]) -> dict[str | None, list[Placed]]:
    """The aligned photos that are in use, by their component, in the world."""
    lenses = {sensor.get("id"): _lens(sensor) for sensor in chunk.iter("sensor")}
    whole = _similarity(chunk.find("transform"), np.eye(4))
    worlds = {part.get("id"): _similarity(part.find("transform"), whole)
              for part in chunk.findall("components/component")}
    parts: dict[str | None, list[Placed]] = {}
    for photo in photos:
        if photo.pose is None or not photo.enabled:
            continue
        label = str(photo.record.get("label"))
        lens = lenses.get(photo.record.get("sensor_id"))
        if lens is None:
            raise ValueError(f"the sensor of {label} is not calibrated")
        pose = worlds.get(photo.component, whole) @ photo.pose
        pose[:3, :3] /= np.cbrt(np.linalg.det(pose[:3, :3]))
        parts.setdefault(photo.component, []).append(
            Placed(label, pose, lens.resized, (lens.width, lens.height)))
    return parts


def _photos(chunk: ElementTree.Element) -> list[_Photo]:
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
