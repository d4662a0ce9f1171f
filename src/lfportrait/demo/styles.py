"""The names of the painted exemplars; what reads them is imported on demand."""

import functools
from collections.abc import Callable
from importlib import import_module
from typing import Any

_NAMES = ("fauve", "charcoal", "impression")


def demo_styles() -> list[str]:
    """Names of the painted exemplars, the first is the default."""
    return list(_NAMES)


def _read(name: str) -> Any:
    # Exemplars take a second to import, and nobody may ask for one.
    return import_module("lfportrait.demo").demo_exemplar(name)


def style_makers() -> dict[str, Callable[[], Any]]:
    """What reads each of the painted exemplars, by name (entry point ``lfportrait.styles``)."""
    return {name: functools.partial(_read, name) for name in _NAMES}
