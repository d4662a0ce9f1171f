"""Hello, field: photos with known cameras -> a radiance field -> pictures from new views.

Key concepts: `Capture` (photos, cameras, mattes), `reconstruct`, `VoxelField.render`, camera paths.
Writes field.npz and hello.png: the head from the left, the front and the right.

Run: python examples/01_hello.py
"""

from pathlib import Path

import numpy as np

from lfportrait.capture import Camera
from lfportrait.demo import demo_capture
from lfportrait.field import ReconstructConfig, reconstruct_with_figures
from lfportrait.files import write_image
from lfportrait.progress import Progress


def main(out: Path = Path("example-out"), size: int = 256, views: int = 40,
         rays: tuple[float, float] = (1.0, 3.0)) -> None:
    # The package brings photos of a head; Capture.load("folder") reads your own calibrated photos,
    # and lfportrait.capture.calibrate finds the cameras of photos that have none.
    capture = demo_capture(size=size, views=views)

    # Two levels of resolution, a few million rays: seconds instead of minutes.
    with Progress("reconstruct") as progress:
        field, figures = reconstruct_with_figures(
            capture, ReconstructConfig(resolutions=(64, 128), rays=rays), progress)
    print(f"{figures['voxels']} voxels, held-out views at {figures['test']['psnr']:.1f} dB")
    field.save(out / "field.npz")

    # The world: +y up, +z out of the face; 0 degrees on an arc is frontal.
    cameras = Camera.arc(np.array([-40.0, 0.0, 40.0]), distance=4.0, width=size, height=size,
                         focal=1.7 * size)
    pictures = [field.render(cameras, view, background=1.0).color for view in range(3)]
    write_image(out / "hello.png", np.concatenate(pictures, axis=1))


if __name__ == "__main__":
    main()
