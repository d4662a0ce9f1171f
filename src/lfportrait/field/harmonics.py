"""The zeroth spherical harmonic: a colour that is the same from all sides is 0.5 + C0 times it."""

from __future__ import annotations

__all__ = ["C0"]

C0 = 0.28209479177387814
"""1 / (2 sqrt(pi))."""
