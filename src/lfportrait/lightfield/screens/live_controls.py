"""What pointer and keys change of a light field that is shown live; knows no window and no GPU."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ..placement import EncodeConfig

__all__ = ["HELP", "Controls"]

HELP = """drag, left, right  turn the head        wheel, + -  focus: towards the viewer, away
[ ]                less, more depth     , .         smaller, larger
m, down, up        painting and photo   space       pause, go on with the sway
r                  as it was            h           this help         Esc, q  close"""

_ACROSS = 120.0
"""Degrees that a drag over all of the window turns the head."""
_SWAY, _PERIOD = 8.0, 10.0
"""Degrees to each side, and seconds of a sway to both."""
_LONGEST = 0.25
"""Seconds that the sway moves on by at most: after a slow picture it would jump."""
_TURN, _FOCUS, _FACTOR, _SHARE = 5.0, 0.02, 1.06, 0.1
"""What one key press changes: degrees, half panel heights, factor of depth and size, share."""
_FADE = 1.0
"""Seconds from the painting to the photo and back."""
_REACH = 0.4
"""How far the focus moves a head, over the distance of the eyes, at most; half a panel height."""


def _between(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


class Controls:
    """Turn, focus, depth, size and mixture, as the viewer has set them.

    Parameters
    ----------
    distance
        Of the eyes, in half panel heights.
    mixable
        Whether there is a photo's field to mix in.
    sway
        Whether the head sways until the viewer pauses it.

    Attributes
    ----------
    share
        Share of the photo, 0 to 1.
    closed, help
        Whether the viewer closed the window; whether the help is to be seen.
    """

    def __init__(self, distance: float = 4.0, mixable: bool = False, sway: bool = True) -> None:
        self._reach, self._mixable, self.swaying = min(0.5, _REACH * distance), mixable, sway
        self.closed = self.help = False
        self._dragged: float | None = None
        self._reset()

    def _reset(self) -> None:
        self.turn, self.focus, self.depth, self.size = 0.0, 0.0, 1.0, 1.0
        self.share = self._fades_to = 0.0
        self._phase = 0.0

    def handle(self, event: Mapping[str, Any], width: float) -> None:
        """Take up an event.

        Parameters
        ----------
        event
            As rendercanvas gives it: ``"event_type"`` and what belongs to that.
        width
            Of the window, in the unit of the event's ``"x"``.
        """
        kind = event["event_type"]
        if kind == "pointer_down" and event.get("button") == 1:
            self._dragged = float(event["x"])
        elif kind == "pointer_up" and event.get("button") == 1:
            self._dragged = None
        elif kind == "pointer_move" and self._dragged is not None:
            moved = float(event["x"]) - self._dragged
            self._dragged = float(event["x"])
            self._turn(_ACROSS * moved / max(width, 1.0))
        elif kind == "wheel":
            self._focus(-float(event["dy"]) / 100.0)
        elif kind == "close":
            self.closed = True
        elif kind == "key_down":
            self._special(str(event["key"]))
        elif kind == "char":
            # What the key means on the viewer's keyboard, repeated while it is held.
            self._typed(str(event["data"]))

    @property
    def still(self) -> bool:
        """Whether nothing changes while the viewer does nothing."""
        return self.share == self._fades_to and (not self.swaying or self._dragged is not None)

    def advance(self, seconds: float) -> None:
        """Let time pass: the sway, and the way from the painting to the photo."""
        if self.swaying and self._dragged is None:
            self._phase = (self._phase + min(seconds, _LONGEST) / _PERIOD) % 1.0
        step = seconds / _FADE
        self.share += _between(self._fades_to - self.share, -step, step)

    def applied(self, config: EncodeConfig) -> EncodeConfig:
        """A configuration with what the viewer has set."""
        sway = _SWAY * math.sin(2 * math.pi * self._phase)
        turn = (config.turn + self.turn + sway + 180.0) % 360.0 - 180.0
        return replace(config, turn=turn, focus=config.focus + self.focus,
                       depth_scale=_between(config.depth_scale * self.depth, 0.05, 4.0),
                       size=_between(config.size * self.size, 0.05, 4.0))

    def summary(self) -> str:
        """The settings in one line."""
        parts = [f"turn {self.turn:+.0f} degrees", f"focus {self.focus:+.2f}",
                 f"depth {self.depth:.2f}", f"size {self.size:.2f}"]
        if self._mixable:
            parts.append(f"photo {100 * self.share:.0f} %")
        return ", ".join(parts + ([] if self.swaying else ["paused"]))

    # -- single changes ---------------------------------------------------------------------------

    def _special(self, key: str) -> None:
        if key == "Escape":
            self.closed = True
        elif key in ("ArrowLeft", "ArrowRight"):
            self._turn(_TURN if key == "ArrowRight" else -_TURN)
        elif key in ("ArrowUp", "ArrowDown"):
            self._mix(self._fades_to + (_SHARE if key == "ArrowUp" else -_SHARE))

    def _typed(self, text: str) -> None:
        if text in "+=-_":
            self._focus(1.0 if text in "+=" else -1.0)
        elif text in "[]":
            self.depth = _between(self.depth * _FACTOR ** (1 if text == "]" else -1), 0.2, 4.0)
        elif text in ",.":
            self.size = _between(self.size * _FACTOR ** (1 if text == "." else -1), 0.2, 4.0)
        elif text == " ":
            self.swaying = not self.swaying
        elif text.lower() == "m":
            self._mix(0.0 if self._fades_to > 0.5 else 1.0)
        elif text.lower() == "r":
            self._reset()
        elif text.lower() == "h":
            self.help = not self.help
        elif text.lower() == "q":
            self.closed = True

    def _turn(self, degrees: float) -> None:
        self.turn = (self.turn + degrees + 180.0) % 360.0 - 180.0

    def _focus(self, steps: float) -> None:
        self.focus = _between(self.focus + _FOCUS * steps, -self._reach, self._reach)

    def _mix(self, share: float) -> None:
        if self._mixable:
            self._fades_to = _between(share, 0.0, 1.0)
