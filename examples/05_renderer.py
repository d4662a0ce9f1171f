"""A field of one's own: any renderer that can picture a scene for a camera, coded for a panel.

Key concepts: `Renderer` (one method, `render`), `Rendering`, `Camera.rays`, `encode_views`. The
scene is a snowman of three spheres, met by its rays in closed form; splats, a neural field or a
mesh would do as well. Writes renderer.png: the coded picture, and what two eyes see of it.

Run: python examples/05_renderer.py
"""

from pathlib import Path

import numpy as np

import lfportrait as lf

MIDDLES = np.array([[0.0, 0.55, 0.0], [0.0, -0.45, 0.0], [0.0, 0.5, 0.36]])
RADII = np.array([0.42, 0.68, 0.1])
COLORS = np.array([[0.93, 0.95, 1.0], [0.86, 0.9, 0.98], [0.95, 0.45, 0.1]])
LIGHT = np.array([0.5, 0.7, 0.5]) / np.sqrt(0.99)


class Snowman:
    """What `lf.encode_views` needs: a method that renders one view of a batch of cameras."""

    def render(self, cameras: lf.Camera, view: int = 0, *, background: float = 1.0,
               ) -> lf.Rendering:
        shape = int(cameras.height[view]), int(cameras.width[view])
        # float64 [H W, 3] each, in the world: +y up, +z out of the face.
        origins, directions = cameras.rays(view)
        color = np.full((len(origins), 3), background, np.float32)
        depth = np.full(len(origins), np.inf, np.float32)
        for middle, radius, own in zip(MIDDLES, RADII, COLORS):
            # |origin + t direction - middle| = radius, the smaller t
            along = ((middle - origins) * directions).sum(axis=1)
            inside = radius ** 2 - ((middle - origins) ** 2).sum(axis=1) + along ** 2
            distance = along - np.sqrt(np.maximum(inside, 0))
            hit = (inside > 0) & (distance < depth)
            normal = (origins + distance[:, None] * directions - middle)[hit] / radius
            shade = 0.35 + 0.65 * np.maximum(normal @ LIGHT, 0)
            color[hit] = own * shade[:, None]
            depth[hit] = distance[hit]
        return lf.Rendering(color.reshape(*shape, 3), np.float32(np.isfinite(depth)).reshape(shape),
                            depth.reshape(shape))


def main(out: Path = Path("example-out"), width: int = 800, height: int = 600) -> None:
    display = lf.Display(width, height, views=32, pitch=9.4, slant=0.17, cone=50.0, name="mine")
    scene: lf.Renderer = Snowman()
    coded = lf.encode_views(scene, display, lf.EncodeConfig(background=0.15))
    eyes = display.eyes()
    seen = [lf.simulate(coded, display, (float(eye),)) for eye in (eyes[0], eyes[-1])]
    lf.write_image(out / "renderer.png", np.concatenate([coded / np.float32(255), *seen], axis=1))


if __name__ == "__main__":
    main()
