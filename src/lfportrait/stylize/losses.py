"""The losses between pictures, on features and on contours (Shen et al. 2023, Eq. 4, 5, 7)."""

from __future__ import annotations

import torch
from torch.nn import functional

__all__ = ["content_loss", "laplacian", "laplacian_loss", "nearest_neighbour_loss", "stacked",
           "total_variation"]


def stacked(maps: list[torch.Tensor]) -> torch.Tensor:
    """Feature maps of several strides as one [C, h, w] at the finest of them."""
    size = maps[0].shape[-2:]
    return torch.cat([values if values.shape[-2:] == size else functional.interpolate(
        values, size=size, mode="bilinear", align_corners=False) for values in maps], dim=1)[0]


def content_loss(features: torch.Tensor, wanted: torch.Tensor,
                 inside: torch.Tensor | None = None) -> torch.Tensor:
    """Mean squared difference of two feature maps.

    Parameters
    ----------
    features, wanted
        [C, h, w], of the render and of the content picture.
    inside
        bool [h, w], the places that count; by default all.
    """
    squared = (features - wanted).square().mean(dim=0)
    return squared.mean() if inside is None else squared[inside].mean()


def nearest_neighbour_loss(features: torch.Tensor, style: torch.Tensor, *,
                           chunk: int = 2048, half: bool = False) -> torch.Tensor:
    """Mean cosine distance of each feature to its nearest neighbour in the style (Eq. 4, 5).

    The distance is 1 - v1.v2 / (|v1| |v2|); Eq. 5 prints the 1 inside the numerator. The search
    itself has no gradient.

    Parameters
    ----------
    features
        [N, C], features of the render.
    style
        [M, C], features of the style.
    chunk
        Rows of ``features`` compared at once.
    half
        Search in bfloat16: of two neighbours that are equally near to three digits, either.

    Returns
    -------
    loss
        Scalar in [0, 2]; 0 for a picture compared with itself.
    """
    unit = functional.normalize(features, dim=1, eps=1e-6)
    style_unit = functional.normalize(style, dim=1, eps=1e-6)
    with torch.no_grad():
        numbers = torch.bfloat16 if half else unit.dtype
        asked, known = unit.to(numbers), style_unit.to(numbers).T
        nearest = torch.cat([(part @ known).argmax(dim=1) for part in asked.split(chunk)])
    return (1.0 - (unit * style_unit[nearest]).sum(dim=1)).mean()


def laplacian(image: torch.Tensor, pool: int = 1) -> torch.Tensor:
    """The picture [3, H, W] convolved with the 3x3 Laplacian, after average pooling by ``pool``."""
    x = image[:, None]
    if pool > 1:
        x = functional.avg_pool2d(x, pool)
    kernel = torch.tensor([[0.0, 1.0, 0.0], [1.0, -4.0, 1.0], [0.0, 1.0, 0.0]])[None, None]
    return functional.conv2d(functional.pad(x, (1, 1, 1, 1), mode="replicate"),
                             kernel.to(image))[:, 0]


def laplacian_loss(image: torch.Tensor, wanted: torch.Tensor, *, pool: int = 1,
                   reduction: str = "mean") -> torch.Tensor:
    """Squared difference of two pictures' Laplacians (Eq. 7 of 2.2; a sum in the paper).

    Parameters
    ----------
    image, wanted
        [3, H, W] in [0, 1].
    pool
        Average pooling before the Laplacian: 1 sees single strokes, 4 to 16 the contours.
    reduction
        ``"mean"`` or ``"sum"``.
    """
    squared = (laplacian(image, pool) - laplacian(wanted, pool)).square()
    return squared.sum() if reduction == "sum" else squared.mean()


def total_variation(image: torch.Tensor) -> torch.Tensor:
    """Half the mean squared difference of neighbours across plus that down, [1, 3, H, W] (ARF)."""
    across, down = image.diff(dim=-1), image.diff(dim=-2)
    return 0.5 * (across.square().mean() + down.square().mean())
