"""Draw a sheet of stylised fields of one head: a row each, seen from -80 to 80 degrees.

python scripts/make_style_sheet.py DATA --field lee.npz --capture lee.cap --style ken \
    --rows chart=a.npz views=b.npz --out sheet.jpg

The first row is the real field. With the capture's landmarks the head fills the pictures, without
them they are framed like a sweep. ``--style``, a picture or a name in DATA/styles, stands before
the stylised rows.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from lfportrait.capture import Camera, Capture
from lfportrait.field import VoxelField
from lfportrait.files import write_image
from lfportrait.media.pictures import read_image
from lfportrait_eval.metrics import arc_cameras, head_cameras
from make_contact_sheet import cell, labelled, total_width

ANGLES = (-80.0, -45.0, 0.0, 45.0, 80.0)


def sheet(rows: dict[str, Path], cameras: Camera, style: np.ndarray | None) -> np.ndarray:
    """The whole sheet, uint8 [H, W, 3]; the first row is the real field's."""
    height = int(cameras.height[0])
    shown: list[tuple[str, list[np.ndarray]]] = []
    for label, path in rows.items():
        field = VoxelField.load(path)
        views = [cell(field.render(cameras, view).color, height) for view in range(len(cameras))]
        if style is not None:
            picture = cell(style, height)
            views.insert(0, picture if shown else np.full_like(picture, 255))
        shown.append((label, views))
    width = total_width(shown[0][1])
    return np.concatenate([labelled(views, label, width) for label, views in shown])


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="folder with styles/")
    parser.add_argument("--field", type=Path, required=True, help="the real field (.npz)")
    parser.add_argument("--capture", type=Path, help="its capture: the head fills the pictures")
    parser.add_argument("--rows", nargs="+", default=[], metavar="LABEL=FILE",
                        help="stylised fields")
    parser.add_argument("--style", help="exemplar to stand before the rows")
    parser.add_argument("--size", type=int, default=480, help="side of a picture in pixels")
    parser.add_argument("--out", type=Path, default=Path("style-sheet.jpg"))
    options = parser.parse_args(arguments)
    if any("=" not in row for row in options.rows):
        parser.error("rows are LABEL=FILE")
    rows = {"photo": options.field, **{label: Path(file) for label, _, file in (
        row.partition("=") for row in options.rows)}}
    style = None
    if options.style:
        known = options.data / "styles" / f"{options.style}.png"
        style = known if known.is_file() else Path(options.style)
    missing = [path for path in (*rows.values(), options.capture, style)
               if path is not None and not path.exists()]
    if missing:
        print(f"skipped: there is no {missing[0]}")
        return 0
    landmarks = Capture.load(options.capture).landmarks if options.capture else None
    cameras = (arc_cameras(VoxelField.load(options.field), ANGLES, options.size)
               if landmarks is None else
               head_cameras(landmarks, ANGLES, options.size, room=1.1, back=0.25))
    made = sheet(rows, cameras, None if style is None else read_image(style)[..., :3])
    write_image(options.out, made, quality=90)
    print(f"{options.out}: {made.shape[1]} x {made.shape[0]}, {len(rows)} rows")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
