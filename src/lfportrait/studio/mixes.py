"""Mixes of photo and paintings as the page sends them, checked, and as the work takes them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..labels import GROUPS, MOST, SURFACE_LABELS
from .answers import Refusal, number, text, truth

__all__ = ["checked_mix", "mix_arguments", "styles_of"]

_REGIONS = (*SURFACE_LABELS, *GROUPS)
_KNOWN = ("strength", "identity", "regions", "keep_colors", "keep")


def checked_mix(mix: Any) -> dict[str, Any]:
    """A mix without what is as usual.

    Raises
    ------
    Refusal
        If it is none.
    """
    if mix is None:
        return {}
    if not isinstance(mix, dict) or not set(mix) <= {*_KNOWN}:
        raise Refusal("bad_request", f"a mix has {', '.join(_KNOWN)} and nothing else", field="mix")
    found: dict[str, Any] = {}
    for name, usual in (("strength", 1.0), ("identity", 0.0)):
        value = number(mix, name, 0.0, 1.0, usual)
        if value != usual:
            found[name] = value
    regions = mix.get("regions") or {}
    if not isinstance(regions, dict):
        raise Refusal("bad_request", "regions must be an object", field="regions")
    chosen = {_region(name): _value(value) for name, value in regions.items()}
    if chosen := {name: value for name, value in chosen.items() if value != 1.0}:
        found["regions"] = chosen
    if truth(mix, "keep_colors"):
        found["keep_colors"] = True
    keep = mix.get("keep") or []
    if not isinstance(keep, list):
        raise Refusal("bad_request", "keep must be a list of regions", field="keep")
    if keep:
        found["keep"] = sorted({_region(name) for name in keep})
    return found


def _region(name: Any) -> str:
    if name not in _REGIONS:
        raise Refusal("bad_request", f"a region is one of {', '.join(_REGIONS)}", field="regions")
    return str(name)


def _value(value: Any) -> Any:
    if isinstance(value, dict):
        return {"style": text(value, "style"), "strength": number(value, "strength", 0, MOST, 1.0)}
    return number({"regions": value}, "regions", 0.0, MOST)


def styles_of(mix: dict[str, Any]) -> list[str]:
    """Ids of the styles that regions of a mix have of their own."""
    return sorted({value["style"] for value in mix.get("regions", {}).values()
                   if isinstance(value, dict)})


def mix_arguments(mix: dict[str, Any], style: str, name_of: Callable[[str], str],
                  ) -> tuple[dict[str, Any], dict[str, str]]:
    """Arguments of `lfportrait.stylize.StyledField.mix`, and the paintings of regions.

    Parameters
    ----------
    mix
        As `checked_mix` gives it.
    style
        Id of the style of everything else.
    name_of
        Of a style's id: what the commands call ``--style``.

    Returns
    -------
    arguments, styles
        The styles by the names that the arguments use.
    """
    others = {one: name_of(one) for one in styles_of(mix) if one != style}
    found = dict(mix)
    if "regions" in mix:
        found["regions"] = {
            name: ((value["style"], value["strength"]) if value["style"] in others
                   else value["strength"]) if isinstance(value, dict) else value
            for name, value in mix["regions"].items()}
    return found, others
