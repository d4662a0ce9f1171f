"""A portrait in ten lines: photos and a painting become a head for a light-field display.

Key concepts: `Capture` (photos, cameras, mattes, landmarks), `reconstruct`, `Exemplar` (a
painting), `stylize`, `Display`, `encode`, `write_page`. Writes lightfield.png, to be shown on the
panel pixel for pixel, portrait.html for any browser, the files that the other examples read, and
portrait.png: the photographed field, then the painted one from the right, the front and the left.

Run: python examples/01_portrait.py
"""

from pathlib import Path

import numpy as np

import lfportrait as lf

# Two levels of resolution and a few million rays: half a minute instead of two.
QUICK = lf.ReconstructConfig(resolutions=(80, 160), rays=(1.0, 3.0))


def main(out: Path = Path("example-out"), size: int = 384, views: int = 60, panel: str =
         "generic-4k", config: lf.ReconstructConfig = QUICK,
         painting: lf.StylizeConfig | None = None) -> None:
    # The package brings a head. `lf.Capture.load("folder")` reads photos whose cameras are known,
    # `lf.calibrate("folder")` finds the cameras of photos as they come from a phone.
    capture = lf.demo_capture(size, views)
    field = lf.reconstruct(capture, config)
    styled = lf.stylize(field, capture, lf.Exemplar.load("fauve"), painting)
    image = lf.encode(styled, lf.Display.resolve(panel))
    lf.write_image(out / "lightfield.png", image)
    lf.write_page(styled, out / "portrait.html", lf.PageConfig(title="In ten lines"))
    capture.save(out / "capture")
    field.save(out / "field.npz")
    styled.save(out / "styled.npz")

    # The head from all sides; the first camera of the orbit is before the face.
    cameras = lf.orbit_cameras(12, size, styled)
    sides = [source.render(cameras, view).color for source, view in (
        (field, 0), (styled, 11), (styled, 0), (styled, 2))]
    lf.write_image(out / "portrait.png", np.concatenate(sides, axis=1))


if __name__ == "__main__":
    main()
