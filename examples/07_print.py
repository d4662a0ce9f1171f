"""A print: a page behind a sheet of lenses, and what will be seen through them.

Key concepts: `PrintConfig` (paper and lens sheet), `PrintSheet`, `write_print`, `SheetView`. Writes
print.png, the page to be printed at 100 %, and seen.png: a piece of the page, and the print to an
eye on the left and on the right.

Run: python examples/01_portrait.py && python examples/07_print.py
"""

from pathlib import Path

import numpy as np

import lfportrait as lf


def main(out: Path = Path("example-out"), size: str = "125x140mm", dpi: float = 720.0) -> None:
    styled = lf.StyledField.load(out / "styled.npz")

    # The lens sheet's exact pitch comes from a test page: `lfportrait print --pitch-test`.
    # The head is so large and so low that its bust ends below the paper's edge.
    sheet = lf.PrintSheet.of(lf.PrintConfig(lpi=60.12, dpi=dpi, size=size, head=0.97,
                                            shift_y=-0.12))
    print(sheet.summary())

    # One ray for each printed pixel, written in bands: a poster takes no more memory than a card.
    figures = lf.write_print(styled, sheet, out / "print.png")
    print(f"{figures['width']} x {figures['height']} pixels in {figures['seconds']['page']} s")

    # Under the lenses, without ink and paper: eyes at shares of the viewing angle.
    view = lf.SheetView.of(styled, sheet, height=480)
    left, right = view.picture(-0.3), view.picture(0.3)
    page = lf.read_image(out / "print.png")[..., :3]
    top, side = (page.shape[0] - len(left)) // 2, (page.shape[1] - left.shape[1]) // 2
    piece = page[top:top + len(left), side:side + left.shape[1]] / np.float32(255)
    lf.write_image(out / "seen.png", np.concatenate([piece, left, right], axis=1))


if __name__ == "__main__":
    main()
