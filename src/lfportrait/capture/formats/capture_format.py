"""What a format of captures is: each is a class above `CaptureFormat`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar

from ...errors import UserError
from .assembly import DataSet, Views, read_shots

__all__ = ["CaptureFormat"]


class CaptureFormat(ABC):
    """A format in which programs write photos with their cameras.

    Attributes
    ----------
    name
        The program or format, for people; one among all formats.
    files
        What it is recognised by, such as ``transforms.json``; for people.
    """

    name: ClassVar[str]
    files: ClassVar[str]

    @abstractmethod
    def recognises(self, path: Path) -> bool:
        """Whether a folder or file is of this format; it may as well not be there."""

    @abstractmethod
    def read(self, path: Path, holdout: int) -> DataSet:
        """The shots of a data set; no picture is decoded.

        Parameters
        ----------
        path
            A folder or file that is recognised.
        holdout
            Every ``holdout``-th picture becomes a test view where the format's custom says which;
            0 holds out none.

        Raises
        ------
        UserError
            If it is damaged.
        """

    def load(self, path: Path, holdout: int) -> Views:
        """The views of a data set, with their pictures."""
        return read_shots(self.read(path, holdout), holdout)

    def write(self, capture: Views, path: Path) -> None:
        """Write a capture; it appears under its name when it is whole.

        Raises
        ------
        UserError
            If this format is only read, or ``path`` can't be written.
        """
        raise UserError(f"captures are not written as {self.name}")

    @property
    def writes(self) -> bool:
        """Whether captures can be written so, too."""
        return type(self).write is not CaptureFormat.write

    def check(self) -> None:
        """Complain of a class that can't be used; those of other packages are looked at."""
        for name in ("name", "files"):
            if not isinstance(getattr(self, name, None), str):
                raise TypeError(f"it has no {name}")
