"""Draw docs/images/house.svg from the code: the stages, their rooms, and who imports whom.

An arrow leads from a stage to one that it imports. Arrows that a longer way implies are left out.
The laboratory (`lfportrait_eval`) stands beside the house: it imports stages, and none imports it.
The area of a box follows its lines of code; a bar in it tells a room's share of them.

Run: python scripts/draw_house.py            writes the picture
     python scripts/draw_house.py --check    exit code 1 if the picture is not up to date

Lines of code change with every commit: the check lets them be a tenth off, but nothing else.
"""

from __future__ import annotations

import itertools
import math
import re
import sys
from dataclasses import dataclass
from html import escape
from pathlib import Path

from house import (
    GROUND,
    LABORATORY,
    ROOT,
    SOURCE,
    STAGES,
    Graph,
    graph_of,
    module_files,
    stage_imports,
    without_detours,
)

PICTURE = ROOT / "docs" / "images" / "house.svg"

LINE = 11.2  # area of a line of code
ASPECT = 2.4  # a box is at most so much wider than high
HEAD, ROW, FOOT = 49.0, 19.0, 9.0  # heights in a box: title, one room, below the last room
BESIDE, BETWEEN = 46.0, 54.0  # gaps: beside boxes, between storeys
MARGIN, ROOF = 44.0, 66.0
CELL = 60.0  # least width of a module of the ground floor
ANNEX, ANNEX_WIDTH = 64.0, 250.0  # gap before the laboratory's box, and its width


@dataclass(frozen=True)
class Room:
    """A folder of sources, with what lies in folders inside of it."""

    name: str
    files: int
    lines: int
    inner: tuple[Room, ...] = ()


@dataclass
class Box:
    """A room's place in the picture: its upper left corner and its size."""

    room: Room
    width: float
    height: float
    x: float = 0.0
    y: float = 0.0

    @property
    def middle(self) -> float:
        """X of its middle."""
        return self.x + self.width / 2


def counted(name: str, paths: list[Path], inner: tuple[Room, ...] = ()) -> Room:
    lines = sum(len(path.read_text("utf-8").splitlines()) for path in paths)
    return Room(name, len(paths), lines, inner)


def rooms() -> list[Room]:
    """The stages with the rooms inside, then the laboratory, and the ground floor as the last."""
    found = []
    for home in (*(SOURCE / stage for stage in STAGES), LABORATORY):
        folders = sorted(path for path in home.iterdir()
                         if path.is_dir() and any(path.glob("*.py")))
        found.append(counted(home.name, sorted(home.rglob("*.py")), tuple(
            counted(folder.name, sorted(folder.rglob("*.py"))) for folder in folders)))
    cells = tuple(counted(name, [path for path in sorted(SOURCE.rglob("*.py"))
                                 if path.relative_to(SOURCE).parts[0] in (name, f"{name}.py")])
                  for name in GROUND)
    return [*found, Room("ground floor", sum(cell.files for cell in cells),
                         sum(cell.lines for cell in cells), cells)]


# -- layout ----------------------------------------------------------------------------------------

def storeys(arrows: Graph) -> list[list[str]]:
    """Stages by storey from the top: each below all that import it; lanes for long arrows.

    A lane "a>b" is a place that the arrow from a to b passes on a storey between the two.
    """
    def depth(name: str) -> int:
        above = [depth(other) for other in arrows if name in arrows[other]]
        return 1 + max(above) if above else 0

    depths = {name: depth(name) for name in arrows}
    levels: list[list[str]] = [[] for _ in range(1 + max(depths.values()))]
    for name in arrows:
        levels[depths[name]].append(name)
        for other in sorted(arrows[name]):
            for level in range(depths[name] + 1, depths[other]):
                levels[level].append(f"{name}>{other}")
    return levels


def stretches(arrows: Graph, levels: list[list[str]]) -> list[tuple[str, str]]:
    """The arrows cut at the lanes that they pass: pairs on storeys that follow each other."""
    found = []
    for name in arrows:
        for other in sorted(arrows[name]):
            lanes = [lane for level in levels for lane in level if lane == f"{name}>{other}"]
            way = [name, *lanes, other]
            found += list(itertools.pairwise(way))
    return found


def untangled(levels: list[list[str]], parts: list[tuple[str, str]]) -> list[list[str]]:
    """The order on each storey with the fewest crossings, then with the shortest arrows."""
    def cost(order: tuple[tuple[str, ...], ...]) -> tuple[int, float]:
        spot = {name: (level, (i + 0.5) / len(row)) for level, row in enumerate(order)
                for i, name in enumerate(row)}
        crossings = sum(
            spot[a][0] == spot[c][0] and (spot[a][1] - spot[c][1]) * (spot[b][1] - spot[d][1]) < 0
            for (a, b), (c, d) in itertools.combinations(parts, 2))
        return crossings, sum(abs(spot[a][1] - spot[b][1]) for a, b in parts)

    orders = itertools.product(*(itertools.permutations(row) for row in levels))
    return [list(row) for row in min(orders, key=cost)]


def box_of(room: Room) -> Box:
    area, least = LINE * room.lines, HEAD + ROW * len(room.inner) + FOOT * bool(room.inner)
    width = max(140.0, round(min(area / least, math.sqrt(ASPECT * area))))
    return Box(room, width, max(least, round(area / width)))


def placed(house: list[Room], levels: list[list[str]]) -> tuple[dict[str, Box], float, float]:
    """Boxes and lanes by name; the picture's width, and the height down to the ground floor."""
    known = {room.name: room for room in house}
    boxes = {name: box_of(known[name]) if name in known
             else Box(Room(name, 0, 0), 0.0, 0.0) for level in levels for name in level}
    widths = [sum(boxes[name].width for name in level) + BESIDE * (len(level) - 1)
              for level in levels]
    width = max(max(widths) + 2 * MARGIN, CELL * len(GROUND) + MARGIN)
    y = MARGIN + ROOF
    for level, taken in zip(levels, widths):
        x, tallest = (width - taken) / 2, max(boxes[name].height for name in level)
        for name in level:
            box = boxes[name]
            box.x, box.y = round(x), round(y + tallest - box.height)
            if name not in known:
                box.y, box.height = round(y), tallest
            x += box.width + BESIDE
        y += tallest + BETWEEN
    return boxes, width, y - BETWEEN


def spread(wanted: list[tuple[float, str]], low: float, high: float,
           gap: float) -> dict[str, float]:
    """Places near the wanted ones, in their order, ``gap`` apart if there is room."""
    wanted = sorted(wanted)
    gap = min(gap, (high - low) / max(1, len(wanted) - 1))
    spots = [min(max(spot, low), high) for spot, _ in wanted]
    for i in range(1, len(spots)):
        spots[i] = max(spots[i], spots[i - 1] + gap)
    for i in range(len(spots) - 1, -1, -1):
        spots[i] = min(spots[i], high - gap * (len(spots) - 1 - i))
    return {name: round(spot) for spot, (_, name) in zip(spots, wanted)}


def curves(boxes: dict[str, Box], parts: list[tuple[str, str]]) -> list[tuple[str, bool]]:
    """Path data of each stretch, and whether it ends in an arrow's head."""
    def ends(box: Box) -> tuple[float, float]:
        inset = min(26.0, box.width / 2)
        return box.x + inset, box.x + box.width - inset

    leaving, arriving = {}, {}
    for name in boxes:
        wanted = [(boxes[b].middle, b) for a, b in parts if a == name]
        leaving[name] = spread(wanted, *ends(boxes[name]), 34.0)
    for name in boxes:
        wanted = [(leaving[a][name], a) for a, b in parts if b == name]
        arriving[name] = spread(wanted, *ends(boxes[name]), 34.0)
    found = []
    for a, b in parts:
        lane, last = ">" in a, ">" not in b
        x0, y0 = leaving[a][b], boxes[a].y + boxes[a].height + (0 if lane else 2)
        x1, y1 = arriving[b][a], boxes[b].y - (9 if last else 0)
        start = f"M{x0:g} {boxes[a].y:g} V{y0:g}" if lane else f"M{x0:g} {y0:g}"
        half = (y0 + y1) / 2
        found.append((f"{start} V{y1:g}" if x0 == x1 else
                      f"{start} C{x0:g} {half:g} {x1:g} {half:g} {x1:g} {y1:g}", last))
    return found


# -- drawing ---------------------------------------------------------------------------------------

STYLE = """
  text { font: 12px -apple-system, "Segoe UI", "Noto Sans", Helvetica, Arial, sans-serif;
         fill: #57606a; }
  .name { font-size: 16px; font-weight: 600; fill: #1f2328; }
  .inner { fill: #24292f; }
  .right { text-anchor: end; }
  .middle { text-anchor: middle; }
  .sky { fill: #ffffff; }
  .wall { fill: #f6f8fa; stroke: #d0d7de; stroke-width: 1.5; stroke-linejoin: round; }
  .room { fill: #ffffff; stroke: #54809f; stroke-width: 1.5; }
  .bar { fill: #dcebf5; }
  .ground { fill: #f3ecdf; stroke: #a68a5b; stroke-width: 1.5; }
  .cell { fill: #fffdf8; stroke: #d9c7a3; }
  .arrow { fill: none; stroke: #6e7781; stroke-width: 1.6; }
  .head { fill: #6e7781; }
  @media (prefers-color-scheme: dark) {
    text { fill: #9198a1; }
    .name { fill: #f0f6fc; }
    .inner { fill: #d1d7e0; }
    .sky { fill: #0d1117; }
    .wall { fill: #151b23; stroke: #3d444d; }
    .room { fill: #0d1117; stroke: #6ea4c8; }
    .bar { fill: #1c3547; }
    .ground { fill: #2a2419; stroke: #a68a5b; }
    .cell { fill: #1b1811; stroke: #5e5034; }
    .arrow { stroke: #8b949e; }
    .head { fill: #8b949e; }
  }
"""


def plural(count: int, word: str) -> str:
    return f"{count} {word}" + ("s" if count != 1 else "")


def drawn_box(box: Box) -> list[str]:
    room, x, y = box.room, box.x, box.y
    out = [f'<g data-room="{room.name}" data-lines="{room.lines}">',
           f'<rect class="room" x="{x:g}" y="{y:g}" width="{box.width:g}" '
           f'height="{box.height:g}" rx="6"/>',
           f'<text class="name" x="{x + 12:g}" y="{y + 23:g}">{room.name}</text>',
           f'<text x="{x + 12:g}" y="{y + 40:g}">{plural(room.files, "file")}, '
           f'{room.lines} lines</text>']
    row = min(27.0, (box.height - HEAD - FOOT) / max(1, len(room.inner)))
    for number, inner in enumerate(room.inner):
        top, wide = y + HEAD + number * row, box.width - 16
        share = max(3.0, round(wide * inner.lines / room.lines))
        base = round(top + row / 2 + 4)
        out += [f'<g data-room="{room.name}/{inner.name}" data-lines="{inner.lines}">',
                f'<rect class="bar" x="{x + 8:g}" y="{top + 1:g}" width="{share:g}" '
                f'height="{row - 2:g}" rx="3"/>',
                f'<text class="inner" x="{x + 13:g}" y="{base}">{inner.name}</text>',
                f'<text class="right" x="{x + box.width - 12:g}" y="{base}">'
                f'{inner.files} · {inner.lines}</text>', "</g>"]
    return [*out, "</g>"]


def drawn_ground(room: Room, width: float, y: float) -> list[str]:
    """The ground floor as one bar under everything, a cell for each of its modules."""
    left, inside = MARGIN / 2, width - MARGIN
    cell = (inside - 16 - 6 * (len(room.inner) - 1)) / len(room.inner)
    out = [f'<g data-room="{room.name}" data-lines="{room.lines}">',
           f'<rect class="ground" x="{left:g}" y="{y:g}" width="{inside:g}" height="84" rx="6"/>',
           f'<text class="name" x="{left + 12:g}" y="{y + 23:g}">{room.name}</text>',
           f'<text class="right" x="{left + inside - 12:g}" y="{y + 23:g}">carries every stage and '
           f'knows none; {plural(room.files, "file")}, {room.lines} lines</text>']
    for number, inner in enumerate(room.inner):
        x = left + 8 + number * (cell + 6)
        out += [f'<g data-room="{room.name}/{inner.name}" data-lines="{inner.lines}">',
                f'<rect class="cell" x="{x:.1f}" y="{y + 34:g}" width="{cell:.1f}" height="42" '
                'rx="4"/>',
                f'<text class="inner middle" x="{x + cell / 2:.1f}" y="{y + 52:g}">{inner.name}'
                '</text>',
                f'<text class="middle" x="{x + cell / 2:.1f}" y="{y + 68:g}">{inner.files} · '
                f'{inner.lines}</text>', "</g>"]
    return [*out, "</g>"]


def drawn_annex(box: Box, wall: float) -> list[str]:
    """The laboratory beside the house, with the arrow to the house's wall."""
    left, right, eaves = box.x - 12, box.x + box.width + 12, box.y - 14
    level = box.y + 34
    return [f'<path class="wall" d="M{box.middle:g} {eaves - 54:g} L{right + 14:g} {eaves:g} '
            f'H{right:g} V{box.y + box.height:g} H{left:g} V{eaves:g} H{left - 14:g} Z"/>',
            *drawn_box(box),
            f'<path class="arrow" d="M{left:g} {level:g} H{wall + 9:g}" marker-end="url(#head)"/>']


def picture(house: list[Room], arrows: Graph) -> str:
    """The whole picture as SVG."""
    levels = storeys(arrows)
    parts = stretches(arrows, levels)
    levels = untangled(levels, parts)
    boxes, inside, bottom = placed(house, levels)
    ground = bottom + 34
    tall = round(LINE * house[-2].lines / ANNEX_WIDTH)
    beside = Box(house[-2], ANNEX_WIDTH, tall, inside + ANNEX, ground + 84 - tall)
    width = beside.x + beside.width + MARGIN
    height = ground + 84 + MARGIN / 2
    eaves = min(boxes[name].y for name in levels[min(2, len(levels) - 1)]) - 18
    wall = MARGIN / 2 + 10
    outline = (f"M{inside / 2:g} 14 L{inside - 10:g} {eaves:g} H{inside - wall:g} V{ground:g} "
               f"H{wall:g} V{eaves:g} H10 Z")
    note = "An arrow leads to what a stage imports. In the boxes: files · lines."
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}" height="{height:g}" '
           f'viewBox="0 0 {width:g} {height:g}" role="img" aria-label="The stages of lfportrait '
           'and their imports">',
           f"<style>{STYLE}</style>",
           f'<rect class="sky" width="{width:g}" height="{height:g}" rx="8"/>',
           f'<path class="wall" d="{outline}"/>',
           f'<text x="{wall + 14:g}" y="{ground - 14:g}">{escape(note)}</text>',
           '<defs><marker id="head" viewBox="0 0 10 8" refX="1" refY="4" markerWidth="10" '
           'markerHeight="8" markerUnits="userSpaceOnUse" orient="auto">'
           '<path class="head" d="M0 0 L10 4 L0 8 Z"/></marker></defs>']
    out += [f'<path class="arrow" d="{path}"' + (' marker-end="url(#head)"/>' if last else "/>")
            for path, last in curves(boxes, parts)]
    for level in levels:
        for name in level:
            if ">" not in name:
                out += drawn_box(boxes[name])
    out += drawn_annex(beside, inside - wall)
    return "\n".join([*out, *drawn_ground(house[-1], inside, ground), "</svg>"]) + "\n"


def settled(house: list[Room], before: str) -> list[Room]:
    """The rooms with the lines that the picture tells, where those are less than a tenth off."""
    told = {name: int(lines) for name, lines
            in re.findall(r'data-room="([^"]+)" data-lines="(\d+)"', before)}

    def one(room: Room, name: str) -> Room:
        lines = told.get(name, 0)
        if abs(lines - room.lines) > 0.1 * lines:
            lines = room.lines
        return Room(room.name, room.files, lines,
                    tuple(one(inner, f"{name}/{inner.name}") for inner in room.inner))

    return [one(room, room.name) for room in house]


def up_to_date(before: str, house: list[Room], arrows: Graph) -> bool:
    """Whether a picture shows these rooms and arrows, and their lines to a tenth."""
    return before == picture(settled(house, before), arrows)


def arrows_now() -> Graph:
    """The imports between the stages as they are, without those that others imply."""
    return without_detours(stage_imports(graph_of(module_files())))


def main() -> int:
    """Write or check the picture."""
    house, arrows = rooms(), arrows_now()
    if "--check" in sys.argv[1:]:
        if PICTURE.is_file() and up_to_date(PICTURE.read_text("utf-8"), house, arrows):
            return 0
        print("docs/images/house.svg is not up to date: run python scripts/draw_house.py")
        return 1
    PICTURE.write_text(picture(house, arrows), "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
