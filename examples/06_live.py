"""Live on a panel: a graphics card codes each picture while the viewer turns the head.

Key concepts: `show_field`, `OffscreenWindow` (the panel's window in memory, with a script of events
instead of a viewer). Writes live.png: three of its pictures, as the head is turned by a key.

Run: python examples/01_portrait.py && python examples/06_live.py
"""

import sys
from pathlib import Path

import numpy as np

import lfportrait as lf


def main(out: Path = Path("example-out"), width: int = 640, height: int = 480,
         attended: bool = False) -> None:
    styled = lf.StyledField.load(out / "styled.npz")
    display = lf.Display(width, height, views=32, pitch=9.4, slant=0.17, cone=40.0, name="mine")

    if attended:
        # An ordinary window, with what one eye sees. Without `simulate` the panel's own screen is
        # looked for. Drag to turn the head; h lists the keys; `photo` lets m mix in the photo.
        photo = lf.VoxelField.load(out / "field.npz")
        try:
            lf.show_field(styled, display, simulate=True, photo=photo)
        except lf.UserError as error:  # no screen, no graphics card, a missing package: one line
            print(error)
        return

    # Events of a viewer, and the pictures before which they happen: space stops the gentle sway,
    # each arrow turns the head by five degrees.
    pause, turn = {"event_type": "char", "data": " "}, {"event_type": "key_down",
                                                        "key": "ArrowRight"}
    script = {0: [pause], 1: [turn] * 5, 2: [turn] * 5}
    window = lf.OffscreenWindow((width, height), script, frames=3, exact=True)
    # "gpu" is the best card, or a slow program in its place (Mesa's llvmpipe).
    figures = lf.show_field(styled, display, lf.EncodeConfig(compose=True), window=window,
                            device="gpu")
    print(figures)
    seen = [lf.simulate(picture, display) for picture in window.pictures]
    lf.write_image(out / "live.png", np.concatenate(seen, axis=1))


if __name__ == "__main__":
    main(attended="--window" in sys.argv)
