"""Agisoft Metashape's ``cameras.xml``, by the formulas of its manual (appendix "Camera models")."""

from __future__ import annotations

import warnings
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ..distortion import Lens
from .placed import Placed, brown

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
    for chunk in ElementTree.fromstring(text).iter("chunk"):
        lenses = {sensor.get("id"): _lens(sensor) for sensor in chunk.iter("sensor")}
        whole = _similarity(chunk.find("transform"), np.eye(4))
        worlds = {part.get("id"): _similarity(part.find("transform"), whole)
                  for part in chunk.findall("components/component")}
        parts: dict[str | None, list[Placed]] = {}
        for camera in chunk.iter("camera"):
            transform = camera.find("transform")
            if transform is None or camera.get("enabled") in ("0", "false"):
                continue  # not aligned
            lens = lenses.get(camera.get("sensor_id"))
            if lens is None:
                raise ValueError(f"the sensor of {camera.get('label')} is not calibrated")
            part = camera.get("component_id")
            pose = (worlds.get(part, whole)
                    @ np.array(str(transform.text).split(), np.float64).reshape(4, 4))
            pose[:3, :3] /= np.cbrt(np.linalg.det(pose[:3, :3]))
            parts.setdefault(part, []).append(
                Placed(str(camera.get("label")), pose, lens.resized, (lens.width, lens.height)))
        if len(parts) > 1:
            warnings.warn(f"{file} has {len(parts)} components that are not aligned to each other; "
                          "the largest is taken", stacklevel=2)
        if parts:
            found += sorted(parts.values(), key=len)[-1]
    return found


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
    focal = value("f") or value("fx")
    if not focal > 0:
        raise ValueError("a sensor has no focal length")
    if value("b2"):
        raise ValueError("skew (b2) is not supported; optimise the cameras without it")
    k = value("k1"), value("k2"), value("k3"), value("k4")
    # Metashape numbers the tangential terms the other way round.
    lens = Lens(width, height, (focal + value("b1"), focal),
                (width / 2 + value("cx"), height / 2 + value("cy")), "fisheye", k,
                (value("p2"), value("p1")))
    return lens if kind == "fisheye" else brown(lens, k)
