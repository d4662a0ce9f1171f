"""A page that anybody can open: the field in one HTML file, turned and zoomed in any browser.

Key concepts: `write_page`, `PageConfig` (caption, size, harmonics). Writes portrait.html: open it
by a double click. A field of `lfportrait stylize` brings a slider from photo to painting along;
here the photographed field keeps how its colors change with the direction.

Run: python examples/01_hello.py && python examples/05_page.py
"""

from pathlib import Path

from lfportrait.field import VoxelField
from lfportrait.share import PageConfig, write_page


def main(out: Path = Path("example-out")) -> None:
    field = VoxelField.load(out / "field.npz")
    figures = write_page(field, out / "portrait.html",
                         PageConfig(title="Hello", date="today", sh=1))
    print(f"{figures['rows']} voxels in {figures['bytes'] / 1e6:.1f} MB, no library, no network")


if __name__ == "__main__":
    main()
