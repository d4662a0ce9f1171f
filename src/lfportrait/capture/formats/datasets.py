"""Folders of pictures with their cameras: the data sets LLFF and NSVF, Polycam and Record3D.

LLFF keeps ``poses_bounds.npy``, NSVF ``rgb/``, ``pose/`` and ``intrinsics.txt``. Polycam and
Record3D are apps that scan with a phone. Both have camera-to-world poses whose camera looks along
-z with y up, in a world whose y is up. The pictures lie as the sensor does, so they are turned by
the world's up.

- Polycam, "raw data": ``keyframes/images`` and ``keyframes/cameras``, or ``corrected_images`` and
  ``corrected_cameras`` where it optimised them; a JSON file a picture.
- Record3D, "EXR + JPG" or r3d unpacked: ``rgb`` and ``metadata`` or ``metadata.json`` with all
  poses as quaternion (x, y, z, w) and position, K by columns.
"""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from ...arrays import Float64
from ...errors import UserError
from ...files import UNREADABLE_ARRAYS, read_json
from ...media.folders import list_pictures, stem_key, visible
from ...media.pictures import open_picture
from ..lenses import Lens
from .assembly import FLIP, CaptureFormat, DataSet, Shot
from .programs import pose_of, resizable, warn_unmatched

# Pixels along the longer side beyond which a reduced copy is preferred.
_LARGEST_SIDE = 1600


def _llff_pictures(folder: Path, count: int) -> list[Path]:
    """The ``count`` pictures to read: the largest copies (``images_N``) that are not too large."""
    best: tuple[float, list[Path]] | None = None
    for place in visible(folder):
        if place.name != "images" and not place.name.startswith("images_"):
            continue
        # The programs that write these files sort names letter by letter.
        files = sorted(list_pictures(place).files, key=lambda path: path.name)
        if len(files) != count:
            continue
        try:
            with open_picture(files[0]) as picture:
                side = max(picture.size)
        except (OSError, ValueError, SyntaxError):
            continue
        # Up to the limit larger is better, beyond it smaller is.
        rank = float(side) if side <= _LARGEST_SIDE else -float(side)
        if best is None or rank > best[0]:
            best = rank, files
    if best is None:
        raise UserError(f"{folder / 'poses_bounds.npy'} lists {count} cameras, but "
                        f"{folder / 'images'} does not hold as many pictures")
    return best[1]


class Llff(CaptureFormat):
    """LLFF.

    ``poses_bounds.npy`` has 17 numbers a picture: a [3, 5] matrix whose columns are the camera's
    down, right and backward axes, its position, and (height, width, focal length); then the near
    and far depth, which are not needed. The pictures lie in ``images`` or, reduced, ``images_N``.
    Held out are every so many pictures from the first on, as is the custom with these data sets.
    """

    name, files = "LLFF", "poses_bounds.npy"

    def recognises(self, path: Path) -> bool:
        return (path / self.files).is_file()

    def read(self, path: Path, holdout: int) -> DataSet:
        source = path / "poses_bounds.npy"
        try:
            table = np.load(source, allow_pickle=False).astype(np.float64)
            matrices = table[:, :15].reshape(-1, 3, 5)
        except UNREADABLE_ARRAYS as error:
            raise UserError(f"{source} is not an LLFF camera file: {error}") from error
        if not (len(matrices) and np.isfinite(matrices).all() and (matrices[:, :, 4] > 0).all()
                and (np.round(matrices[:, :2, 4]) >= 1).all()):
            raise UserError(f"{source} is not an LLFF camera file: sizes and focal lengths must be "
                            "positive numbers")
        files = _llff_pictures(path, len(matrices))
        poses = np.tile(np.eye(4), (len(matrices), 1, 1))
        poses[:, :3, 0], poses[:, :3, 1] = matrices[:, :, 1], matrices[:, :, 0]
        poses[:, :3, 2], poses[:, :3, 3] = -matrices[:, :, 2], matrices[:, :, 3]
        split = 1 < holdout <= len(files) // 2
        shots = []
        for number, (file, pose, matrix) in enumerate(zip(files, poses, matrices)):
            height, width, focal = (float(value) for value in matrix[:, 4])
            lens = Lens(round(width), round(height), (focal, focal), (width / 2, height / 2))
            shots.append(Shot(file, file.name, pose, lens.resized, (lens.width, lens.height),
                              test=number % holdout == 0 if split else None))
        return DataSet(self.name, shots, source)


def _nsvf_intrinsics(file: Path) -> Float64:
    """(fx, fy, cx, cy) from either form of ``intrinsics.txt``: a 4x4 matrix, or "f cx cy 0"."""
    try:
        rows = [[float(value) for value in line.split()]
                for line in file.read_text("utf-8-sig").splitlines() if line.strip()]
        if len(rows) >= 3 and len(rows[0]) == len(rows[1]) and len(rows[0]) >= 3:
            return np.array([rows[0][0], rows[1][1], rows[0][2], rows[1][2]])
        return np.array([rows[0][0], rows[0][0], rows[0][1], rows[0][2]])
    except (OSError, ValueError, IndexError) as error:
        raise UserError(f"can't read the camera in {file}: {error}") from error


def _nsvf_box(file: Path) -> Float64 | None:
    """The subject's box [2, 3] from ``bbox.txt``: lowest corner, highest corner, voxel size."""
    if not file.is_file():
        return None
    try:
        numbers = file.read_text("utf-8-sig").split()[:6]
        box = np.array([float(value) for value in numbers]).reshape(2, 3)
    except (OSError, ValueError) as error:
        raise UserError(f"can't read the box in {file}: {error}") from error
    if not (np.isfinite(box).all() and (box[1] > box[0]).all()):
        raise UserError(f"the box in {file} is empty; correct or remove the file")
    return box


def _nsvf_folders(path: Path) -> tuple[Path, Path] | None:
    """The folders of pictures and of poses of an NSVF data set, or None if it is none."""
    pictures = [path / name for name in ("rgb", "images", "image") if (path / name).is_dir()]
    poses = [path / name for name in ("pose", "poses") if (path / name).is_dir()]
    return (pictures[0], poses[0]) if pictures and poses else None


class Nsvf(CaptureFormat):
    """NSVF.

    Poses are camera-to-world with OpenCV axes, one text file a picture; the names' prefix says the
    split: ``0_`` training, ``1_`` validation, ``2_`` test. ``bbox.txt``, if there is one, gives the
    subject's position, for a world that is not normalised.
    """

    name, files = "NSVF", "pose/ folder"

    def recognises(self, path: Path) -> bool:
        return _nsvf_folders(path) is not None

    def read(self, path: Path, holdout: int) -> DataSet:
        folders = _nsvf_folders(path)
        assert folders is not None
        rgb, pose_folder = folders
        fx, fy, cx, cy = _nsvf_intrinsics(path / "intrinsics.txt")
        box = _nsvf_box(path / "bbox.txt")
        pictures = list_pictures(rgb).files
        poses = {stem_key(file): file for file in visible(pose_folder)
                 if file.suffix.lower() == ".txt"}
        files = [file for file in pictures if stem_key(file) in poses]
        if not files:
            raise UserError(f"{rgb} has no picture with a file of its name in {pose_folder}")
        warn_unmatched({stem_key(file) for file in pictures}, poses.keys(), rgb, pose_folder)
        prefixes = {file.name.split("_")[0] for file in files}
        split = prefixes <= {"0", "1", "2"} and len(prefixes) > 1
        shots = []
        for file in files:
            try:
                pose = np.loadtxt(poses[stem_key(file)], encoding="utf-8-sig").reshape(4, 4)
            except (OSError, ValueError) as error:
                raise UserError(f"the pose of {file.name} can't be read: {error}") from error
            shots.append(Shot(file, file.name, pose,
                              lambda width, height: Lens(width, height, (fx, fy), (cx, cy)),
                              test=not file.name.startswith("0_") if split else None))
        return DataSet(self.name, shots, rgb, box)


_UP = np.array([0.0, 1.0, 0.0])


def _polycam_folders(path: Path) -> tuple[Path, Path] | None:
    """The folders of pictures and of cameras of a Polycam export, or None if it is none."""
    for folder in (path / "keyframes", path):
        for kind in ("corrected_", ""):
            pictures, cameras = folder / f"{kind}images", folder / f"{kind}cameras"
            if pictures.is_dir() and cameras.is_dir() and _cameras(cameras):
                return pictures, cameras
    return None


def _cameras(folder: Path) -> list[Path]:
    """The JSON files of a folder, without what systems leave there."""
    return [path for path in visible(folder) if path.suffix.lower() == ".json"]


class Polycam(CaptureFormat):
    """Polycam's raw data."""

    name, files = "Polycam", "export of Polycam"

    def recognises(self, path: Path) -> bool:
        return _polycam_folders(path) is not None

    def read(self, path: Path, holdout: int) -> DataSet:
        folders = _polycam_folders(path)
        assert folders is not None
        pictures, cameras = folders
        shots = []
        listed = list_pictures(pictures).files
        files = {stem_key(file): file for file in _cameras(cameras)}
        for picture in listed:
            file = files.get(stem_key(picture))
            if file is None:
                continue
            data = read_json(file)
            with _one_line(file):
                pose = np.eye(4)
                pose[:3] = [[float(data[f"t_{row}{column}"]) for column in range(4)]
                            for row in range(3)]
                lens, size = resizable(Lens(
                    int(data["width"]), int(data["height"]), (float(data["fx"]), float(data["fy"])),
                    (float(data["cx"]), float(data["cy"]))))
            shots.append(_shot(picture, pose, lens, size))
        if not shots:
            raise UserError(f"{pictures} has no picture with a file of its name in {cameras}")
        warn_unmatched({stem_key(picture) for picture in listed}, files.keys(), pictures, cameras)
        return DataSet(self.name, shots, pictures)


def _record3d_files(path: Path) -> tuple[Path, Path] | None:
    """The folder of pictures and the metadata of a Record3D export, or None if it is none."""
    for folder in (path, path / "EXR_RGBD"):
        for name in ("metadata.json", "metadata"):
            if (folder / "rgb").is_dir() and (folder / name).is_file():
                return folder / "rgb", folder / name
    return None


class Record3d(CaptureFormat):
    """Record3D's "EXR + JPG", or r3d unpacked."""

    name, files = "Record3D", "export of Record3D"

    def recognises(self, path: Path) -> bool:
        return _record3d_files(path) is not None

    def read(self, path: Path, holdout: int) -> DataSet:
        from scipy.spatial.transform import Rotation  # a tenth of a second that few commands need

        files = _record3d_files(path)
        assert files is not None
        folder, file = files
        data = read_json(file)
        pictures = list_pictures(folder).files
        with _one_line(file):
            table = np.array(data["poses"], np.float64).reshape(-1, 7)
            size = int(data["w"]), int(data["h"])
            k = np.array(data["K"], np.float64).reshape(3, 3).T
            own = data.get("perFrameIntrinsicCoeffs") or []
            lenses = [Lens(*size, (float(fx), float(fy)), (float(cx), float(cy)))
                      for fx, fy, cx, cy in (own if len(own) == len(table) else
                                             [(k[0, 0], k[1, 1], k[0, 2], k[1, 2])] * len(table))]
            rotations = Rotation.from_quat(table[:, :4]).as_matrix()
        shots = []
        for picture in pictures:
            number = int(picture.stem) if picture.stem.isdecimal() else -1
            if not 0 <= number < len(table):
                continue
            pose = pose_of(rotations[number], table[number, 4:])
            shots.append(_shot(picture, pose, *resizable(lenses[number])))
        if not shots:
            raise UserError(f"{folder} has no pictures 0.jpg, 1.jpg, ... for the poses in {file}")
        warn_unmatched({picture.stem.lstrip("0") or "0" for picture in pictures},
                       {str(number) for number in range(len(table))}, folder, file)
        return DataSet(self.name, shots, folder)


def _shot(picture: Path, pose: Float64, lens: Callable[[int, int], Lens],
          size: tuple[int, int]) -> Shot:
    masks = picture.parent.parent / "masks", picture.parent / "masks"
    return Shot(picture, picture.name, pose @ FLIP, lens, size, masks, up=_UP)


@contextlib.contextmanager
def _one_line(file: Path) -> Iterator[None]:
    """What goes wrong with a file's values becomes one line."""
    try:
        yield
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise UserError(f"{file} can't be read: {what}") from error
