"""The losses one by one: what each term of the paper makes of the same head.

Key concepts: `sample_weights` (a view is a fixed sparse matrix times the field's colors, so any
loss of pictures trains a field), `load_network`, `nearest_neighbour_loss` (Eq. 4 and 5),
`laplacian_loss` (Eq. 7), `content_loss`; Eq. 9 is their sum. Writes losses.png: the photographed
field, then its colors after descents by style alone, with content, and with all three.

Run: python examples/01_portrait.py && python examples/10_losses.py
"""

from pathlib import Path

import numpy as np
import torch

import lfportrait as lf


def main(out: Path = Path("example-out"), size: int = 256, steps: int = 40) -> None:
    field = lf.VoxelField.load(out / "field.npz")
    cameras = lf.orbit_cameras(12, size, field)
    view = field.sample_weights(cameras, 0)
    places = np.stack([np.repeat(np.arange(size * size), np.diff(view.indptr)), view.rows])
    matrix = torch.sparse_coo_tensor(torch.from_numpy(places), torch.from_numpy(view.weights),
                                     (size * size, len(field.density)), check_invariants=True)

    def picture(colors: torch.Tensor) -> torch.Tensor:
        """The view [3, H, W] on white, of colors [N, 3]."""
        light = matrix @ colors + (1 - torch.from_numpy(view.alpha))[:, None]
        return light.T.reshape(3, size, size)

    # "vgg16" and "resnet50" are the paper's (`lfportrait models fetch paper`); this one is small.
    network = lf.load_network("embedded")

    def features(image: torch.Tensor) -> torch.Tensor:
        return torch.cat(network(image[None]), dim=1)[0]  # [C, h, w]

    exemplar = lf.Exemplar.load("fauve").image
    painting = torch.from_numpy(exemplar[::4, ::4] / np.float32(255)).permute(2, 0, 1)
    photo = torch.from_numpy(np.clip(field.sh[:, :, 0] * 0.2820948 + 0.5, 0, 1))
    with torch.no_grad():
        seen = picture(photo)
        wanted, style = features(seen), features(painting).flatten(1).T
    losses = {
        "style": lambda image: 3 * lf.nearest_neighbour_loss(features(image).flatten(1).T, style),
        "content": lambda image: 0.3 * lf.content_loss(features(image), wanted),
        "contours": lambda image: 30 * lf.laplacian_loss(image, seen, pool=2)}

    shown = [seen]
    for count in (1, 2, 3):
        colors = photo.clone().requires_grad_()
        descent = torch.optim.Adam([colors], lr=0.02)
        for _ in range(steps):
            descent.zero_grad()
            image = picture(colors)
            sum(loss(image) for loss in [*losses.values()][:count]).backward()
            descent.step()
        with torch.no_grad():
            shown.append(picture(colors.clamp(0, 1)))
            print({name: round(float(loss(shown[-1])), 4) for name, loss in losses.items()})
    lf.write_image(out / "losses.png", torch.cat(shown, dim=2).permute(1, 2, 0).numpy())


if __name__ == "__main__":
    main()
