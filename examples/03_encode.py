"""Code a field's light field for a lenticular panel: one ray per sub-pixel.

Key concepts: `Display` (presets, your own numbers, Looking Glass calibrations), `ViewMask` (the
view of every sub-pixel), `encode`. Writes lightfield.png, to be shown pixel for pixel.

Run: python examples/01_hello.py && python examples/03_encode.py
"""

from pathlib import Path

from lfportrait.field import VoxelField
from lfportrait.files import write_image
from lfportrait.lightfield import Display, EncodeConfig, ViewMask, encode_with_figures


def main(out: Path = Path("example-out"), width: int = 1920, height: int = 1080) -> None:
    field = VoxelField.load(out / "field.npz")

    # Any panel is a few numbers; Display.preset("generic-4k") or Display.load("visual.json") have
    # them for you. Pitch: sub-pixels under one lens. Slant: radians against the vertical.
    display = Display(width=width, height=height, views=60, pitch=16.2, slant=0.1745, cone=40.0,
                      name="mine")
    display.save(out / "mine.toml")

    # Computed once per display and kept in the user's cache.
    mask = ViewMask.build(display)
    print(f"mask guide: {mask.nbytes / 1e6:.1f} MB in {mask.seconds * 1000:.0f} ms")

    # The head takes 80 % of the panel's height; what lies at its middle is sharpest.
    image, figures = encode_with_figures(field, display, EncodeConfig(size=0.8, focus=0.0),
                                         mask=mask)
    print(f"{figures['subpixels']} sub-pixels in {figures['seconds']['cast']:.2f} s")
    write_image(out / "lightfield.png", image, compress_level=1)


if __name__ == "__main__":
    main()
