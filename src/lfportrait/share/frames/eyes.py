"""Pictures for two eyes: side-by-side pairs, anaglyphs, and a picture with its depth beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...color import linear_light
from ...field import Rendering, VoxelField
from ...lightfield import Display, EncodeConfig, Ground, Placement, ground_of, view_camera
from .config import FrameConfig

__all__ = ["TwoEyes", "anaglyph_of", "window_ground"]

_PIXELS = (1536, 2048)
_OUTERMOST = 1e-3
"""Share of a surface's pixels that are left out at the near and at the far end of its depth."""
_CYAN = np.array([[-0.0434706, -0.0879388, -0.00155529], [0.378476, 0.73364, -0.0184503],
                  [-0.0721527, -0.112961, 1.2264]])
_RED = np.array([[0.4561, 0.500484, 0.176381], [-0.0400822, -0.0378246, -0.0157589],
                 [-0.0152161, -0.0205971, -0.00546856]])
"""What each eye's picture gives to red, green and blue (rows), for red and cyan glasses: Dubois's
least-squares projection (2001), in linear light. White stays white."""


@dataclass(frozen=True)
class TwoEyes:
    """A window, and two eyes before it.

    Attributes
    ----------
    window
        The picture's frame: its pixels and the distance of the eyes.
    baseline
        Distance between the eyes in half heights of the window.
    """

    window: Display
    baseline: float

    @staticmethod
    def of(config: FrameConfig) -> TwoEyes:
        """The window and the eyes that the parameters ask for."""
        panel = Display.resolve(config.display) if config.display else None
        distance, millimetres = (panel.distance, panel.panel_height * 500) if panel else (4.0, 0.0)
        pixels = (config.pixels if config.pixels[0]
                  else (panel.width, panel.height) if panel else _PIXELS)
        # Where the screen's size is unknown, only the angle between the eyes is right.
        unit = millimetres or config.view_distance / distance
        return TwoEyes(Display(*pixels, views=1, pitch=3.0, distance=distance),
                       config.eye_distance / unit)

    def look(self, field: VoxelField, encode: EncodeConfig, eye: float,
             ground: Ground | None = None) -> Rendering:
        """What an eye at ``eye``, from -1 (left) to 1 (right), sees in the window.

        Where it sees the ground, the depth is the ground's.
        """
        camera = view_camera(self.window, encode, eye * self.baseline / 2,
                             width=self.window.width, height=self.window.height)
        if ground is None:
            return field.render(camera, 0, background=encode.background)
        shot = field.render(camera, 0, background=ground.seen(camera))
        # The window's axis is upright on the ground: all of it is equally far.
        place = ground.placement
        plane = (place.deep_distance(self.window) + ground.depth / place.depth) / place.scale
        return replace(shot, depth=np.minimum(shot.depth, np.float32(plane)))

    def parallax(self, shot: Rendering, encode: EncodeConfig) -> list[float]:
        """How far apart the eyes see the farthest and the nearest point, in % of the width.

        Positive: in front of the window. Zero both where nothing is seen.
        """
        depth = shot.depth[np.isfinite(shot.depth)]
        if not depth.size:
            return [0.0, 0.0]
        placement = Placement.of(self.window, encode)
        plane = placement.deep_distance(self.window) / placement.scale
        ends = np.quantile(depth, [1 - _OUTERMOST, _OUTERMOST])
        shift = self.baseline * (plane / ends - 1) / (2 * self.window.aspect)
        return [round(100 * float(value), 2) for value in shift]

    def both(self, field: VoxelField, encode: EncodeConfig,
             ) -> tuple[NDArray[np.uint8], NDArray[np.uint8], list[float]]:
        """The left and the right picture, uint8 [H, W, 3], and their `parallax`."""
        ground = window_ground(field, self.window, encode)
        left, right = (self.look(field, encode, eye, ground) for eye in (-1.0, 1.0))
        return _bytes(left.color), _bytes(right.color), self.parallax(left, encode)

    def with_depth(self, field: VoxelField, encode: EncodeConfig,
                   ) -> tuple[NDArray[np.uint8], dict[str, Any]]:
        """A picture, and its depth right of it: white is near; uint8 [H, 2 W, 3].

        The nearest point is 255, the farthest 1, where there is nothing 0. ``covered`` of the
        figures is the share of the picture where there is something.
        """
        shot = self.look(field, encode, 0.0, window_ground(field, self.window, encode))
        seen = np.isfinite(shot.depth)
        depth = np.zeros(shot.depth.shape, np.uint8)
        if seen.any():
            near, far = np.quantile(shot.depth[seen], [_OUTERMOST, 1 - _OUTERMOST])
            share = (far - shot.depth[seen]) / max(far - near, 1e-6)
            depth[seen] = 1.5 + 254 * np.clip(share, 0, 1)
        return np.hstack([_bytes(shot.color), np.repeat(depth[..., None], 3, axis=2)]), {
            "covered": round(float(seen.mean()), 4)}


def window_ground(field: VoxelField, window: Display, encode: EncodeConfig) -> Ground | None:
    """The ground behind a head in a window, as sharp as it is: there are no lenses to blur it."""
    return ground_of(field, window, replace(encode, ground_blur=0.0))


def _bytes(color: NDArray[np.float32]) -> NDArray[np.uint8]:
    return (np.clip(color, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def anaglyph_of(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Two pictures as one for glasses with a red left and a cyan right side: uint8 [H, W, 3]."""
    light = linear_light(np.arange(256) / 255.0).astype(np.float32)
    mixed = light[left] @ _RED.T.astype(np.float32) + light[right] @ _CYAN.T.astype(np.float32)
    # The inverse of the curve: the nearest of the 256 values, by a table of the light.
    table = np.searchsorted((light[1:] + light[:-1]) / 2, np.linspace(0, 1, 65536)).astype(np.uint8)
    return np.asarray(table[(np.clip(mixed, 0, 1) * 65535 + 0.5).astype(np.uint16)])
