"""Composition of a portrait on a panel: where the head stands, how large it is and how deep.

The face, not the middle of the head, lies in the panel's plane, where it is sharpest; the rest is
behind it. The head is as large as its crown and the end of its bust allow: that ends below the
picture's lower edge, and the eyes stay in its middle third. If the panel can't show the head's
depth sharply, as far as it is seen from the front, the head is flattened.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from ..field import VoxelField, head_points
from .budget import DepthReport
from .display import Display
from .placement import EncodeConfig

__all__ = ["composed"]

# In the portrait frame the eyes lie at y = 0 and z = 0.4 (`lfportrait.capture.frame`), the tip of
# the nose at z = 0.6; from the front a head is seen back to its widest place, at z = 0.
_FACE, _NOSE, _OUTLINE = 0.4, 0.6, 0.0
_EYES = 0.2
"""Half the distance of the eyes' outer corners, rounded up."""
_TOP = 0.86
"""Place of the crown in half panel heights, where all else allows it."""
_LOW = -1.06
"""The bust ends here or below, in half panel heights: just beneath the lower edge."""
_HIGHEST = 0.24
"""Eyes are at most so high or low, in half panel heights: well within the middle third."""
_SIZES = 0.6, 1.2
"""Half panel heights per world unit, at least and at most."""
_WIDE = 0.86
"""Share of a panel's width that a head's own may take up: hair and outer views need the rest."""
_FLATTEST = 0.5
"""Of its depth a head keeps so much at least: a flatter one looks like a relief."""


def composed(field: VoxelField, display: Display, config: EncodeConfig) -> EncodeConfig:
    """The placement that a composition comes to, as a configuration without one.

    Size, shifts, focus and depth scale of the configuration change what is composed: a size of 0.8
    (the default) leaves it, one of 0.4 halves it, a focus of 0.1 moves it towards the viewer.

    Parameters
    ----------
    field
        In the portrait frame.
    display
        The panel.
    config
        Parameters; without ``compose`` they come back as they are.

    Returns
    -------
    config
        For all that takes one. A warning says where the panel can't keep the head sharp.
    """
    if not config.compose:
        return config
    points = head_points(field) if field.backdrop is None else field.backdrop.points
    low, high = (float(v) for v in np.quantile(points[:, 1], [0.002, 0.998]))
    upper = points[points[:, 1] > -_EYES]
    wide = float(np.quantile(np.abs(upper[:, 0]), 0.99)) if len(upper) else 0.5
    scale, up = _stand(display, low, high, wide)
    scale *= config.size / EncodeConfig.size
    depth = _kept_depth(display, scale)
    usual = EncodeConfig()
    # What `Placement.of` does to heads on narrow panels is taken into account already.
    size = scale / min(1.0, 1.15 * display.aspect)
    return replace(config, compose=False, size=size, shift_y=up + config.shift_y - usual.shift_y,
                   focus=config.focus - _FACE * scale * depth * config.depth_scale,
                   depth_scale=depth * config.depth_scale)


def _stand(display: Display, low: float, high: float, wide: float) -> tuple[float, float]:
    """Scale and shift upwards of a head from ``low`` to ``high`` and so wide to each side."""
    # The bust ends behind the panel's plane, where things are a little smaller.
    nearer = display.distance / (display.distance + 0.5)
    scale = (_TOP - _LOW) / max(high - nearer * low, 0.5)
    scale = float(np.clip(scale, *_SIZES))
    scale = min(scale, _WIDE * display.aspect / max(wide, 0.3),
                0.3 * display.aspect / _EYES)
    # Above all the bust's end is hidden; then the crown has its distance from the upper edge.
    up = min(_TOP - scale * high, _LOW - nearer * scale * low)
    return scale, float(np.clip(up, -_HIGHEST, _HIGHEST))


def _kept_depth(display: Display, scale: float) -> float:
    """How much of its depth a head of a scale keeps so that it is sharp as far as it is seen."""
    plain = DepthReport.of(display)
    wanted = min(plain.front / ((_NOSE - _FACE) * scale),
                 -plain.back / ((_FACE - _OUTLINE) * scale), 1.0)
    if wanted < _FLATTEST:
        warnings.warn(
            f"{display.name} shows {plain.length(plain.back)} behind its plane sharply, the "
            f"composed head is {(_FACE - _OUTLINE) * scale * _FLATTEST / -plain.back:.1f} times as "
            "deep to its outline: ears and hair blur a little (a smaller --size helps)",
            stacklevel=4)
    return float(max(wanted, _FLATTEST))
