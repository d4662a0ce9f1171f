"""Print one table of figures of several stylised fields of one head, method beside method.

python scripts/stylize_figures.py DATA --field lee.npz --capture lee.cap \
    --styled chart=a.npz:ken views=b.npz:ken --out figures.json

After a stylised field's file stands its exemplar: a picture, or a name in DATA/styles. Without one,
what is measured against the painting is left out. Regions for the repeats are those that a file
keeps for its rows; a file without any takes another's of the same rows. The column "photo" holds
the floors: the photoreal views' own error.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lfportrait import models
from lfportrait.capture import Capture
from lfportrait.example import Exemplar
from lfportrait.field import VoxelField
from lfportrait.files import write_json
from lfportrait_eval.metrics import (
    Arc,
    PatchIndex,
    RowLabels,
    landmarks_kept,
    region_repeats,
    views_fidelity,
    without_nan,
)

CONE = 40.0
FIDELITY = (0.0, 45.0)
ROWS: tuple[tuple[str, str, str], ...] = (
    ("error of views {0:g} degrees apart, over contrast", "consistency.gap_1.normalised", ".4f"),
    ("error of views {1:g} degrees apart, over contrast", "consistency.gap_7.normalised", ".4f"),
    ("patches to the exemplar's, 0 and 45 degrees (delta E)", "patch_fidelity", ".2f"),
    ("landmarks moved, -45 to 45 degrees, over the eyes", "identity.nme", ".4f"),
    ("share of the faces found", "identity.detected", ".2f"),
    ("contours kept, frontal (correlation)", "gradient_correlation", ".3f"),
    ("repeats in the hair, over the exemplar's", "repeats.hair.ratio", ".2f"),
    ("repeats in neck and body, over the exemplar's", "repeats.body.ratio", ".2f"),
    ("file (MB)", "megabytes", ".1f"))


@dataclass
class Styled:
    """A stylised field to be measured."""

    name: str
    path: Path
    exemplar: Path | None


def styled_file(text: str, styles: Path) -> Styled:
    """``NAME=FILE`` or ``NAME=FILE:EXEMPLAR``."""
    name, equals, rest = text.partition("=")
    file, _, style = rest.partition(":")
    if not (name and equals and file):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=FILE[:EXEMPLAR]")
    if not style:
        return Styled(name, Path(file), None)
    known = styles / f"{style}.png"
    return Styled(name, Path(file), known if known.is_file() else Path(style))


Painting = tuple[Exemplar, PatchIndex]


def measured(styled: VoxelField, field: VoxelField, arc: Arc, painting: Painting | None,
             labels: RowLabels | None, landmarks: np.ndarray | None) -> dict[str, Any]:
    """All figures of one stylised field."""
    painted = arc.seen(styled)
    figures: dict[str, Any] = {"consistency": arc.consistency(painted),
                               "gradient_correlation": arc.contours(painted)}
    if models.available("face-landmarker"):
        figures["identity"] = landmarks_kept(field, styled, int(arc.cameras.width[0]))
    if painting is not None:
        exemplar, patches = painting
        figures["patch_fidelity"] = views_fidelity(styled, patches, FIDELITY)
        if labels is not None:
            figures["repeats"] = region_repeats(styled, exemplar, labels, landmarks=landmarks)
    return figures


def table(columns: dict[str, dict[str, Any]], views: int = 21) -> str:
    """Markdown: a row for each figure, a column for each field, measured with so many views."""
    step = CONE / (views - 1)
    lines = ["| figure | " + " | ".join(columns) + " |", "| --- |" + " --- |" * len(columns)]
    for title, place, how in ROWS:
        cells = []
        for figures in columns.values():
            value: Any = figures
            for key in place.split("."):
                value = (value or {}).get(key)
            cells.append("-" if value is None else format(value, how))
        lines.append(f"| {title.format(step, 7 * step)} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def compare(entries: list[Styled], field: VoxelField, landmarks: np.ndarray | None,
            views: int) -> dict[str, dict[str, Any]]:
    """Figures by name, the photo's floors last."""
    arc = Arc.of(field, CONE, views)
    found = {entry.name: RowLabels.read(entry.path) for entry in entries}
    paintings: dict[Path | None, Painting | None] = {None: None}
    columns: dict[str, dict[str, Any]] = {}
    for entry in entries:
        print(entry.name, file=sys.stderr)
        styled = VoxelField.load(entry.path)
        rows = [found[entry.name], *found.values()]
        labels = next((one for one in rows if one is not None
                       and len(one.weights) == len(styled.density)), None)
        if entry.exemplar is not None and entry.exemplar not in paintings:
            exemplar = Exemplar.load(entry.exemplar)
            paintings[entry.exemplar] = exemplar, PatchIndex(exemplar.image)
        columns[entry.name] = without_nan({
            **measured(styled, field, arc, paintings[entry.exemplar], labels, landmarks),
            "megabytes": entry.path.stat().st_size / 1e6})
    floors = next(iter(columns.values()))["consistency"]
    columns["photo"] = {"consistency": {
        gap: {"normalised": figures["floor_normalised"]} for gap, figures in floors.items()}}
    return columns


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="folder with styles/")
    parser.add_argument("--field", type=Path, required=True, help="the real field (.npz)")
    parser.add_argument("--capture", type=Path, help="its capture, for the size of the face")
    parser.add_argument("--styled", nargs="+", required=True, metavar="NAME=FILE[:EXEMPLAR]",
                        help="stylised fields of the same head")
    parser.add_argument("--views", type=int, default=21, help="on the arc of 40 degrees, 8 or more")
    parser.add_argument("--out", type=Path, help="file for all figures (.json)")
    options = parser.parse_args(arguments)
    try:
        entries = [styled_file(text, options.data / "styles") for text in options.styled]
    except argparse.ArgumentTypeError as error:
        parser.error(str(error))
    if len({entry.name for entry in entries} | {"photo"}) <= len(entries):
        parser.error("each stylised field needs a name of its own, other than photo")
    paths = [options.field, options.capture, *(path for entry in entries
                                               for path in (entry.path, entry.exemplar))]
    missing = [path for path in paths if path is not None and not path.exists()]
    if missing:
        print(f"skipped: there is no {missing[0]}")
        return 0
    landmarks = Capture.load(options.capture).landmarks if options.capture else None
    columns = compare(entries, VoxelField.load(options.field), landmarks, options.views)
    print(table(columns, options.views))
    if options.out is not None:
        write_json(options.out, columns)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
