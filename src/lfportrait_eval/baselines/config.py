"""What the parameters of all published methods have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lfportrait.errors import UserError

__all__ = ["BaselineConfig"]


@dataclass(frozen=True)
class BaselineConfig:
    """A published method: something is optimised for a number of steps.

    Only what changes how long a method takes, or where its pictures come from, is a parameter; its
    weights and rates are constants beside its code, each with its source.
    """

    usual_steps: ClassVar[int] = 0
    """Steps where none are given."""
    steps: int | None = None
    """Steps of the optimisation: of whole views for ARF (by default 300) and Ref-NPR (180), of the
    decoder before the first fit for StylizedNeRF (120), alternations on each level for FaceStyle
    (4), training steps instead of seconds, which can be repeated, for the network."""

    @property
    def length(self) -> int:
        """Steps that are taken."""
        return self.usual_steps if self.steps is None else self.steps

    def check(self) -> None:
        """Raise `UserError` where parameters are out of range."""
        if self.length < 0:
            raise UserError(f"a method's steps must not be negative, but are {self.length}")
