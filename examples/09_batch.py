"""Many portraits: people, styles and displays from one file; one failure stops no other.

Key concepts: a jobs file, `batch`, its results. Writes jobs.toml, results/index.html with all
portraits, and batch.png. Run it twice: the second time there is nothing to do.

Run: python examples/01_portrait.py && python examples/03_style.py && python examples/09_batch.py
"""

from pathlib import Path

import numpy as np

import lfportrait as lf

JOBS = """
[defaults.reconstruct]           # any parameter of `lfportrait make`
resolutions = {levels}
rays = [{rays}, {rays}]
[defaults.stylize]
pixels = {pixels}
content_network = "embedded"     # the small one that the package brings
style_network = "embedded"

[[sitter]]                       # photos = "monday/*" makes a sitter of each folder and video
name = "demo"
capture = "capture"

[[style]]
painting = "poster.png"          # a picture's file, or a name from `lfportrait styles`
[[style]]
name = "half"
painting = "poster.png"
stylize.strength = 0.5           # for this style only

[[display]]
panel = "mine.toml"              # a file, or a name from `lfportrait display list`
"""


def main(out: Path = Path("example-out"), size: int = 384, levels: tuple[int, int] = (80, 160),
         rays: float = 2.0, pixels: float = 256.0, width: int = 960, height: int = 720) -> None:
    lf.Display(width, height, views=48, pitch=9.4, slant=0.17, name="mine").save(out / "mine.toml")
    jobs = out / "jobs.toml"
    jobs.write_text(JOBS.format(levels=list(levels), rays=rays, pixels=pixels), encoding="utf-8")

    # Capture, field and skin are made once for both styles. On many machines: `lfportrait batch
    # jobs.toml --on ray`. One portrait alone: lf.make("photos/", "painting.png", out).
    figures = lf.batch(jobs, out / "results")
    for name, why in figures["failed"].items():
        print(f"{name} failed: {why}")

    heads = [lf.StyledField.load(path) for path in sorted(out.glob("results/demo/*/styled.npz"))]
    cameras = lf.orbit_cameras(12, size, heads[0])
    lf.write_image(out / "batch.png", np.concatenate(
        [head.render(cameras, 11).color for head in heads], axis=1))


if __name__ == "__main__":
    main()
