"""The folder that a `Capture` is kept in: pictures, and ``transforms.json`` with NeRF's axes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import numpy as np

from ...errors import UserError
from ...files import fresh_folder, read_json, write_image, write_json
from ...lanes.threads import side_by_side
from ...measure import usable_cores
from ...media.pictures import read_image
from ..camera import Camera
from ..depths import load_depth, save_depth, some_depth
from .assembly import Views
from .transforms import Transforms, transform_files

__all__ = ["Own"]

_TO_NERF = np.diag([1.0, -1.0, -1.0, 1.0])


class Own(Transforms):
    """Captures of our own: other programs read their cameras, too."""

    name = "lfportrait capture"

    def recognises(self, path: Path) -> bool:
        """See `CaptureFormat.recognises`."""
        files = transform_files(path)
        with suppress(UserError):  # damaged: `Transforms` says of what
            first = read_json(files[0]) if files else None
            return isinstance(first, dict) and first.get("generator") == "lfportrait"
        return False

    def write(self, capture: Views, path: Path) -> None:
        """See `CaptureFormat.write`."""
        try:
            with fresh_folder(path) as temporary:
                _write(capture, temporary)
        except OSError as error:
            raise UserError(f"can't write {path}: {error.strerror}; free some space or choose "
                            "another folder with --out") from error

    def load(self, path: Path, holdout: int) -> Views:
        """See `CaptureFormat.load`."""
        folder = transform_files(path)[0].parent
        data = read_json(folder / "transforms.json")
        try:
            frames = data["frames"]
            # Decoding leaves Python to others.
            with ThreadPoolExecutor(usable_cores()) as pool:
                pictures = list(pool.map(read_image, [folder / frame["file_path"]
                                                      for frame in frames]))
            cameras = Camera(
                np.array([frame["transform_matrix"] for frame in frames]) @ _TO_NERF,
                np.array([[frame["fl_x"], frame["fl_y"]] for frame in frames]),
                np.array([[frame["cx"], frame["cy"]] for frame in frames]),
                np.array([frame["w"] for frame in frames]),
                np.array([frame["h"] for frame in frames]))
            landmarks = data["landmarks"]
            return Views(
                cameras, [np.ascontiguousarray(picture[..., :3]) for picture in pictures],
                [np.ascontiguousarray(picture[..., 3]) for picture in pictures]
                if pictures[0].shape[2] == 4 else None,
                [Path(frame["file_path"]).name for frame in frames],
                np.array([frame["held_out"] for frame in frames], bool),
                np.array(data["portrait_frame"]),
                None if landmarks is None else np.array(
                    [[np.nan if v is None else v for v in point] for point in landmarks]),
                data.get("figures", {}),
                some_depth([load_depth(folder, frame.get("depth")) for frame in frames]))
        except (KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
            raise UserError(f"{folder / 'transforms.json'} is damaged: {error!r}") from error


def _write(capture: Views, folder: Path) -> None:
    frames = []
    names = [f"images/{Path(name).stem}.png" for name in capture.names]

    def write(view: int) -> None:
        picture = (capture.images[view] if capture.alphas is None
                   else np.dstack([capture.images[view], capture.alphas[view]]))
        write_image(folder / names[view], picture, fast=True)

    side_by_side(write, range(len(capture.names)), most=4)
    for view, name in enumerate(names):
        camera = capture.cameras[view]
        frames.append({
            "file_path": name, "w": int(camera.width[0]), "h": int(camera.height[0]),
            "fl_x": camera.focal[0, 0], "fl_y": camera.focal[0, 1],
            "cx": camera.center[0, 0], "cy": camera.center[0, 1],
            "transform_matrix": (camera.pose[0] @ _TO_NERF).tolist(),
            "held_out": bool(capture.held_out[view])})
        depth = None if capture.depths is None else capture.depths[view]
        if depth is not None:
            name = f"depth/{Path(capture.names[view]).stem}.npz"
            frames[-1]["depth"] = save_depth(folder, name, depth)
    write_json(folder / "transforms.json", {
        "generator": "lfportrait", "frames": frames, "portrait_frame": capture.frame,
        "landmarks": None if capture.landmarks is None else
        [[None if np.isnan(v) else v for v in point] for point in capture.landmarks.tolist()],
        "figures": capture.figures or {}})
