"""Panels: presets, display files and the calibration that Looking Glass Bridge reports.

The wizard asks what is seen of a test pattern and turns the answers into pitch, slant and offset:
`lfportrait.lightfield.patterns` says what each fault looks like.
"""

import math
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from ..errors import UserError
from ..files import write_bytes
from ..lightfield import Display
from .answers import Refusal, choice, folder_name, free_place, id_of, number, truth, whole
from .projects import Project, Projects

KINDS = ("views", "slant", "fringe", "depth")  # Test patterns.
_LARGEST = 256 << 10
_COUNTS = 8  # Counts of bands that are kept.
_ALIKE = 0.2  # Numbers that differ by less, in bands, are the same.


@dataclass(frozen=True)
class Panel:
    """A display that can be chosen."""

    # id, kind: ``preset`` or ``file``.
    id: str
    kind: str
    display: Display  # Its parameters.
    path: Path | None = None  # Its file; None for a preset.

    @property
    def source(self) -> str:
        """What the commands call ``--display``."""
        return self.id if self.path is None else str(self.path)

    def entry(self) -> dict[str, Any]:
        """As the page sees it."""
        panel = self.display
        return {"id": self.id, "kind": self.kind, "name": panel.name,
                "summary": f"{panel.width} x {panel.height}, {panel.views} views, cone "
                f"{panel.cone:g} degrees" + (f"; {panel.note}" if panel.note else ""),
                "width": panel.width, "height": panel.height, "views": panel.views,
                "pitch": panel.pitch, "slant": panel.slant, "offset": panel.offset,
                "cone": panel.cone, "distance": panel.distance, "calibrated": panel.calibrated,
                "inverted": panel.inverted, "subpixels": panel.subpixels,
                "editable": self.path is not None, "hash": panel.hash()}


class Displays:
    """The panels of a studio."""

    def __init__(self, projects: Projects) -> None:
        self.folder = projects.folder / "displays"

    def all(self) -> list[Panel]:
        """Presets and the user's own; a file that is damaged is left out."""
        found = [Panel(name, "preset", Display.preset(name)) for name in Display.names()]
        for path in sorted(self.folder.glob("*.toml")):
            try:
                found.append(Panel(f"own-{id_of(path.stem)}", "file", Display.load(path), path))
            except UserError:
                continue
        return found

    def get(self, name: str) -> Panel:
        """A panel by its id."""
        if name in Display.names():
            return Panel(name, "preset", Display.preset(name))
        found = next((panel for panel in self.all() if panel.id == name), None)
        if found is None:
            raise Refusal("not_found", "there is no such display any more")
        return found

    def of(self, project: Project) -> Panel:
        """The panel that a project is made for; the usual one where it is gone."""
        try:
            return self.get(project.display)
        except Refusal:
            return self.get("generic-4k")

    def add(self, name: str, display: Display) -> Panel:
        """A new file."""
        target = free_place(self.folder, f"{folder_name(name)}.toml")
        display = replace(display, name=target.stem)
        display.save(target)
        return Panel(f"own-{id_of(target.stem)}", "file", display, target)

    def copy(self, source: Panel, name: str) -> Panel:
        """A copy that can be changed; one that is there already and was not changed serves."""
        there = (panel for panel in self.all() if panel.path is not None
                 and replace(panel.display, name=source.display.name) == source.display
                 and panel.display.name.startswith(folder_name(name)))
        return next(there, None) or self.add(name, source.display)

    def read(self, name: str, contents: str) -> Panel:
        """A new panel from the text of ``visual.json`` or of a display file."""
        if len(contents) > _LARGEST:
            raise Refusal("too_large", "a display's file is small; choose visual.json or a TOML "
                          "file")
        self.folder.mkdir(parents=True, exist_ok=True)
        ending = ".json" if contents.lstrip().startswith("{") else ".toml"
        probe = self.folder / f".probe{ending}"
        try:
            write_bytes(probe, contents.encode())
            display = Display.load(probe)
        except UserError as error:
            raise Refusal("user_error", str(error).replace(str(probe), "the file")) from error
        finally:
            probe.unlink(missing_ok=True)
        return self.add(name or display.name, display)

    def change(self, panel: Panel, data: dict[str, Any]) -> Panel:
        """A panel with other numbers, written."""
        file_of(panel)
        found: dict[str, Any] = {}
        for field, low, high in (("pitch", 1, 2e5), ("slant", -1.55, 1.55), ("offset", -1e6, 1e6),
                                 ("cone", 1e-3, 170), ("distance", 0.1, 1e4)):
            if field in data:
                found[field] = number(data, field, low, high)
        if "views" in data:
            found["views"] = whole(data, "views", 1, 1024)
        if "inverted" in data:
            found["inverted"] = truth(data, "inverted")
        if "subpixels" in data:
            found["subpixels"] = choice(data, "subpixels", ("RGB", "BGR"))
        return self.write(panel, replace(panel.display, **found))

    def write(self, panel: Panel, display: Display) -> Panel:
        """A panel with other parameters, written."""
        display.save(file_of(panel))
        return replace(panel, display=display)

    def remove(self, panel: Panel) -> None:
        """Delete a panel's file."""
        file_of(panel).unlink(missing_ok=True)


def file_of(panel: Panel) -> Path:
    """The file of a panel; a preset, which can't be changed, has none."""
    if panel.path is None:
        raise Refusal("exists", "a preset can't be changed: make a copy of it first")
    return panel.path


def wizard_steps() -> list[dict[str, Any]]:
    """What the wizard asks at each of its steps."""
    return [
        {"step": "slant", "kind": "slant", "fields": [
            {"name": "bands", "kind": "number", "min": 0, "max": 200},
            {"name": "lean", "kind": "choice", "choices": ["none", "upright", "level"]},
            {"name": "color", "kind": "choice", "choices": ["white", "red", "blue"]}]},
        {"step": "views", "kind": "views", "fields": [
            {"name": "lit", "kind": "numbers"}, {"name": "grows", "kind": "yesno"}]},
        {"step": "fringe", "kind": "fringe", "fields": [
            {"name": "edges", "kind": "choice", "choices": ["clean", "colored"]}]}]


def corrected(display: Display, step: str, answer: dict[str, Any],
              seen: dict[str, Any]) -> tuple[Display, str | None, str, dict[str, Any]]:
    """The display after an answer.

    The pattern ``slant`` is white from the middle where the numbers are right. With a pitch L
    instead of L', the phase runs away by 3 W (1 / L - 1 / L') lenses over the panel's width W, and
    each lens is one band of red beside one of blue. With a slant that is off, it runs away down
    the rows, by H (shift - shift') / L lenses over the height H. One count leaves the sign open:
    the first correction tries one, and with the second count it is known. All counts together then
    tell the number better than one does.

    The step is ``slant``, ``views`` or ``fringe``; ``seen`` was counted before at it. Gives the
    display, the step to go on with or None, what is said, and what was counted so far.
    """
    if step == "fringe":
        if choice(answer, "edges", ("clean", "colored")) == "clean":
            return display, None, "The colors are in their order.", {}
        other = "BGR" if display.subpixels == "RGB" else "RGB"
        return replace(display, subpixels=other), "fringe", f"The sub-pixels are {other} now.", {}
    if step == "views":
        return _by_views(display, answer)
    lean = choice(answer, "lean", ("none", "upright", "level"))
    if lean == "none":
        return _by_color(display, answer)
    bands = number(answer, "bands", 0.25, 200.0)
    unit, place = ((3 * display.width, 1 / display.pitch) if lean == "upright" else
                   (display.height / display.pitch, display.shift))
    counts = [*seen.get(lean, []), [place, bands]][-_COUNTS:]
    best = _agreed(counts, unit)
    if len(counts) > 2 and min(abs(best - one) for one, _ in counts) * unit < _ALIKE:
        # The number that the counts agree on was tried already: counting can't tell more.
        best = min((one for one, _ in counts), key=lambda one: abs(best - one))
        following, words = "views", "as right as counting can tell"
    else:
        following, words = "slant", "another one: look again"
    change = _changed(display, pitch=1 / best) if lean == "upright" else (
        _changed(display, slant=math.atan(best / 3)))
    name, value = (("pitch", change.pitch) if lean == "upright"
                   else ("slant", math.degrees(change.slant)))
    return change, following, f"The {name} is {value:.5f} now, {words}.", {**seen, lean: counts}


def _agreed(counts: list[list[float]], unit: float) -> float:
    """The number that counts of bands, which may be off either way, agree on best."""
    def spread(signs: tuple[int, ...]) -> tuple[float, float]:
        places = [place + sign * bands / unit
                  for sign, (place, bands) in zip(signs, counts, strict=True)]
        mean = sum(places) / len(places)
        return sum((place - mean) ** 2 for place in places), mean

    # The first one of equals: a larger number.
    return min((spread(signs) for signs in product((1, -1), repeat=len(counts))),
               key=lambda found: found[0])[1]


def _changed(display: Display, **entries: Any) -> Display:
    """Another pitch or slant; the middle of the panel keeps its view."""
    found = replace(display, **entries)
    row, column = display.height // 2, display.width // 2
    share = float(display.phase(row, column, 1)) / display.pitch
    there = float(found.phase(row, column, 1)) / found.pitch
    gap = (share - there) * found.pitch * (-1 if found.inverted else 1)
    return replace(found, offset=(found.offset + gap) % found.pitch)


def _by_color(display: Display, answer: dict[str, Any],
              ) -> tuple[Display, str | None, str, dict[str, Any]]:
    """One color all over: the offset. Red is left of the middle, blue right of it."""
    color = choice(answer, "color", ("white", "red", "blue"))
    if color == "white":
        return display, "views", "Pitch, slant and offset are right.", {}
    step = display.pitch / 4 * (1 if color == "red" else -1) * (-1 if display.inverted else 1)
    found = replace(display, offset=(display.offset + step) % display.pitch)
    return found, "slant", f"The offset is {found.offset:.3f} now.", {}


def _by_views(display: Display, answer: dict[str, Any],
              ) -> tuple[Display, str | None, str, dict[str, Any]]:
    """The numbers that are lit from the middle: the offset exactly; and whether they grow."""
    lit = answer.get("lit")
    if not isinstance(lit, list) or not lit or len(lit) > display.views:
        raise Refusal("bad_request", "lit must be the numbers that are lit", field="lit")
    views = [number({"lit": one}, "lit", 0, display.views - 1) for one in lit]
    found = display
    if not truth(answer, "grows", True):
        found = replace(found, inverted=not found.inverted)
        return found, "views", "The views were inverted; look at the numbers again.", {}
    # Views that lie on both sides of the last one are next to each other, too.
    angles = [2 * math.pi * (view + 0.5) / display.views for view in views]
    mean = math.atan2(sum(map(math.sin, angles)), sum(map(math.cos, angles))) % (2 * math.pi)
    off = mean / (2 * math.pi) * display.views - display.views / 2
    step = -off / display.views * display.pitch * (-1 if display.inverted else 1)
    found = replace(found, offset=(found.offset + step) % found.pitch)
    if abs(off) < 0.75:
        return display, "fringe", "The middle view is seen from the middle.", {}
    return found, "views", f"The offset is {found.offset:.3f} now; look again.", {}
