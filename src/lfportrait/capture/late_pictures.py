"""Pictures that are decoded on first access.

Many a command needs a capture's cameras and its landmarks alone; decoding a hundred photos takes
longer than a preview.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, TypeVar, overload

__all__ = ["LatePictures"]

Picture = TypeVar("Picture")


class LatePictures(Sequence[Picture]):
    """Pictures, uint8 [H, W, 3] or [H, W] each, made when one of them is first asked for.

    Or what belongs to pictures, as their depth does.

    Parameters
    ----------
    count
        How many there will be.
    decode
        Makes them, once.
    """

    def __init__(self, count: int, decode: Callable[[], Sequence[Picture]]) -> None:
        self._count, self._decode = count, decode
        self._made: Sequence[Picture] | None = None
        self._lock = threading.Lock()

    def _pictures(self) -> Sequence[Picture]:
        with self._lock:
            if self._made is None:
                self._made = self._decode()
            return self._made

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> Picture: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Picture]: ...

    def __getitem__(self, index: Any) -> Any:
        return self._pictures()[index]
