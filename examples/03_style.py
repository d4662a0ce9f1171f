"""A style of one's own: previewed in a second, mixed with another one by regions.

Key concepts: `Exemplar` files (a picture, NAME.landmarks.txt beside it), `Session` (a head kept in
memory to try styles on), `preview_all`, `mix`. Writes poster.png, the style, and style.png: the
style, the head in it, and a mixture.

Run: python examples/01_portrait.py && python examples/03_style.py
"""

from pathlib import Path

import numpy as np

import lfportrait as lf


def main(out: Path = Path("example-out"), size: int = 384,
         painting: lf.StylizeConfig | None = None) -> None:
    # Any picture with one face is a style; here one is made, a poster in four inks. Landmarks lie
    # beside it, one "x y" a line, or are detected.
    model = lf.Exemplar.load("fauve")
    tone = model.image.mean(axis=2)
    inks = np.uint8([[24, 32, 66], [178, 58, 72], [244, 162, 97], [252, 236, 206]])
    poster = inks[np.digitize(tone, np.quantile(tone, [0.25, 0.5, 0.75]))]
    lf.write_image(out / "poster.png", poster)
    np.savetxt(out / "poster.landmarks.txt", model.landmarks, fmt="%.2f")

    # A session reads the head once. A preview is what `lf.stylize` begins with; it has no fit, no
    # refinement and half the resolution.
    session = lf.Session(out / "field.npz", out / "capture", painting)
    own = session.preview_all([out / "poster.png", "charcoal"])

    # The mixture is made without training: hair of the other style, a little of the photo's light.
    mixture = session.mix(identity=0.3, regions={"hair": "charcoal", "clothes": "charcoal"})
    print(own.styles, own.regions)

    cameras = lf.orbit_cameras(12, size, own)
    height, width = tone.shape
    columns = np.arange(size) * width // size
    seen = [poster[np.ix_((height - width) // 2 + columns, columns)] / 255,
            own.render(cameras, 11).color, mixture.render(cameras, 1).color]
    lf.write_image(out / "style.png", np.concatenate(seen, axis=1))


if __name__ == "__main__":
    main()
