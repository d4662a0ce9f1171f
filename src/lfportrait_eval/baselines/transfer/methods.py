"""The published methods of transfer, as the entry points name them."""

from __future__ import annotations

from lfportrait.example import Exemplar, PhotoMethod, Sitting

from ..config import FaceBlitConfig, FaceStyleConfig, NetworkConfig
from .faceblit import FaceBlit
from .facestyle import FaceStyle
from .network import StyleNetwork


def _faceblit(exemplar: Exemplar, config: FaceBlitConfig, own: list[Sitting] | None) -> FaceBlit:
    return FaceBlit(exemplar, config)


def _facestyle(exemplar: Exemplar, config: FaceStyleConfig, own: list[Sitting] | None) -> FaceStyle:
    return FaceStyle(exemplar, config)


FACEBLIT = PhotoMethod(FaceBlitConfig, _faceblit)
FACESTYLE = PhotoMethod(FaceStyleConfig, _facestyle)
NETWORK = PhotoMethod(NetworkConfig, StyleNetwork)
