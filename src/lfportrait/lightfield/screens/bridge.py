"""Casting to a running Looking Glass Bridge, by the local HTTP interface of its version 2.2 on.

Every call is a PUT of a JSON object to ``http://localhost:33334/NAME``. Calls belong to an
"orchestration", a session whose token the first call gives; pictures are shown by playlists of
entries, which name files on the machine that Bridge runs on. Bridge answers a method or a name that
it does not know with an empty body and success, so that every answer is looked at here.
"""

from __future__ import annotations

import http.client
import json
import urllib.error
import urllib.parse
import urllib.request
import uuid
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...errors import UserError
from ..display import Display
from ..quilts import QuiltLayout

URL = "http://localhost:33334"
"""Where Bridge listens."""


@dataclass(frozen=True)
class Device:
    """A screen that Bridge reports."""

    index: int  # Bridge's number of it (its "head").
    name: str  # What its maker calls it, or its serial number.
    hardware: str  # Kind of the panel; ``"thirdparty"`` for an ordinary monitor.
    calibration: dict[str, Any]  # Contents of its ``visual.json``; empty for an ordinary monitor.

    @property
    def looking_glass(self) -> bool:
        """Whether it is a light-field display."""
        return self.hardware != "thirdparty" and bool(self.calibration)

    def display(self) -> Display:
        """The panel, calibrated."""
        return Display.from_looking_glass(self.calibration)


@dataclass(frozen=True)
class DepthPicture:
    """How a picture with depth beside it is to be read."""

    side: int = 2  # Bridge's number, 0 to 3, of the side on which the depth lies.
    strength: float = 1.0  # How deep the result is, from 0 to 3.
    inverted: bool = False  # Whether dark is near.


@dataclass(frozen=True)
class Entry:
    """A picture of a playlist."""

    # A picture or a video, by its path on the machine that Bridge runs on, or an address.
    picture: str | Path
    # The quilt's layout; for a picture with depth, that of the quilt that Bridge makes of it.
    layout: QuiltLayout
    views: int = 0  # Number of views; all tiles by default.
    focus: float = 0.0  # Bridge's focus: shift between the views, from -1 to 1.
    depth: DepthPicture | None = None  # Where a picture with depth has it.
    seconds: float = 20.0  # How long it is shown, where the playlist has several.

    def arguments(self, index: int) -> dict[str, Any]:
        """What Bridge gets of it, as entry ``index`` of a playlist."""
        layout, depth = self.layout, self.depth
        entry: dict[str, Any] = {
            "id": index, "index": index, "uri": str(self.picture), "rows": layout.rows,
            "cols": layout.columns, "aspect": layout.aspect,
            "view_count": self.views or layout.count, "focus": self.focus, "crop_pos_x": 0,
            "crop_pos_y": 0, "zoom": 1, "isRGBD": int(depth is not None),
            "durationMS": round(1000 * self.seconds), "tag": ""}
        if depth is not None:
            entry |= {"depth_loc": depth.side, "depthiness": depth.strength,
                     "depth_inversion": int(depth.inverted), "chroma_depth": 0}
        return entry


def _value(entry: Any, *path: str) -> Any:
    """Follow ``path`` through Bridge's answers, where every entry is ``{"value": ...}``."""
    for name in path:
        if isinstance(entry, dict) and "value" in entry and name not in entry:
            entry = entry["value"]
        entry = entry.get(name) if isinstance(entry, dict) else None
    return entry.get("value") if isinstance(entry, dict) else entry


class Bridge:
    """A session with Bridge, which listens at ``url``; use it in a ``with`` block.

    It waits ``timeout`` seconds for an answer.
    """

    def __init__(self, url: str = URL, timeout: float = 10.0) -> None:
        self.url, self.timeout = url.rstrip("/"), timeout
        if urllib.parse.urlsplit(self.url).scheme not in ("http", "https"):
            raise UserError(f"Bridge's address must begin with http://, not {url!r}")
        self.token = ""
        token = _value(self.call("enter_orchestration", name="default"), "payload")
        if not isinstance(token, str) or not token:  # older versions know no sessions
            raise UserError(f"Looking Glass Bridge at {self.url} opened no session; it must be "
                            "version 2.2 or newer")
        self.token = token

    def __enter__(self) -> Bridge:
        return self

    def __exit__(self, *_: object) -> None:
        # What was cast goes on playing; only the session is left.
        self.token = ""

    def call(self, endpoint: str, **arguments: Any) -> dict[str, Any]:
        """One call of an endpoint; Bridge's answer. The session is added to the arguments."""
        if self.token:
            arguments = {"orchestration": self.token, **arguments}
        request = urllib.request.Request(
            f"{self.url}/{endpoint}", json.dumps(arguments).encode(),
            {"Content-Type": "application/json"}, method="PUT")
        # A proxy of the surroundings has no business between here and this machine.
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        try:
            with opener.open(request, timeout=self.timeout) as response:
                body = response.read()
        except urllib.error.HTTPError as error:
            raise UserError(f"Looking Glass Bridge refused {endpoint}: {error.code} "
                            f"{error.reason}") from error
        except (OSError, http.client.HTTPException, ValueError) as error:
            reason = getattr(error, "reason", error)
            raise UserError(f"no Looking Glass Bridge answers at {self.url} ({reason}): start it "
                            "on the machine that the display is plugged into, or show the coded "
                            "picture without it with `lfportrait show`") from error
        try:
            answer = json.loads(body)
        except ValueError as error:
            raise UserError(f"what answers at {self.url} is no Looking Glass Bridge of version 2.2 "
                            f"or newer: {endpoint} gave "
                            f"{'nothing' if not body else 'no JSON'}") from error
        status = _value(answer, "status")
        if status not in ("Completion", "Pending"):
            message = _value(answer, "payload", "message")
            raise UserError(f"Looking Glass Bridge failed at {endpoint}: "
                            f"{status or 'an answer without a status'}"
                            f"{f' ({message})' if message else ''}")
        return answer

    def version(self) -> str:
        """Bridge's version."""
        return str(_value(self.call("bridge_version"), "payload"))

    def devices(self) -> list[Device]:
        """All screens that Bridge reports, including ordinary monitors."""
        entries = _value(self.call("available_output_devices"), "payload")
        devices = []
        for key, entry in (entries if isinstance(entries, dict) else {}).items():
            calibration = _value(entry, "calibration")
            try:
                parsed = json.loads(calibration) if calibration else {}
            except (TypeError, ValueError):
                parsed = {}
            index = _value(entry, "index")
            devices.append(Device(
                int(index if index is not None else key),
                str(_value(entry, "hwid") or parsed.get("serial", "") or "screen"),
                str(_value(entry, "hardwareVersion") or "thirdparty"),
                parsed if isinstance(parsed, dict) else {}))
        return devices

    def device(self, index: int = -1) -> Device:
        """The light-field display to cast to.

        Bridge's number ``index``, by default the first one.
        """
        devices = self.devices()
        if index >= 0:
            for device in devices:
                if device.index == index:
                    return device
            known = ", ".join(f"{device.index} ({device.name})" for device in devices)
            raise UserError(f"Looking Glass Bridge has no screen {index}, only {known or 'none'}")
        for device in devices:
            if device.looking_glass:
                return device
        raise UserError(f"Looking Glass Bridge runs, but reports no Looking Glass display (of "
                        f"{len(devices)} screens): check its cables, and start Bridge again")

    def cast(self, picture: str | Path, layout: QuiltLayout, *, views: int = 0, screen: int = -1,
             focus: float = 0.0, depth: DepthPicture | None = None) -> str:
        """Show one quilt, or a picture with depth (`Entry`), until something else is cast.

        ``screen`` is Bridge's number of the display, -1 = where Bridge wants. Returns the name of
        the playlist that plays it.
        """
        return self.cast_all([Entry(picture, layout, views, focus, depth)], screen=screen)

    def cast_all(self, entries: Sequence[Entry], *, screen: int = -1) -> str:
        """`cast` of pictures one after the other, again and again, until something else is cast."""
        # A name that Bridge knows already would go on with what it shows: each cast has its own.
        name = f"lfportrait-{uuid.uuid4().hex[:8]}"
        self.call("show_window", show_window=True, head_index=screen)
        self.call("instance_playlist", name=name, loop=True)
        for index, entry in enumerate(entries):
            self.call("insert_playlist_entry", name=name, **entry.arguments(index))
        self.call("play_playlist", name=name, head_index=screen)
        return name

    def pause(self) -> None:
        """Pause playback."""
        self.call("transport_control_pause")

    def hide(self, screen: int = -1) -> None:
        """Stop playback and hide Bridge's window."""
        self.pause()
        self.call("show_window", show_window=False, head_index=screen)
