"""Draw a contact sheet: every exemplar on one photo and on views of a capture round to the profile.

python scripts/make_contact_sheet.py DATA --out sheet.jpg

DATA holds ``styles/`` (pictures with landmarks), ``faceblit_reference/target1.png`` and ``lee/`` (a
calibrated capture of a head). A row is an exemplar: itself, the photo painted, and the capture's
photos that are nearest to 0, 30, 60 and 80 degrees, painted with guides on the surface. The surface
is a field's: ``--field FILE``, or the capture is reconstructed in a minute.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from lfportrait.capture import CalibrateConfig, Capture
from lfportrait.example import Exemplar, SurfaceGuide, Transfer
from lfportrait.face import detect_landmarks
from lfportrait.field import VoxelField, reconstruct_with_figures
from lfportrait.files import write_image
from lfportrait.job.prepare import prepare_capture
from lfportrait.media.pictures import read_image
from lfportrait_eval.bench.run import SHORT

ANGLES = (0, 30, 60, 80)
GAP = 4


def nearest_views(capture: Capture, angles: tuple[int, ...] = ANGLES) -> list[int]:
    """The views nearest to the angles about the vertical axis, at the height of the head."""
    position = capture.cameras.position
    away = np.linalg.norm(position, axis=1)
    yaw = np.degrees(np.arctan2(position[:, 0], position[:, 2]))
    pitch = np.degrees(np.arcsin(np.clip(position[:, 1] / away, -1, 1)))
    return [int(np.argmin(np.hypot(yaw - angle, pitch - 5))) for angle in angles]


def cell(image: np.ndarray, height: int) -> np.ndarray:
    """A picture at the height of a row, uint8."""
    if image.dtype != np.uint8:
        image = np.uint8(np.clip(image, 0, 1) * 255 + 0.5)
    width = round(image.shape[1] * height / image.shape[0])
    return np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.LANCZOS))


def total_width(row: list[np.ndarray]) -> int:
    """Pixels that the cells of a row take side by side."""
    return sum(picture.shape[1] + GAP for picture in row)


def labelled(row: list[np.ndarray], text: str, width: int) -> np.ndarray:
    """Cells side by side under a line of text, ``width`` pixels wide."""
    head = Image.new("RGB", (width, 22), "white")
    ImageDraw.Draw(head).text((4, 3), text, fill="black", font=ImageFont.load_default(14))
    line = np.full((row[0].shape[0] + GAP, width, 3), 255, np.uint8)
    x = 0
    for picture in row:
        line[:picture.shape[0], x:x + picture.shape[1]] = picture
        x += picture.shape[1] + GAP
    return np.concatenate([np.asarray(head), line])


def sheet(exemplars: list[Exemplar], photo: np.ndarray, landmarks: np.ndarray, capture: Capture,
          field: VoxelField, height: int) -> np.ndarray:
    """The whole sheet, uint8 [H, W, 3]."""
    if capture.landmarks is None:
        raise ValueError("the capture has no landmarks")
    views = nearest_views(capture)
    pixels = capture.cameras.project(capture.landmarks)[0]
    shots = [capture.image_float(view) for view in views]
    rendered = [field.render(capture.cameras, view) for view in views]
    points = [shot.points(capture.cameras, view) for shot, view in zip(rendered, views)]
    blank = np.full((height, 1, 3), 255, np.uint8)
    rows: list[tuple[str, list[np.ndarray]]] = [
        ("photos", [blank, cell(photo, height), *(cell(shot, height) for shot in shots)])]
    for exemplar in exemplars:
        print(exemplar.name, file=sys.stderr)
        prepared = Transfer(exemplar)
        guide = SurfaceGuide(capture.landmarks, exemplar, prepared.regions)
        row = [cell(exemplar.image, height), cell(prepared.apply(photo, landmarks).image, height)]
        for view, shot, render, surface in zip(views, shots, rendered, points):
            position, anchor = guide(surface)
            # The photo's own alpha is finer than the field's.
            alpha = (render.alpha if capture.alphas is None
                     else capture.alphas[view].astype(np.float32) / 255)
            made = prepared.apply(shot, pixels[view], position=position, seeds_anchor=anchor,
                                  mask=alpha)
            # A pixel that the field does not cover has no guide: it is left white.
            cover = np.minimum(alpha, np.isfinite(position[..., 0]))[..., None]
            row.append(cell(made.image * cover + (1 - cover), height))
        rows.append((exemplar.name, row))
    first = max(row[0].shape[1] for _, row in rows)
    for _, row in rows:
        row[0] = np.pad(row[0], ((0, 0), (0, first - row[0].shape[1]), (0, 0)),
                        constant_values=255)
    width = max(total_width(row) for _, row in rows)
    return np.concatenate([labelled(row, name, width) for name, row in rows])


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="folder with styles/, faceblit_reference/, lee/")
    parser.add_argument("--out", type=Path, default=Path("contact-sheet.jpg"))
    parser.add_argument("--field", type=Path, help="field of lee/ (.npz); else reconstructed")
    parser.add_argument("--height", type=int, default=256, help="of a picture in pixels")
    parser.add_argument("--styles", nargs="+", help="only these")
    options = parser.parse_args(arguments)
    photo_file = options.data / "faceblit_reference" / "target1.png"
    pictures = sorted(path for path in (options.data / "styles").glob("*.png")
                      if not path.name.endswith(".mask.png")
                      and (not options.styles or path.stem in options.styles))
    if not (pictures and photo_file.is_file() and (options.data / "lee").is_dir()):
        print(f"skipped: {options.data} lacks styles/*.png, {photo_file.name} or lee/")
        return 0
    photo = np.ascontiguousarray(read_image(photo_file)[..., :3])
    landmarks = detect_landmarks(photo)
    if landmarks is None:
        print(f"no face found in {photo_file}", file=sys.stderr)
        return 2
    capture, _ = prepare_capture(options.data / "lee", CalibrateConfig(), need_face=True)
    field = (VoxelField.load(options.field) if options.field
             else reconstruct_with_figures(capture, SHORT)[0])
    made = sheet([Exemplar.load(path) for path in pictures], photo, landmarks, capture, field,
                 options.height)
    write_image(options.out, made, quality=88)
    print(f"{options.out}: {made.shape[1]} x {made.shape[0]}, {len(pictures)} exemplars")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
