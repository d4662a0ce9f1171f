"""Methods of other packages that color a field: their interface and discovery.

A package names a method under ``[project.entry-points."lfportrait.field_methods"]``. Behind the
name is a `FieldMethod`. The fields of its parameters are options of the command line:
``--NAME.FIELD``. The published methods that ours are compared with come in this way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import field as option
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..example import TransferConfig
from ..plugins import chosen

if TYPE_CHECKING:
    from ..capture import Capture
    from ..example import Exemplar
    from ..field import VoxelField
    from ..progress import Progress

__all__ = ["GROUP", "OWN", "FieldMethod", "FieldTask", "field_method"]

GROUP = "lfportrait.field_methods"
"""Entry points of the methods of other packages."""
OWN = ("skin", "paper")
"""Methods of this stage."""


@dataclass(frozen=True)
class FieldTask:
    """Inputs of another package's method.

    Attributes
    ----------
    field
        The real field; its density stays as it is.
    capture
        Its capture.
    exemplar
        The painting.
    background
        Grey level behind the head.
    seed
        Seed of the order of the views and of all other choices.
    progress
        Progress line.
    dump
        Folder for pictures of intermediates; None writes none.
    transfer
        How a view is painted by example, where a method starts from one.
    device
        Where networks compute, a choice of ``--device``; a method that has some calls
        `lfportrait.device.torch_device` with it, and puts that device's name
        (`lfportrait.device.device_name`) into its figures as ``device``.
    """

    field: VoxelField
    capture: Capture
    exemplar: Exemplar
    background: float = 1.0
    seed: int = 0
    progress: Progress | None = None
    dump: Path | None = None
    transfer: TransferConfig = option(default_factory=TransferConfig)
    device: str = "auto"

    def tell(self, note: str, steps: int = 0) -> None:
        """Count ``steps`` finished steps on the progress line and show ``note``."""
        if self.progress is not None:
            self.progress.step(note, steps)

    def random(self, stream: int) -> np.random.Generator:
        """A random generator of its own for each ``stream``."""
        return np.random.Generator(np.random.Philox(key=[self.seed, stream]))


@dataclass(frozen=True)
class FieldMethod:
    """A method of another package.

    Attributes
    ----------
    parameters
        Class of its parameters, a frozen data class whose fields have defaults.
    paint
        Gives the colors of the field's rows, float32 [N, 3], and figures with ``seconds``. Its
        module, and all that this imports, is part of a result's key.
    needs_face
        Whether it asks for the capture's landmarks.
    networks
        Networks of the registry (`lfportrait.models`) that it can't do without.
    """

    parameters: type[Any]
    paint: Callable[[FieldTask, Any], tuple[NDArray[np.float32], dict[str, Any]]]
    needs_face: bool = True
    networks: tuple[str, ...] = ()


def field_method(name: str) -> FieldMethod:
    """A method of another package.

    Raises
    ------
    UserError
        If no installed package has it.
    """
    found: FieldMethod = chosen(GROUP, name, OWN)
    return found
