"""The methods of transfer by name: ours, and the paper's rivals for Fig. 6 and for quality."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .exemplar import Exemplar
from .providers import Sitting
from .rivals.faceblit import FaceBlit, FaceBlitConfig
from .rivals.facestyle import FaceStyle, FaceStyleConfig
from .rivals.network import NetworkConfig, StyleNetwork
from .rivals.painted import Painted
from .transfers import Transfer, TransferConfig, TransferResult, face_landmarks
from .turned import suited

__all__ = ["METHODS", "Method", "MethodConfig", "paint", "prepare"]

Method = Literal["styleblit", "faceblit", "facestyle", "network"]
METHODS: tuple[Method, ...] = ("styleblit", "faceblit", "facestyle", "network")

MethodConfig = TransferConfig | FaceBlitConfig | FaceStyleConfig | NetworkConfig


def prepare(exemplar: Exemplar, config: MethodConfig, own: list[Sitting] | None = None) -> Any:
    """An exemplar prepared for one method, to be applied to many photos.

    Parameters
    ----------
    exemplar
        The painting.
    config
        Of the method that is wanted.
    own
        Photos with landmarks that a network also trains on.

    Returns
    -------
    prepared
        Its ``apply(image, landmarks)`` gives a picture with ``image``, ``seconds`` and ``dump``.
    """
    if isinstance(config, FaceBlitConfig):
        return FaceBlit(exemplar, config)
    if isinstance(config, FaceStyleConfig):
        return FaceStyle(exemplar, config)
    if isinstance(config, NetworkConfig):
        return StyleNetwork(exemplar, config, own)
    return Transfer(exemplar, config)


def paint(image: NDArray[np.uint8], exemplar: Exemplar, config: MethodConfig,
          landmarks: NDArray[np.floating] | None = None) -> TransferResult | Painted:
    """Stylise one photo by the method of ``config``.

    Parameters
    ----------
    image
        uint8 [H, W, 3].
    exemplar
        The painting.
    config
        Of the method that is wanted.
    landmarks
        [68, 2] in pixels; detected if None.

    Raises
    ------
    UserError
        If no face is found.
    """
    points = np.asarray(face_landmarks(image) if landmarks is None else landmarks, np.float64)
    if isinstance(config, TransferConfig):
        exemplar = suited(exemplar, points)
    prepared = prepare(exemplar, config, own=[(image, points)])
    result: TransferResult | Painted = prepared.apply(image, points)
    return result
