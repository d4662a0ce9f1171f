"""A line plot as a picture, for what changes over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["line_plot"]

_COLORS = ("#1f62b4", "#c85214", "#28824a", "#823c96")


def line_plot(curves: dict[str, tuple[Sequence[float], Sequence[float]]], *, across: str, up: str,
              title: str = "", size: tuple[int, int] = (960, 600)) -> NDArray[np.uint8]:
    """Draw curves over a common axis.

    Parameters
    ----------
    curves
        Name and points (x, y) of each curve.
    across, up
        What the axes show, with units.
    title
        Line above the plot.
    size
        Width and height in pixels.

    Returns
    -------
    picture
        uint8 [H, W, 3].
    """
    # Here: a third of a second, for one option of one command.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if not any(len(x) for x, _ in curves.values()):
        raise ValueError("a plot needs points")
    figure = Figure(figsize=(size[0] / 100, size[1] / 100), dpi=100, layout="constrained")
    canvas, axes = FigureCanvasAgg(figure), figure.add_subplot()
    for index, (name, curve) in enumerate(curves.items()):
        x, y = np.array(sorted(zip(*curve))).reshape(-1, 2).T
        axes.plot(x, y, color=_COLORS[index % len(_COLORS)], linewidth=2.5, label=name,
                  marker="o" if len(x) < 60 else None, clip_on=False)
    if axes.dataLim.x0 >= 0:
        axes.set_xlim(left=0)
    axes.set(xlabel=across, ylabel=up, title=title)
    axes.grid(color="#e2e2e6")
    axes.legend(loc="lower right", frameon=False)
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3]
