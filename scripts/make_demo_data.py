"""Make the demo's data: photos of a modelled head, its field, painted portraits, other people.

python scripts/make_demo_data.py [src/lfportrait/demo/data]

Takes about two minutes on two cores. What it writes is committed and goes into the package, so that
the demo renders nothing:

capture/    the folder of a capture: 60 photos (WebP, its alpha without loss) and their cameras
head.npz    the same head as a lattice of opacities and colors, on which paintings are tried
paintings/  the built-in styles, each with its landmarks and its mask
people/     portraits of other heads with landmarks, to train a network on; sitter.webp is the
            demo's head, larger

All of it is modelled by `modelled_head`, and the same on every run with the same versions of NumPy,
Numba and Pillow.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from lfportrait.capture import Camera
from lfportrait.demo import DATA
from lfportrait.face import write_landmarks
from lfportrait.field import C0
from lfportrait.files import fresh_folder, read_json, write_image, write_json
from modelled_head import (
    SITTER,
    STYLES,
    head_field,
    landmarks,
    painted_exemplar,
    photograph,
    random_person,
    studio_capture,
)

SIZE, VIEWS, PEOPLE = 384, 60, 16
"""Side of a photo in pixels, photos, and people besides the sitter."""
QUALITY, ROUGH = 95, 85
"""Of WebP: of the photos, whose error is a tenth of the field's, and of the people."""
PAINTED = 91
"""Of JPEG with full color: strokes are the finest thing in a painting."""


def clear(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A cut-out [H, W, 4] with smooth colors around it: a border would blur into the person."""
    outside = picture[..., 3] == 0
    nearest = ndimage.distance_transform_edt(outside, return_distances=False, return_indices=True)
    near = picture[..., :3][tuple(nearest)]
    smooth = ndimage.gaussian_filter(near.astype(np.float32), (3, 3, 0))
    colors = np.where(outside[..., None], np.uint8(smooth + 0.5), near)
    return np.dstack([colors, picture[..., 3]])


def cut_out(path: Path, picture: NDArray[np.uint8], quality: int = QUALITY) -> None:
    """Write a cut-out as WebP, whose alpha is exact."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(clear(picture)).save(path, quality=quality, method=6)


def capture(out: Path) -> None:
    taken = studio_capture(SIZE, VIEWS)
    with tempfile.TemporaryDirectory() as folder:
        taken.save(folder)
        data = read_json(Path(folder) / "transforms.json")
    for view, frame in enumerate(data["frames"]):
        assert taken.alphas is not None
        path = Path(frame["file_path"]).with_suffix(".webp")
        cut_out(out / path, np.dstack([taken.images[view], taken.alphas[view]]))
        frame["file_path"] = path.as_posix()
    write_json(out / "transforms.json", data)


def head(path: Path) -> None:
    field = head_field()
    # The table lists its points in the order of the lattice.
    assert (np.diff(field.links[field.links >= 0]) == 1).all()
    color = 0.5 + C0 * field.sh[:, :, 0]
    np.savez_compressed(path, filled=np.packbits(field.links >= 0), side=len(field.links),
                        radius=field.radius, highest=field.density.max(),
                        density=np.uint8(255 * field.density / field.density.max() + 0.5),
                        color=np.uint8(255 * np.clip(color, 0, 1) + 0.5))


def paintings(out: Path) -> None:
    out.mkdir()
    for style in STYLES:
        painted = painted_exemplar(style)
        assert painted.mask is not None
        Image.fromarray(painted.image).save(out / f"{style}.jpg", quality=PAINTED, subsampling=0,
                                            optimize=True)
        write_image(out / f"{style}.mask.png", np.uint8(255 * painted.mask + 0.5))
        write_landmarks(out / f"{style}.landmarks.txt", painted.landmarks)


def people(out: Path) -> None:
    camera = Camera.arc(np.array([8.0]), distance=4.4, width=768, height=1024, focal=1500.0)
    sitters = {"sitter": (SITTER, camera)}
    random = np.random.default_rng(0)
    for number in range(PEOPLE):
        model = random_person(random)
        camera = Camera.arc(random.uniform(-25, 25, 1), distance=random.uniform(3.6, 4.6),
                            width=384, height=512, focal=2.2 * 512)
        sitters[f"person_{number:02}"] = model, camera
    for name, (model, camera) in sitters.items():
        cut_out(out / f"{name}.webp", photograph(model, camera).image, ROUGH)
        write_landmarks(out / f"{name}.landmarks.txt", camera.project(landmarks(model))[0][0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, nargs="?", default=DATA, help="a folder to write")
    with fresh_folder(parser.parse_args().out) as out:
        capture(out / "capture")
        head(out / "head.npz")
        paintings(out / "paintings")
        people(out / "people")
        files = [path for path in out.rglob("*") if path.is_file()]
        print(f"{len(files)} files, {sum(path.stat().st_size for path in files) / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
