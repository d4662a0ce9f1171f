"""A first look at the chosen painting on the head, while the head is being made."""

from __future__ import annotations

import time
from dataclasses import replace

from ...field import VoxelField
from ...job import FirstLook
from ..orders import Order
from ..projects import Project
from .pictures import head_picture
from .telling import Teller

_EVERY = 1.0
"""Seconds after which it is looked again whether a painting was chosen."""


class EarlyPicture(FirstLook):
    """The first look as the picture of the stage to come, until that has one of its own.

    And as a page that turns.

    A painting is often chosen while the head is being made: the look waits for that.

    Parameters
    ----------
    order
        Of the head.
    teller
        Sends the picture.
    """

    STAGE = "surface"

    def __init__(self, order: Order, teller: Teller) -> None:
        # A picture shows no ground.
        super().__init__("", replace(order.config().stylize, ground=False), time.perf_counter())
        self._project, self._teller = Project(order.folder), teller
        self._asked = -_EVERY

    def wanted(self) -> bool:
        """Whether a painting is chosen."""
        now = time.perf_counter()
        if now - self._asked < _EVERY:
            return False
        self._asked = now
        self.exemplar = str(self._project.settings().get("painting") or "")
        return bool(self.exemplar)

    def show(self, portrait: VoxelField) -> str:
        """Draw it; there is no line to be said."""
        self._teller.picture(self.STAGE, head_picture(portrait))
        self._teller.page(self.STAGE, portrait)
        return ""
