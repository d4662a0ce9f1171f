"""A version in full: painted, mixed, coded and shown in a page; and exports of its field.

The painted head is kept for each painting (``painted/STYLE/``), so that another mix of it takes
seconds. Without a mix all files are those that ``lfportrait make`` writes.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...cache import hash_of
from ...capture import Capture
from ...errors import UserError
from ...example import Exemplar
from ...face import frontal_order
from ...field import VoxelField
from ...files import atomic_path, read_json, write_image, write_json
from ...job import (
    MakeConfig,
    Warmup,
    code_key,
    painting_key,
    portrait_tasks,
    run_figures,
    share_key,
    stage_key,
    style_key,
)
from ...lightfield import EncodeConfig
from ...media.pictures import read_image
from ...share import ExportContext
from ...stages import StageFolder, finished_record
from ...stylize import StyledField, load_styled
from ..answers import id_of
from ..exports import forget_unfinished, kind_of
from ..orders import Order
from .jobs import do_task, expected
from .pictures import coded_picture, head_picture
from .resident import Look, Sitting
from .telling import Teller


def fine(order: Order, teller: Teller) -> dict[str, Any]:
    """Paint, mix, code, and write the page, the video and the report."""
    teller.tell("stages", expected(("stylize", "stylize"), ("encode", "encode"),
                                   ("share", "share")))
    config, panel = order.config(), order.panel()
    exemplar = Exemplar.load(order.style)
    figures: dict[str, Any] = {}
    for name in ("capture", "reconstruct"):
        found = _record(order, name)
        if found is not None:
            figures[name] = found
    where = order.inside(order.version)
    exemplars = [exemplar, *(replace(Exemplar.load(path), name=name)
                             for name, path in sorted(order.more["styles"].items()))]
    painted, key = _painted(order, config, exemplars)
    more: dict[str, Any] = {
        "display": panel, "folders": {"stylize": painted, "encode": where, "share": where},
        "inputs": {**order.inputs(), "styled": f"{where}/styled.npz"}}
    with Warmup(("transfer", "stylize", "encode")) as warmup:
        (stylize,) = portrait_tasks({"stylize": key}, config, **more)
        do_task(order, teller, stylize, figures, warmup, exemplar=exemplar, others=exemplars[1:])
        key = mixed_file(order, key, f"{painted}/styled.npz")
        styled = VoxelField.load(order.version / "styled.npz")
        teller.picture("stylize", head_picture(styled))
        code = code_key(key, config, panel)
        encode, share = portrait_tasks({"encode": code, "share": share_key(code, config)}, config,
                                       **more)
        do_task(order, teller, encode, figures, warmup)
        teller.picture("encode", coded_picture(read_image(order.version / "lightfield.png")))
        do_task(order, teller, share, figures, warmup, exemplar=exemplar)
    _photograph(order)
    hero = order.version / "hero.png"
    if hero.is_file():
        teller.picture("share", read_image(hero))
    resumed: list[str] = [name for name in ("capture", "reconstruct") if name in figures]
    write_json(order.version / "run.json", run_figures(
        figures, exemplar.name, panel.name, resumed))
    return {"display": panel.name, "key": key}


def _photograph(order: Order) -> None:
    """Lay the sitter's most frontal photo beside the video: a study shows both."""
    capture = Capture.load(order.job / "capture")
    view = int(frontal_order(capture.cameras)[0])
    write_image(order.version / "photo.jpg", capture.image_float(view), quality=92)


def _painted(order: Order, config: MakeConfig, exemplars: list[Exemplar]) -> tuple[str, str]:
    """The folder of the head that is painted in all styles of a version, and its key."""
    field = order.field_key()
    if len(exemplars) == 1:
        return f"painted/{order.style_id}", style_key(field, config, painting_key(exemplars[0]))
    names = [one.name for one in exemplars[1:]]
    return f"painted/{order.style_id}-and-{hash_of(names)[:8]}", stage_key(
        "stylize", field, config.stylize, [(one.name, *painting_key(one)) for one in exemplars])


def _record(order: Order, name: str) -> dict[str, Any] | None:
    """The figures of a stage of the head, whatever it was made of."""
    try:
        return dict(read_json(order.job / ".stages" / f"{name}.json")["figures"])
    except (UserError, KeyError, TypeError, ValueError):
        return None


def mixed_file(order: Order, key: str, painted: str) -> str:
    """Write the version's ``styled.npz``: the painted head, or its mix; the key of that file."""
    source, target = order.folder / painted, order.version / "styled.npz"
    own = stage_key("stylize", "mix", key, order.mix) if order.mix else key
    record = "mix"
    if finished_record(order.version, record, own, ("styled.npz",)) is not None:
        return own

    def write() -> dict[str, Any]:
        if order.mix:
            StyledField.load(source).mix(**order.mix).save(target)
        else:
            with atomic_path(target) as temporary:
                shutil.copyfile(source, temporary)
        return {}

    StageFolder(order.version).run(record, own, ("styled.npz",), write)
    return own


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
