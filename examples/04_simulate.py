"""Look at a coded picture without the panel: what eyes at several places see.

Key concepts: `simulate` (an eye behind the lenses, with cross-talk), `deinterlace` (the sub-pixels
that one view owns, exactly). Writes eyes.png: the left, the middle and the right eye point.

Run: python examples/01_hello.py && python examples/03_encode.py && python examples/04_simulate.py
"""

from pathlib import Path

import numpy as np

from lfportrait.field import VoxelField
from lfportrait.files import write_image
from lfportrait.lightfield import Display, EncodeConfig, deinterlace, render_view, simulate
from lfportrait.media.pictures import read_image


def main(out: Path = Path("example-out")) -> None:
    display = Display.load(out / "mine.toml")
    coded = read_image(out / "lightfield.png")

    # Eye points lie on a horizontal line at the viewing distance, in half panel heights.
    eyes = display.eyes()
    seen = [simulate(coded, display, (float(eye),), crosstalk=0.3)
            for eye in (eyes[0], eyes[len(eyes) // 2], eyes[-1])]
    write_image(out / "eyes.png", np.concatenate(seen, axis=0))

    # The check that needs no eyes: the sub-pixels of a view are the directly rendered view's.
    view = display.views // 3
    picture, owned = deinterlace(coded, display, view)
    direct = render_view(VoxelField.load(out / "field.npz"), display, view, EncodeConfig())
    assert np.array_equal(picture[owned], direct[owned])
    print(f"view {view} owns {owned.sum()} sub-pixels, all equal to the direct render")


if __name__ == "__main__":
    main()
