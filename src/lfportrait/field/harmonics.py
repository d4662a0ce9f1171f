"""The zeroth spherical harmonic: a view-independent color is 0.5 + C0 times its coefficient."""

from __future__ import annotations

__all__ = ["C0"]

C0 = 0.28209479177387814
"""1 / (2 sqrt(pi))."""
