"""A first look at the chosen painting on the head, as a picture, while the head is being made."""

from __future__ import annotations

import time
from dataclasses import replace

from ...field import VoxelField
from ...job import FirstLook
from ..orders import Order
from .pictures import head_picture
from .telling import Teller

__all__ = ["EarlyPicture"]


class EarlyPicture(FirstLook):
    """The first look as the picture of the stage to come, until that has one of its own.

    Parameters
    ----------
    order
        Of the head; without a painting there is no look.
    teller
        Sends the picture.
    """

    STAGE = "surface"

    def __init__(self, order: Order, teller: Teller) -> None:
        # A picture shows no ground.
        painting = replace(order.config().stylize, ground=False)
        super().__init__(order.style, painting, time.perf_counter())
        self.over = not order.style
        self._teller = teller

    def show(self, portrait: VoxelField) -> str:
        """Draw it; there is no line to be said."""
        self._teller.picture(self.STAGE, head_picture(portrait))
        return ""
