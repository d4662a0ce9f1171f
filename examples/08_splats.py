"""Splats and meshes: for game engines, phones and viewers on the web.

Key concepts: `export_field` (the file's suffix says what is written), `ExportConfig`,
`SplatConfig`, `field_splats` and `render_splats` (the same splats in memory). Writes head.spz,
head.glb and splats.png: the field, the splats, and where they differ.

Run: python examples/01_portrait.py && python examples/08_splats.py
"""

from pathlib import Path

import numpy as np

import lfportrait as lf


def main(out: Path = Path("example-out"), size: int = 384, count: int = 200_000,
         steps: int = 60) -> None:
    styled = lf.StyledField.load(out / "styled.npz")

    # Splats lie on the visible surface and are fitted to views of the field.
    config = lf.SplatConfig(count=count, steps=steps)
    figures = lf.export_field(styled, out / "head.spz", lf.ExportConfig(splats=config))
    print(f"head.spz: {figures['splats']} splats, {figures['psnr']} dB to the field, "
          f"{figures['bytes'] / 1e6:.1f} MB")
    figures = lf.export_field(styled, out / "head.glb", lf.ExportConfig(kind="mesh"))
    print(f"head.glb: {figures['faces']} triangles, {figures['bytes'] / 1e6:.1f} MB")

    # The same splats in memory. As a renderer they can be coded for a panel, too.
    splats, _ = lf.field_splats(styled, config)
    cameras = lf.orbit_cameras(12, size, styled)
    field = np.clip(styled.render(cameras, 1).color, 0, 1)
    drawn = np.clip(lf.render_splats(splats, cameras, 1), 0, 1)
    lf.write_image(out / "splats.png", np.concatenate(
        [field, drawn, np.clip(0.5 + 2 * (drawn - field), 0, 1)], axis=1))


if __name__ == "__main__":
    main()
