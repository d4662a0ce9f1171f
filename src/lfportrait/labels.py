"""Names of a portrait's parts: one set of labels, one syntax for ``--region``.

Every part has one name wherever it is met: in a picture, on a head's surface, in a styled field's
file and on the command line. Not every method can separate all parts, so there are coarser sets;
each is a grouping of the one set:

- `PICTURE_LABELS`: the soft labels that guide the synthesis (`lfportrait.example.guides`);
- `SURFACE_LABELS`: those of a head's surface, which has no background;
- `MATERIALS`: what a painter needs to keep apart (`lfportrait.example.skin`);
- `SEGMENTS`: what the segmentation network sees (`lfportrait.face`).
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from .errors import UserError

FEATURES = ("brows", "eyes", "nose", "lips")  # Features of a face.
LABELS = (*FEATURES, "skin", "ears", "hair", "neck", "clothes", "background")
"""All parts; together they are everything."""
GROUPS = {"features": FEATURES, "body": ("neck", "clothes")}  # Names for several parts.
PICTURE_LABELS = (*FEATURES, "skin", "hair", "body", "background")  # Ears belong to the skin here.
SURFACE_LABELS = LABELS[:-1]
MATERIALS = ("skin", "hair", "neck", "clothes", "background", "features", "ears")
BY_HAND = ("auto", "hair", "hat", "neck", "skin", "background")
"""Values, 0 to 5, of a picture of regions that were painted over by hand (``NAME.regions.png``
beside a painting); 0 leaves a place to the networks."""
SEGMENTS = ("background", "hair", "body-skin", "face-skin", "clothes", "others")
"""In the order of the network's channels."""

RegionValue = float | str | tuple[str, float]
"""What a region gets: a strength, a style, or a style and a strength; text is read as typed."""
MOST = 4.0
"""The largest strength of a region: colors four times as far from the photo as the painting's."""


def members(name: str, known: Sequence[str]) -> tuple[str, ...]:
    """The labels among ``known`` that a label or a group of them means."""
    if name in known:
        return (name,)
    found = GROUPS.get(name, ())
    if found and all(one in known for one in found):
        return found
    groups = [group for group, parts in GROUPS.items()
              if group not in known and all(part in known for part in parts)]
    raise UserError(f"there is no region {name!r} here; there are "
                    f"{', '.join([*known, *groups]) or 'none'}")


@dataclass(frozen=True)
class RegionStyle:
    """Style and strength of one region."""

    region: str  # A label or a group of labels.
    style: str  # Another exemplar or style, or "" for that of the whole.
    strength: float  # 0 leaves the photo, 1 gives the painting, more exaggerates.


def read_regions(words: Iterable[Iterable[str]]) -> dict[str, str]:
    """Values by the names of regions, from words ``REGION=VALUE``; the last on a region counts."""
    found: dict[str, str] = {}
    for text in (text for part in words for text in part):
        region, sign, value = text.partition("=")
        if not sign:
            raise UserError(f"can't read the region {text!r}: write REGION=NUMBER, REGION=STYLE, "
                            "REGION=STYLE:NUMBER or REGION=off, for example hair=0.5")
        # Taken out first: the last word on a region comes after those on the others.
        found.pop(region, None)
        found[region] = value
    return found


def read_value(region: str, value: RegionValue, styles: Sequence[str] | None = None) -> RegionStyle:
    """Parse a region's value: a strength, a style, or both.

    Without a style that of the whole is meant. Text is ``NUMBER``, ``off``, ``STYLE`` or
    ``STYLE:NUMBER``; a style whose name is a number is meant by the last alone. ``styles`` are
    those that there are; None where any name may be one, as a picture's path is.
    """
    what = f"the strength of {region}"
    if isinstance(value, str):
        if value == "off":
            return RegionStyle(region, "", 0.0)
        if _is_number(value):
            return RegionStyle(region, "", number(value, what, MOST))
        name, _, rest = value.rpartition(":")
        # A style's name may hold a colon.
        if value in (styles or ()) or not _is_number(rest) or not name:
            return RegionStyle(region, _style(value, styles), 1.0)
        return RegionStyle(region, _style(name, styles), number(rest, what, MOST))
    if isinstance(value, Iterable):
        both = tuple(value)
        if len(both) != 2:
            raise UserError(f"{region} takes a strength, a style, or a style and a strength, "
                            f"not {value!r}")
        return RegionStyle(region, _style(both[0], styles), number(both[1], what, MOST))
    return RegionStyle(region, "", number(value, what, MOST))


def _style(name: Any, styles: Sequence[str] | None) -> str:
    return str(name) if styles is None else one_of(name, "style", styles)


def one_of(name: Any, kind: str, names: Sequence[str]) -> str:
    """The name, which must be one of those that a field has; ``kind`` says what it names."""
    if name not in names:
        raise UserError(f"there is no {kind} {name!r} in this field; it has "
                        f"{', '.join(names) or 'none'}")
    return str(name)


def number(value: Any, what: str, most: float) -> float:
    """A number from 0 to ``most``; `UserError` if it is none, naming ``what`` it was meant for."""
    try:
        found = float(value)
    except (TypeError, ValueError):
        found = math.nan
    if not 0.0 <= found <= most:
        raise UserError(f"{what} must be a number from 0 to {most:g}, not {value!r}")
    return found


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
