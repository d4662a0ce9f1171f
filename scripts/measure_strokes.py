"""Print whether strokes stick: stylised views one degree apart, warped into each other by depth.

python scripts/measure_strokes.py DATA --field lee.npz --styles ken het --out strokes.json

DATA holds ``lee/`` (a calibrated capture of a head) and ``styles/``. The stylised field and guides
on the surface against guides of each view alone; errors over the contrast of the stylised view,
lower is better.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from lfportrait.capture import CalibrateConfig
from lfportrait.example import Exemplar
from lfportrait.face import detect_landmarks
from lfportrait.field import VoxelField, reconstruct_with_figures
from lfportrait.files import write_json
from lfportrait.job.prepare import prepare_capture
from lfportrait.stylize import stylize
from lfportrait_eval.bench.run import SHORT
from lfportrait_eval.metrics.strokes import strokes_stick, strokes_table


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="folder with lee/ and styles/")
    parser.add_argument("--field", type=Path, help="field of lee/ (.npz); else reconstructed")
    parser.add_argument("--styles", nargs="+",
                        default=["bronzestatue", "charcoalman", "het", "ken", "stonebust"])
    parser.add_argument("--out", type=Path, help="file for all figures (.json)")
    options = parser.parse_args(arguments)
    paths = [options.data / "styles" / f"{name}.png" for name in options.styles]
    missing = [path for path in (options.data / "lee", *paths) if not path.exists()]
    if missing:
        print(f"skipped: there is no {missing[0]}")
        return 0
    capture, _ = prepare_capture(options.data / "lee", CalibrateConfig(), need_face=True)
    assert capture.landmarks is not None
    field = (VoxelField.load(options.field) if options.field
             else reconstruct_with_figures(capture, SHORT)[0])
    figures = {}
    for path in paths:
        exemplar = Exemplar.load(path)
        styled = stylize(field, capture, exemplar)
        figures[path.stem] = strokes_stick(field, capture.landmarks, exemplar, styled=styled,
                                           detect=detect_landmarks)
    print(strokes_table(figures))
    if options.out is not None:
        write_json(options.out, figures)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
