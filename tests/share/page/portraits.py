"""Fields for tests of the page."""

import numpy as np

from lfportrait.example import LABELS
from lfportrait.stylize import StyledField
from tests.fields import head_field

C0 = 0.28209479177387814


def painted_head(size=48):
    """A head with a photo's and two paintings' colours, of which one name is a trap for HTML."""
    real = head_field(size)
    random = np.random.default_rng(3)
    photo = np.clip(C0 * real.sh[:, :, 0] + 0.5, 0, 1)
    points = real.lattice_points()
    waves = 0.5 + 0.45 * np.sin(points @ random.normal(size=(3, 3)) * 9)
    ink = np.repeat((photo.mean(1, keepdims=True) > 0.5) * 0.8 + 0.1, 3, 1)
    painted = np.stack([waves, ink + random.normal(0, 0.02, photo.shape)])
    labels = np.zeros((len(photo), len(LABELS)), np.uint8)
    return StyledField.of(real, painted, ("waves", "ink & <b>wash"), photo, labels)


def pure_head(size=40):
    """A head that is red from the left and blue from the right, and green above its middle.

    So a coded picture tells each sub-pixel's place, its colour and the side that its view sees.
    """
    field = head_field(size)
    points = field.lattice_points()
    sh = np.zeros((len(points), 3, 9), np.float32)
    sh[:, 0, 3], sh[:, 2, 3] = -60, 60  # the harmonic is -0.49 x
    sh[:, 1, 0] = np.where(points[:, 1] > 0, 0.5, -0.5) / C0
    # No soft edges: every ray is stopped by the head, or meets nothing.
    return type(field)(field.links, field.density * 40, sh)
