"""Fields for tests of the page."""

import numpy as np
from scipy import ndimage

from lfportrait.capture import Camera
from lfportrait.field import SurfaceTexture
from lfportrait.labels import PICTURE_LABELS as LABELS
from lfportrait.stylize import StyledField
from tests.fields import head_field

C0 = 0.28209479177387814


def painted_head(size=48, strokes=False):
    """A head with a photo's and two paintings' colors, of which one name is a trap for HTML.

    With ``strokes`` the paintings have a texture that the lattice is too coarse for.
    """
    real = head_field(size)
    random = np.random.default_rng(3)
    photo = np.clip(C0 * real.sh[:, :, 0] + 0.5, 0, 1)
    points = real.lattice_points()
    waves = 0.5 + 0.45 * np.sin(points @ random.normal(size=(3, 3)) * 9)
    ink = np.repeat((photo.mean(1, keepdims=True) > 0.5) * 0.8 + 0.1, 3, 1)
    painted = np.stack([waves, ink + random.normal(0, 0.02, photo.shape)])
    labels = np.zeros((len(photo), len(LABELS)), np.uint8)
    names = ("waves", "ink & <b>wash")
    if not strokes:
        return StyledField.of(real, painted, names, photo, labels)
    places = [stroke_texture(real, seed) for seed in range(2)]
    height, width = places[0].texels.shape[:2]
    # A texel's share in a mix is its row's; here that is the same for all rows.
    rows = np.zeros((-(-height // 4), -(-width // 4)), np.int32)
    return StyledField.of(real, painted, names, photo, labels, textures=places, texel_rows=rows)


def stroke_texture(field, seed, pixels=90.0, side=200):
    """Strokes four times as fine as the lattice, in four charts about a head, in a row."""
    random = np.random.default_rng(seed)
    turns = np.array([0.0, 90.0, 180.0, 270.0])
    cameras = Camera.arc(turns, distance=14.0, width=side, height=side, focal=14.0 * pixels)
    maps = np.empty((4, 3, 4))
    for n in range(4):
        lens = np.array([[14 * pixels, 0, (n + 0.5) * side], [0, 14 * pixels, side / 2], [0, 0, 1]])
        turn = cameras.pose[n, :3, :3].T
        maps[n] = lens @ np.concatenate([turn, -turn @ cameras.pose[n, :3, 3:]], axis=1)
    noise = ndimage.gaussian_filter(random.normal(size=(side, 4 * side, 3)), (0.8, 2.5, 0))
    texels = np.clip(50 * noise / noise.std(), -127, 127).astype(np.int8)
    # Each row in the chart whose camera it faces most, and a few in none.
    x, _, z = field.lattice_points().T
    charts = np.stack([z, x, -z, -x]).argmax(axis=0).astype(np.uint8)
    charts[field.lattice_points()[:, 1] < -0.85] = 255
    return SurfaceTexture(texels, maps, charts, pixels)


def pure_head(size=40):
    """A head that is red from the left and blue from the right, and green above its middle.

    So a coded picture tells each sub-pixel's place, its color and the side that its view sees.
    """
    field = head_field(size)
    points = field.lattice_points()
    sh = np.zeros((len(points), 3, 9), np.float32)
    sh[:, 0, 3], sh[:, 2, 3] = -60, 60  # the harmonic is -0.49 x
    sh[:, 1, 0] = np.where(points[:, 1] > 0, 0.5, -0.5) / C0
    # No soft edges: every ray is stopped by the head, or meets nothing.
    return type(field)(field.links, np.maximum(field.density, 0) * 40, sh)
