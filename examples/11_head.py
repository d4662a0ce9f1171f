"""A head from one photo: a single picture becomes a head that turns, and is painted.

Key concepts: `head_from_photos`, which gives a field and the capture that it was made of; both go
into `stylize` as those of many photos do. It needs the networks that find faces (`lfportrait models
fetch portrait`). Writes one.npz, painted.npz, and head.png: the photo, the head turned to both
sides, and painted.

Run: python examples/11_head.py
"""

from pathlib import Path

import numpy as np

import lfportrait as lf


def main(out: Path = Path("example-out"), resolution: int = 0, size: int = 384,
         painting: lf.StylizeConfig | None = None) -> None:
    # A file will do: lf.head_from_photos("me.jpg"), or several, of any days. This one is the
    # frontal photo of the head that the package brings, which is cut out; it is small, and a face
    # must be 150 pixels wide.
    whole = lf.demo_capture()
    front = int(np.argmin(np.abs(whole.cameras.position[:, :2]).sum(axis=1)))
    photo = np.dstack([whole.images[front], whole.alphas[front]])
    photo = photo.repeat(2, axis=0).repeat(2, axis=1)
    field, capture = lf.head_from_photos(photo, lf.ReconstructConfig(resolution=resolution))
    styled = lf.stylize(field, capture, lf.Exemplar.load("fauve"), painting)
    out.mkdir(parents=True, exist_ok=True)
    field.save(out / "one.npz")
    styled.save(out / "painted.npz")

    # Over 40 degrees in all it is good: 18 cameras of an orbit stand 20 degrees apart.
    cameras = lf.orbit_cameras(18, size, field)
    sides = [source.render(cameras, view).color for source, view in (
        (field, 17), (field, 1), (styled, 17), (styled, 0), (styled, 1))]
    rows = np.int64((np.arange(size) + 0.5) * len(photo) / size)
    seen = np.float32(photo[np.ix_(rows, rows)]) / 255
    lf.write_image(out / "head.png", np.concatenate(
        [seen[..., :3] * seen[..., 3:] + 1 - seen[..., 3:], *sides], axis=1))


if __name__ == "__main__":
    main()
