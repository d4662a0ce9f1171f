"""Print how well people are kept in painted heads and photos: landmarks, eyes, forehead, mouth.

python scripts/measure_people.py --heads JOB [JOB ...] --photos p.jpg --styles a.jpg b.png \
    --json after.json --compare before.json

A job is a folder with ``field.npz`` and ``capture/``. Each head is painted in each style (preview;
``--full``: at full resolution without refinement) and looked at from the front and from both sides;
photos are painted with ``--quality best``. Figures beyond their limit have a star:

- landmarks: mean distance of the 68 landmarks found in the painted views (0, -20, 20 degrees) to
  those found in the real ones, over the distance of the outer eye corners; arc: of the 51 without
  the jaw, from -45 to 45 degrees, as in docs/turned-faces.md; lost: share of the views in which no
  face is found any more;
- gaze: degrees that the eyes look apart, more than the sitter's; lids: how much more or less open
  they are than his, over their width;
- forehead: share of its pixels that are nearer to the exemplar's cloth, hair or background than to
  its skin;
- seam: the strongest straight vertical step of color in the face (delta E); beyond the limit if
  the painting's own face has none as strong;
- mouth: how unlike both of its corners are, over the exemplar's contrast there.

"-" is what could not be measured. The JSON holds more figures.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfportrait import Session, UserError
from lfportrait.capture import Camera
from lfportrait.example import Exemplar, TransferConfig, paint
from lfportrait.face import detect_landmarks
from lfportrait.field import VoxelField
from lfportrait.files import read_json, write_image, write_json
from lfportrait.media.pictures import read_image
from lfportrait.stylize import StylizeConfig
from lfportrait_eval.metrics import arc_cameras, head_cameras
from lfportrait_eval.metrics.people import (
    PreparedPainting,
    Sitter,
    people_found,
    people_table,
    people_table_compared,
)

DEGREES = (0.0, -20.0, 20.0)
ARC, ARC_SIZE = np.linspace(-45.0, 45.0, 7), 384
"""As `lfportrait_eval.metrics.landmarks_kept` looks at a head."""

Picture = NDArray[np.uint8]


def eight_bits(image: NDArray[Any]) -> Picture:
    """A picture as uint8 [H, W, 3]."""
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image[..., :3])
    return np.asarray(np.clip(image, 0, 1) * 255 + 0.5, np.uint8)


def seen(field: VoxelField, cameras: Camera) -> list[Picture]:
    """All views of a field, uint8 [H, W, 3] each."""
    return [eight_bits(field.render(cameras, view).color) for view in range(len(cameras))]


def figures_of(painted: Sequence[Picture], sitter: Sitter, painting: PreparedPainting,
               arc: Sequence[Picture] = ()) -> dict[str, Any]:
    """`people_found` as JSON holds it: None for what could not be measured."""
    def known(value: Any) -> Any:
        if isinstance(value, list):
            return [known(item) for item in value]
        return value if np.isfinite(value) else None

    found = people_found(painted, sitter, painting, detect_landmarks, arc)
    return {name: known(value) for name, value in found.items()}


def measured_head(job: Path, styles: dict[str, tuple[Exemplar, PreparedPainting]], size: int,
                  full: bool) -> Iterator[tuple[str, dict[str, Any], list[Picture]]]:
    """Style, figures and painted views of one head."""
    session = Session(job / "field.npz", job / "capture")
    assert session.capture.landmarks is not None
    cameras = head_cameras(session.capture.landmarks, DEGREES, size)
    around = arc_cameras(session.field, ARC, ARC_SIZE)
    sitter = Sitter.of(seen(session.field, cameras), detect_landmarks, seen(session.field, around))
    if sitter is None:
        raise UserError(f"no face is found in the frontal view of {job}; take another head")
    for name, (exemplar, painting) in styles.items():
        styled = (session.stylize(exemplar, StylizeConfig(steps=0)) if full
                  else session.preview(exemplar))
        views = seen(styled, cameras)
        yield name, figures_of(views, sitter, painting, seen(styled, around)), views


def measured_photo(path: Path, styles: dict[str, tuple[Exemplar, PreparedPainting]],
                   ) -> Iterator[tuple[str, dict[str, Any], list[Picture]]]:
    """Style, figures and painted picture of one photo."""
    photo = eight_bits(read_image(path))
    sitter = Sitter.of([photo], detect_landmarks)
    if sitter is None:
        raise UserError(f"no face is found in {path}; take another photo")
    for name, (exemplar, painting) in styles.items():
        painted = eight_bits(paint(photo, exemplar, TransferConfig(quality="best"),
                                   sitter.landmarks[0]).image)
        yield name, figures_of([painted], sitter, painting), [painted]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--heads", nargs="*", type=Path, default=[],
                        help="job folders with field.npz and capture/")
    parser.add_argument("--photos", nargs="*", type=Path, default=[], help="pictures of people")
    parser.add_argument("--styles", nargs="+", required=True,
                        help="exemplars: pictures, or names of built-in ones")
    parser.add_argument("--full", action="store_true",
                        help="paint heads at full resolution, not as previews")
    parser.add_argument("--size", type=int, default=640, help="of the heads' views in pixels")
    parser.add_argument("--json", type=Path, help="file for all figures")
    parser.add_argument("--pictures", type=Path, help="folder for what was painted")
    parser.add_argument("--compare", type=Path, help="earlier --json file to print beside")
    options = parser.parse_args(arguments)
    missing = [path for path in (*(job / part for job in options.heads
                                   for part in ("field.npz", "capture")), *options.photos)
               if not path.exists()]
    if missing or not (options.heads or options.photos):
        print(f"skipped: there is no {missing[0]}" if missing
              else "skipped: name --heads or --photos to measure")
        return 0
    before = read_json(options.compare) if options.compare is not None else None
    rows: dict[str, dict[str, Any]] = {}
    try:
        styles = {Path(style).stem: (one := Exemplar.load(style), PreparedPainting.of(one))
                  for style in options.styles}
        work = [(job.name, measured_head(job, styles, options.size, options.full))
                for job in options.heads]
        work += [(f"{path.stem}, photo", measured_photo(path, styles)) for path in options.photos]
        for sitter, pairs in work:
            rows[sitter] = {}
            for style, figures, pictures in pairs:
                print(sitter, style, file=sys.stderr)
                rows[sitter][style] = figures
                if options.pictures is not None:
                    write_image(options.pictures / f"{sitter.replace(', ', '_')}_{style}.png",
                                np.concatenate(pictures, axis=1))
    except UserError as error:
        print(error, file=sys.stderr)
        return 2
    print(people_table(rows))
    if before is not None:
        print()
        print(people_table_compared(before, rows))
    if options.json is not None:
        write_json(options.json, rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
