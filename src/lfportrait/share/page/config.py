"""What can be chosen about a page."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["PageConfig"]


@dataclass(frozen=True)
class PageConfig:
    """Parameters of a page (`write_page`)."""

    title: str = ""
    """Title of the portrait, in its caption; by default Portrait."""
    artist: str = ""
    """Who painted the exemplar, or what the painting is called."""
    date: str = ""
    """Date, in the caption as it is written here."""
    sh: int = 0
    """Degree of the spherical harmonics that are kept of a photographed field, 0 to 2.
    Degrees above 0 keep how colours change with the direction; the file grows 4 or 9 times."""
    max_size: float = 6.0
    """Largest size of the file in MB (of 1,000,000 bytes). Colours and densities are rounded
    as little as this allows, and where that does not do, the lattice is made coarser."""
