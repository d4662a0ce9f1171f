"""An export in a process of its own: a version's field as a file of any kind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...lightfield import EncodeConfig
from ...share import ExportContext
from ...stylize import load_styled
from ..answers import id_of
from ..exports import forget_unfinished, kind_of
from ..orders import Order
from .resident import Look, Sitting
from .telling import Teller


def export(order: Order, teller: Teller) -> dict[str, Any]:
    """Write the file; its figures."""
    more = order.more
    path, kind = Path(more["target"]), kind_of(more["kind"])
    forget_unfinished(path)  # of an earlier run
    teller.tell("stages", [("export", 10.0)])
    with teller.stage("export") as progress:
        progress.update(0, path.name)
        look = Look(more["look"])
        fine = look.styled is not None and not look.mix
        # As the commands read it: from the file, with the numbers that it keeps.
        field = load_styled(look.styled) if fine else Sitting().on_panel(look)
        # Without a panel a head is placed by its own screen.
        placed = {"encode": EncodeConfig(**more["placement"])} if kind.needs_display else {}
        figures = kind.make(field, path, kind.chosen(more["options"]), ExportContext(
            **placed, display=order.display, progress=progress))
    out = figures.pop("out")
    return {"export": id_of(out.name), "file": out.name, "kind": kind.name, "fine": fine,
            "version": more.get("version"), "figures": _plain(figures)}


def _plain(value: Any) -> Any:
    """Figures as JSON takes them."""
    if isinstance(value, dict):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, Path):
        return str(value)
    return value.item() if hasattr(value, "item") else value
