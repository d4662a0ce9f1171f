"""Print the quality of our transfers beside FaceBlit's published results, by the same figures.

Patches: mean distance (delta E) of 7 x 7 patches to the exemplar's nearest, searched exactly for
16000 that are spread evenly; over the face, and over the whole picture. Landmarks: error against
the photo over the distance of the outer eye corners. Lower is better.

python scripts/compare_transfer.py DATA --methods styleblit faceblit facestyle --out results

``styleblit`` is ours with --quality fast, ``best`` with --quality best. DATA holds
faceblit_reference/ and styles/; without them the script says so and does nothing.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from lfportrait.example import (
    MethodConfig,
    TransferConfig,
    paint,
)
from lfportrait.face import detect_landmarks
from lfportrait.files import write_image, write_json
from lfportrait_eval.baselines.transfer import FaceBlitConfig, FaceStyleConfig, NetworkConfig
from lfportrait_eval.metrics.transfer_quality import (
    SAMPLES,
    compare_with_references,
    quality_table,
    references,
)

CONFIGS: dict[str, MethodConfig] = {
    "styleblit": TransferConfig(), "best": TransferConfig(quality="best"),
    "faceblit": FaceBlitConfig(), "facestyle": FaceStyleConfig(), "network": NetworkConfig()}


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="folder with faceblit_reference/ and styles/")
    parser.add_argument("--methods", nargs="+", choices=tuple(CONFIGS),
                        default=["styleblit", "faceblit", "facestyle"])
    parser.add_argument("--styles", nargs="+", help="only these of the five")
    parser.add_argument("--samples", type=int, default=SAMPLES,
                        help="patches looked up in a region, about")
    parser.add_argument("--seed", type=int, default=0, help="of the patches' places")
    parser.add_argument("--out", type=Path, help="folder for the results and figures.json")
    options = parser.parse_args(arguments)
    found = references(options.data)
    if isinstance(found, str):
        print(found)
        return 0
    photo, published = found
    if options.styles:
        unknown = sorted(set(options.styles) - set(published))
        if unknown:
            parser.error(f"no published result for {', '.join(unknown)}")
        published = {style: published[style] for style in options.styles}

    def by(method: str) -> Any:
        return lambda image, exemplar, points: paint(image, exemplar, CONFIGS[method],
                                                     points).image

    def keep(style: str, method: str, image: Any) -> None:
        if options.out is not None:
            write_image(options.out / f"{style}_{method}.png", image)

    rows = compare_with_references(photo, published, {name: by(name) for name in options.methods},
                                   detect_landmarks, samples=options.samples, seed=options.seed,
                                   keep=keep)
    print(quality_table(rows))
    if options.out is not None:
        write_json(options.out / "figures.json", rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
