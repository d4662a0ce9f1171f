"""Readers of text formats: RealityCapture's CSV, Bundler's ``.out``, VisualSfM's ``.nvm``.

Bundler's formulas are those of its manual (Snavely et al. 2006), VisualSfM's those of the README to
its ``NVM_V3``. RealityCapture (RealityScan) writes focal lengths as of 35-mm film, centre and
distortion in parts of the longer side and of the focal length, and poses as x, y, height, heading,
pitch, roll in degrees, where a camera without any of them looks straight down with its upper edge
to the north (Epic's "camera math" of its XMP files).
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..distortion import Lens
from .placed import Placed, brown, centred, warn_left_out

__all__ = ["is_camera_table", "read_bundler", "read_camera_table", "read_visualsfm"]

_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
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


def read_camera_table(file: Path) -> list[Placed]:
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
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("ZXY", [-angles[0], angles[1], angles[2]],
                                           degrees=True).as_matrix()
        pose[:3, 3] = place
        terms = [float(row.get(key) or 0.0) for key in
                 ("f", "px", "py", "k1", "k2", "k3", "k4", "t1", "t2")]
        if not terms[0] > 0:
            raise ValueError(f"the focal length of {name} is {terms[0]:g}")
        found.append(Placed(name, pose @ _FLIP, _of_film(terms)))
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


def read_bundler(file: Path) -> list[Placed]:
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
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = np.stack(part[1:4]), part[4]
        # Its cameras look along -z, y is up.
        shots.append(Placed(names[number], np.asarray(np.linalg.inv(_FLIP @ matrix), np.float64),
                          centred(names[number], float(focal), (float(k1), float(k2)))))
    warn_left_out(count - len(shots), count, file)
    return shots


def _listed(line: str) -> str:
    """The photo that a line of ``list.txt`` names, before a zero and its noted focal length."""
    parts = line.strip().rsplit(None, 2)
    return parts[0] if len(parts) == 3 and parts[1] == "0" else line.strip()


def read_visualsfm(file: Path) -> list[Placed]:
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
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix().T
        pose[:3, 3] = place
        shots.append(Placed(name.strip('"'), pose,
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
