"""A painted skin: the surface of a head as one picture, and what a style makes of it.

Key concepts: `Skin` (the visible surface, laid out as charts side by side), `paint` (a second for
a style, without any training), `Painting.at` (its colors at the field's points). Writes skin.png:
the skin in two styles, and the head in the colors of the second.

Run: python examples/01_portrait.py && python examples/12_skin.py
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import lfportrait as lf


def main(out: Path = Path("example-out"), pixels: float = 256.0) -> None:
    field, capture = lf.VoxelField.load(out / "field.npz"), lf.Capture.load(out / "capture")
    # Landmarks say where the face is, the cameras which places the photos saw. The charts have
    # `pixels` for each world unit: a head is about 1.5 units high.
    skin = lf.Skin.of(field, capture.landmarks, capture.cameras, pixels)
    print(f"{len(skin.index)} places, {np.mean(skin.ears > 0.5):.1%} of them ears and "
          f"{np.mean(skin.clothes > 0.5):.0%} clothes; photos saw {np.mean(skin.seen > 0.5):.0%}")
    paintings = [lf.paint(skin, lf.Exemplar.load(style)) for style in ("fauve", "charcoal")]

    # The same head in the paint of its skin: a color for each of the field's points that the skin
    # shows, the same from all sides; the others keep theirs. `lf.stylize` begins so, too. The
    # harmonic of degree 0 is 0.2820948 in every direction.
    colors = paintings[1].at(skin.rows)  # float32 [N, 3] in [0, 1], NaN where the skin has none
    sh = np.where(np.isfinite(colors), (colors - 0.5) / 0.2820948, field.sh[:, :, 0])
    head = replace(field, sh=np.ascontiguousarray(sh[:, :, None], np.float32))

    cameras = lf.orbit_cameras(12, len(paintings[1].color), head)
    lf.write_image(out / "skin.png", np.concatenate(
        [*(one.color for one in paintings), head.render(cameras, 11).color], axis=1))


if __name__ == "__main__":
    main()
