"""Published methods that stylise a field, to compare with: ARF, StylizedNeRF, Ref-NPR.

All work on the same field, whose density is frozen, and are shown the same photos of the capture.
Each module says what it does otherwise than its original.
"""

from ..config import ArfConfig, RefNprConfig, StylizedNerfConfig

__all__ = ["ArfConfig", "RefNprConfig", "StylizedNerfConfig"]
