"""The painted exemplars: portraits of a modelled man in three manners."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import UserError
from ..example import Exemplar
from .shipped import DATA, resized
from .styles import demo_styles

__all__ = ["demo_exemplar"]


def demo_exemplar(name: str = "", width: int = 768, height: int = 1024) -> Exemplar:
    """A painted portrait with its 68 landmarks.

    Parameters
    ----------
    name
        One of `lfportrait.demo.demo_styles`; empty = the first.
    width, height
        Size of the picture in pixels; it was painted 768 x 1024.

    Returns
    -------
    exemplar
        Picture, landmarks (projected from the model) and the mask of the person.

    Raises
    ------
    UserError
        If there is no such style.
    """
    names = demo_styles()
    name = name or names[0]
    if name not in names:
        raise UserError(f"no built-in style {name!r}; there are: {', '.join(names)}")
    painted = Exemplar.load(DATA / "paintings" / f"{name}.jpg")
    assert painted.mask is not None
    rows, columns = painted.image.shape[:2]
    return replace(painted, image=resized(painted.image, width, height),
                   landmarks=painted.landmarks * (width / columns, height / rows),
                   mask=np.clip(resized(painted.mask, width, height), 0, 1))
