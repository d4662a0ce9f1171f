"""One small head, its skin, and an exemplar prepared for it."""

import numpy as np
import pytest

from lfportrait.example.skin.painting import SkinPainter
from lfportrait.example.skin.sitter import Skin
from tests.fields import head_field
from tests.portraits import HEAD_LANDMARKS, drawn_face

PIXELS = 80.0


@pytest.fixture(scope="session")
def field():
    return head_field()


@pytest.fixture(scope="session")
def skin(field):
    return Skin.of(field, HEAD_LANDMARKS, pixels=PIXELS, networks=False)


@pytest.fixture(scope="session")
def points(skin):
    """Surface points of the skin's lists, [N, 3]."""
    return skin.atlas.points.reshape(-1, 3)[skin.index].astype(np.float64)


@pytest.fixture(scope="session")
def painter():
    return SkinPainter(drawn_face(160, 120))


@pytest.fixture(scope="session")
def painting(painter, skin):
    return painter.paint(skin)
