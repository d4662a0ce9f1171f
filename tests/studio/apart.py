"""A call in a process of its own."""

from collections.abc import Callable
from typing import Any

from lfportrait import runner


def apart(function: Callable[..., Any], *given: Any, **named: Any) -> Any:
    """What a function gives there."""
    child = runner.Child("tests.studio.apart:serve")
    try:
        child.send((function, given, named))
        while (heard := child.receive())[0] not in ("end", "failed"):
            pass
        assert heard[0] == "end", heard
        return heard[1]
    finally:
        child.close()


def serve() -> None:
    """Do what `apart` asks for."""
    runner.serve(lambda order, tell: order[0](*order[1], **order[2]))
