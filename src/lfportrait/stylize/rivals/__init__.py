"""Rivals that stylise a field, for comparison: ARF, StylizedNeRF, Ref-NPR.

All work on the same field, whose density is frozen, and are shown the same photos of the capture.
Each module says what it does otherwise than its original.
"""

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .config import ArfConfig, RefNprConfig, StylizedNerfConfig
    from .methods import stylize_as_rival
    from .photo_views import RivalTask

__all__ = ["ArfConfig", "RefNprConfig", "RivalTask", "StylizedNerfConfig", "stylize_as_rival"]

__getattr__, __dir__ = attach(__name__, __file__)
