"""A display of one's own: coded for, looked at without the panel, and checked.

Key concepts: `Display` (a panel in a few numbers, or a file), `EncodeConfig` (where the head
stands), `simulate` (what an eye sees through the lenses), `deinterlace`. Writes mine.toml and
display.png: what the left, the middle and the right eye see, and the coded picture.

Run: python examples/01_portrait.py && python examples/04_display.py
"""

from pathlib import Path

import numpy as np

import lfportrait as lf


def main(out: Path = Path("example-out"), width: int = 960, height: int = 720) -> None:
    styled = lf.StyledField.load(out / "styled.npz")

    # Pitch: sub-pixels under one lens. Slant: radians against the vertical. Cone: degrees between
    # the outermost views. `lf.Display.load("visual.json")` reads a Looking Glass' calibration.
    display = lf.Display(width, height, views=48, pitch=9.4, slant=0.17, cone=40.0, name="mine")
    display.save(out / "mine.toml")
    # From now on `lfportrait make photos/ --display mine.toml` knows it, too.

    # Composed: the face in the panel's plane, no deeper than the panel shows sharply.
    config = lf.EncodeConfig(compose=True)
    # The view of each sub-pixel, made once for all pictures and kept in the user's cache.
    mask = lf.ViewMask.build(display)
    coded = lf.encode(styled, display, config, mask=mask)

    # Eyes lie on a level line at the viewing distance, in half panel heights. At the cone's edges
    # they would see two pictures at once, as on a real panel: these are a quarter away from there.
    eyes = display.eyes()[[display.views // 4, display.views // 2, -display.views // 4]]
    seen = [lf.simulate(coded, display, (float(eye),), crosstalk=0.3) for eye in eyes]
    lf.write_image(out / "display.png", np.concatenate(
        [np.concatenate(seen[:2], axis=1),
         np.concatenate([seen[2], coded / np.float32(255)], axis=1)], axis=0))

    # The check that needs no eyes: the sub-pixels of a view are those of that view's own picture.
    view = display.views // 3
    picture, owned = lf.deinterlace(coded, display, view)
    assert np.array_equal(picture[owned], lf.render_view(styled, display, view, config)[owned])
    print(f"view {view} owns {owned.sum()} sub-pixels, all equal to the direct render")


if __name__ == "__main__":
    main()
