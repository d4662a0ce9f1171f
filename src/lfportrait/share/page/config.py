"""Parameters of a page."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PageConfig:
    """Parameters of a page (`write_page`)."""

    title: str = ""
    """Title of the portrait, in its caption; by default Portrait."""
    artist: str = ""
    """Artist, or title of the painting, in the caption."""
    date: str = ""
    """Date, in the caption, as given."""
    sh: int = 0
    """Degree of the spherical harmonics kept in the page, for a photographed field, 0 to 2. Degrees
    above 0 keep view-dependent colors; the file is 4 or 9 times larger."""
    max_size: float = 6.0
    """Largest size of the file in MB (of 1,000,000 bytes). Colors and densities are quantised as
    finely as this allows; if that is not enough, the lattice is made coarser."""
    cone: float = 0.0
    """Degrees in all over which the portrait turns; 0: all around, but 40 for a head that was made
    from one photo, which a button on the page unlocks; 360: all around."""
