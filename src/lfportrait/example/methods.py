"""The methods of transfer by name: ours, and those of other packages.

A package names a method under ``[project.entry-points."lfportrait.transfer_methods"]``. Behind the
name is a `PhotoMethod`. The fields of its parameters are options of the command line:
``--NAME.FIELD``. The published methods that ours is compared with come in this way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import UInt8
from ..plugins import Choice, Sitting, chosen, offered
from .exemplar import Exemplar
from .transfers import Transfer, TransferConfig, face_landmarks, fitting

GROUP = "lfportrait.transfer_methods"
"""Entry points of the methods of other packages."""
OWN = "styleblit"
"""The method of this stage."""

Method = Annotated[str, Choice(GROUP, OWN)]

MethodConfig = Any
"""Parameters of a method: a `TransferConfig`, or those of another package's method."""


@dataclass(frozen=True)
class PhotoMethod:
    """A method of another package."""

    # Class of its parameters, a frozen data class whose fields have defaults.
    parameters: type[Any]
    # Prepares an exemplar by its parameters, as `prepare` does; the last argument are photos with
    # landmarks that a network also trains on, or None.
    prepare: Callable[[Exemplar, Any, list[Sitting] | None], Any]


def photo_method(name: str) -> PhotoMethod:
    """A method of another package."""
    found: PhotoMethod = chosen(GROUP, name, (OWN,))
    return found


def prepare(exemplar: Exemplar, config: MethodConfig, own: list[Sitting] | None = None) -> Any:
    """An exemplar prepared for the method of a configuration, to be applied to many photos.

    ``apply(image, landmarks)`` gives a picture with ``image``, ``seconds`` and ``dump``. ``own``
    are photos with landmarks that a network also trains on.
    """
    if isinstance(config, TransferConfig):
        return Transfer(exemplar, config)
    for method in offered(GROUP).values():
        if isinstance(config, method.parameters):
            return method.prepare(exemplar, config, own)
    raise TypeError(f"no installed method of transfer has parameters like {config!r}")


def paint(image: UInt8, exemplar: Exemplar, config: MethodConfig,
          landmarks: NDArray[np.floating] | None = None) -> Any:
    """Stylise one photo by the method of ``config``.

    Parameters
    ----------
    image : uint8 [H, W, 3].
    exemplar : The painting.
    config : Of the method that is wanted.
    landmarks : [68, 2] in pixels; detected if None.

    Returns
    -------
    result : With ``image``, ``seconds`` and ``dump``: a `TransferResult`, or what the method
        gives.

    Raises
    ------
    UserError : If no face is found.
    """
    points = np.asarray(face_landmarks(image) if landmarks is None else landmarks, np.float64)
    if isinstance(config, TransferConfig):
        exemplar = fitting(exemplar, points, image, config.eyes, config.wear)
    return prepare(exemplar, config, own=[(image, points)]).apply(image, points)
