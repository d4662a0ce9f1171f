"""What a mix of colours is asked for: options as they are typed, and as they are carried out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import tyro

from ...errors import UserError
from ...example import RegionStyle

__all__ = ["MOST", "MixConfig", "RegionValue", "known", "number", "plain", "read_value"]

RegionValue = float | str | tuple[str, float]
"""What a region gets: a strength, a style, or a style and a strength; text is read as typed."""

MOST = 4.0
"""The largest strength of a region: colours four times as far from the photo as the painting's."""

_Words = tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]]
"""Words of an option that may be given several times, and several words at a time."""


@dataclass(frozen=True)
class MixConfig:
    """What of the photo and what of the painting a stylised field shows."""

    strength: float = 1.0
    """0 leaves the photo's colours, 1 gives the painting's."""
    identity: float = 0.0
    """Share of the photo's own light and shade in the painting, with the painting's tones and
    colours: 0 (none) to 1."""
    region: _Words = ()
    """A region with its own strength or style: NAME=NUMBER multiplies its strength (0 keeps the
    photo, above 1 exaggerates, 4 at most), NAME=STYLE or NAME=STYLE:NUMBER paints it in another
    style of the file, e.g. hair=2 lips=0.5; where regions overlap, the later one counts."""
    style: str = ""
    """Style of all other regions; by default the first in the file."""
    keep_colors: bool = False
    """Keep the photo's colours: the painting gives light and shade alone."""
    keep: _Words = ()
    """Regions that stay as in the photo, e.g. eyes lips."""

    def arguments(self) -> dict[str, Any]:
        """The same as arguments of `StyledField.mix`.

        Raises
        ------
        UserError
            If a region is not of the form NAME=VALUE.
        """
        regions: dict[str, RegionValue] = {}
        for text in (text for words in self.region for text in words):
            name, sign, value = text.partition("=")
            if not sign:
                raise UserError(f"can't read the region {text!r}: write NAME=NUMBER, NAME=STYLE or "
                                "NAME=STYLE:NUMBER, for example hair=0.5")
            # Taken out first: the last word on a region comes after those on the others.
            regions.pop(name, None)
            regions[name] = value
        return {"strength": self.strength, "identity": self.identity, "regions": regions,
                "keep_colors": self.keep_colors, "style": self.style or None,
                "keep": tuple(name for words in self.keep for name in words)}


def number(value: Any, what: str, most: float) -> float:
    """A number from 0 to ``most``.

    Raises
    ------
    UserError
        If it is none, naming ``what`` it was meant for.
    """
    try:
        found = float(value)
    except (TypeError, ValueError):
        found = math.nan
    if not 0.0 <= found <= most:
        raise UserError(f"{what} must be a number from 0 to {most:g}, not {value!r}")
    return found


def known(name: Any, kind: str, names: Sequence[str]) -> str:
    """The name, which must be one of those that a field has.

    Raises
    ------
    UserError
        If it is not, with the names that there are; ``kind`` is "region" or "style".
    """
    if name not in names:
        raise UserError(f"there is no {kind} {name!r} in this field; it has "
                        f"{', '.join(names) or 'none'}")
    return str(name)


def read_value(region: str, value: RegionValue, styles: Sequence[str]) -> RegionStyle:
    """What a region gets.

    Parameters
    ----------
    region
        Its name.
    value
        A strength, a style, or both; text: ``NUMBER``, ``off``, ``STYLE`` or ``STYLE:NUMBER``. A
        style whose name is a number is meant by ``STYLE:NUMBER`` alone.
    styles
        Styles that there are.

    Returns
    -------
    region_style
        Without a style of its own, that of the whole field is meant.

    Raises
    ------
    UserError
        If the value is none of these, the style unknown, or the strength out of range.
    """
    what = f"the strength of {region}"
    if isinstance(value, str):
        if value == "off":
            return RegionStyle(region, "", 0.0)
        if _is_number(value):
            return RegionStyle(region, "", number(value, what, MOST))
        name, _, rest = value.rpartition(":")
        # A style's name may hold a colon.
        if value in styles or not _is_number(rest) or not name:
            return RegionStyle(region, known(value, "style", styles), 1.0)
        return RegionStyle(region, known(name, "style", styles), number(rest, what, MOST))
    if isinstance(value, Iterable):
        both = tuple(value)
        if len(both) != 2:
            raise UserError(f"{region} takes a strength, a style, or a style and a strength, "
                            f"not {value!r}")
        return RegionStyle(region, known(both[0], "style", styles), number(both[1], what, MOST))
    return RegionStyle(region, "", number(value, what, MOST))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def plain(choices: Mapping[str, RegionStyle]) -> dict[str, Any]:
    """Choices as `StyledField.mix` takes them and a JSON file holds them."""
    return {name: [choice.style, choice.strength] if choice.style else choice.strength
            for name, choice in choices.items()}
