"""A job in a process of its own: it gets one order, does it stage by stage, and ends.

A head of photos; a version in full: painted, mixed, coded and shown in a page; exports of its
field. The painted head is kept for each painting (``painted/STYLE/``), so that another mix of it
takes seconds. Without a mix all files are those that ``lfportrait make`` writes.
"""

import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from ... import job, models
from ...cache import StageFolder, finished_record, hash_of
from ...capture import Capture
from ...demo import demo_capture
from ...example import Exemplar
from ...face import frontal_order, is_portrait
from ...field import VoxelField
from ...files import atomic_path, plain_json, write_image, write_json
from ...job import FULL, QUICK, STAGES, MakeConfig, Task, Warmup, get_networks
from ...lightfield import EncodeConfig
from ...measure import usable_cores
from ...media.pictures import read_image
from ...runner import finished
from ...runner import serve as serve_requests
from ...share import ExportContext
from ...stylize import StyledField, kept_skin, load_styled
from ..answers import id_of, read_error
from ..exports import forget_unfinished, kind_of
from ..jobs import Order
from ..photos import VIDEO_FRAME
from ..projects import record_in
from . import pictures
from .pictures import EarlyPicture, Teller
from .resident import Look, Sitting

_FITTED = {"capture": 2.5, "reconstruct": 7.5}  # Seconds of a head that is fitted to a face.


def serve() -> None:
    """Do what is ordered."""
    serve_requests(_do, read_error)


def _do(order: Order, tell: Callable[..., None]) -> dict[str, Any]:
    return _KINDS[order.kind](order, Teller(tell, order.pictures))


def do_task(order: Order, teller: Teller, task: Task, figures: dict[str, Any],
            warmup: Warmup, draw: Callable[[Any], Any] | None = None, **tools: Any) -> None:
    """Do a task, unless it is done; its figures are kept by its name."""
    stages = StageFolder(order.folder / task.folder)
    if finished(task, order.folder) is not None:
        figures[task.record] = stages.run(task.record, task.key, task.outputs, dict)
        teller.tell("skipped", task.record)
        return
    own = teller.tools(task.record, draw, warmup=warmup, **tools)
    figures[task.record] = stages.run(task.record, task.key, task.outputs, partial(
        job.do_stage, task, order.folder, stages, own, figures))


def expected(*stages: tuple[str, str]) -> list[tuple[str, float]]:
    """Names of stages with the seconds that they take here, before any was measured."""
    cores = usable_cores()
    return [(name, STAGES[stage].need.seconds / cores) for name, stage in stages]


def _head(order: Order, teller: Teller) -> dict[str, Any]:
    """Cameras, field and surface: all that previews need; a first look at the chosen painting."""
    look = EarlyPicture(order, teller)
    config = order.config()
    fitted = not order.demo and job.head_way(order.source, config.made_from) == "face"
    seconds = dict(expected(("capture", "capture"), ("reconstruct", "field"), ("surface", "skin")))
    teller.tell("stages", [*(seconds | (_FITTED if fitted else {})).items()])
    with Warmup(job.head_kernels(fitted, order.demo)) as warmup:
        look.warmup = warmup
        if order.demo and not any(order.source.glob("transforms.json")):
            _take_embedded(order)
        job.look_at(order.source)
        get_networks(order.source, None, config.keep_background, offline=True, quiet=True)
        key, figures = job.capture_key(job.source_key(order.source), config, 0), dict[str, Any]()
        capture, field_task = job.portrait_tasks(
            {"capture": key, "reconstruct": job.field_key(key, config)}, config,
            folders=dict.fromkeys(("capture", "reconstruct"), order.inside(order.job)),
            inputs=order.inputs(), source=str(order.source))
        do_task(order, teller, capture, figures, warmup,
                sheet=order.folder / ".studio" / "photos-left-out.jpg")
        taken = Capture.load(order.job / "capture")
        teller.picture("capture", pictures.photo_picture(taken) if is_portrait(taken)
                       else pictures.cameras_picture(taken))
        number = iter(range(1 << 30))

        def draw(field: VoxelField) -> Any:
            if is_portrait(taken):  # it is not trained, and shown once
                teller.page("reconstruct", field)
            return pictures.head_picture(field, 320, (pictures.turned(next(number)),))

        do_task(order, teller, field_task, figures, warmup, draw=draw, look=look)
        with teller.stage("surface") as progress:
            warmup.wait(("transfer",), progress)
            progress.update(0, "the head's surface")
            field = VoxelField.load(order.job / "field.npz")
            picture = pictures.head_picture(field)
            teller.picture("reconstruct", picture)
            kept_skin(order.job / "field.npz", field, taken, config.stylize.pixels)
            if not look.figures:
                teller.picture(look.STAGE, picture)
    return {"views": len(taken), "voxels": len(field.density)}


def _take_embedded(order: Order) -> None:
    """Lay the photos of the built-in head where those of a sitter are."""
    scale = QUICK if order.options.get("quick") else FULL
    size, views = (int(order.options.get(name, usual)) for name, usual in (
        ("size", scale.size), ("views", scale.views)))
    demo_capture(size=size, views=views).save(order.source)


def _check(order: Order, teller: Teller) -> dict[str, Any]:
    teller.tell("stages", [("check", 10.0)])
    with teller.stage("check") as progress:
        progress.total = int(order.more["count"])
        found = job.check_photos(order.source, progress)
    figures = found.figures()
    facts = {one.pop("name"): one for one in figures.pop("photos")}
    if order.source.is_file() and found.images:
        frame = Image.fromarray(found.images[len(found.images) // 2][..., :3])
        frame.thumbnail((480, 480))
        write_image(order.folder / ".studio" / "small" / VIDEO_FRAME, np.asarray(frame), quality=85)
    write_json(order.folder / ".studio" / "check.json",
               {**figures, "key": order.more["key"], "facts": facts})
    return {"faces": figures["faces"], "useless": figures["useless"]}


def _networks(order: Order, teller: Teller) -> dict[str, Any]:
    """Download networks: the only thing that asks the network for anything."""
    names = list(order.more["names"])
    teller.tell("stages", [("networks", 10.0)])
    with teller.stage("networks") as progress:
        progress.total = len(names)
        for name in names:
            progress.update(progress.done, name)
            models.require([name], download=True, quiet=True)
            progress.step(name)
    return {"names": names}


def fine(order: Order, teller: Teller) -> dict[str, Any]:
    """Paint, mix, code, and write the page, the video and the report."""
    teller.tell("stages", expected(("stylize", "stylize"), ("encode", "encode"),
                                   ("share", "share")))
    config, panel = order.config(), order.panel()
    exemplar = Exemplar.load(order.style)
    figures: dict[str, Any] = {}
    for name in ("capture", "reconstruct"):
        found = (record_in(order.job / ".stages" / f"{name}.json") or {}).get("figures")
        if isinstance(found, dict):
            figures[name] = found
    where = order.inside(order.version)
    exemplars = [exemplar, *(replace(Exemplar.load(path), name=name)
                             for name, path in sorted(order.more["styles"].items()))]
    painted, key = _painted(order, config, exemplars)
    more: dict[str, Any] = {
        "display": panel, "folders": {"stylize": painted, "encode": where, "share": where},
        "inputs": {**order.inputs(), "styled": f"{where}/styled.npz"}}
    with Warmup(("transfer", "stylize", "encode")) as warmup:
        (stylize,) = job.portrait_tasks({"stylize": key}, config, **more)
        do_task(order, teller, stylize, figures, warmup, exemplar=exemplar, others=exemplars[1:])
        key = mixed_file(order, key, f"{painted}/styled.npz")
        styled = VoxelField.load(order.version / "styled.npz")
        teller.picture("stylize", pictures.head_picture(styled))
        code = job.code_key(key, config, panel)
        encode, share = job.portrait_tasks(
            {"encode": code, "share": job.share_key(code, config)}, config, **more)
        do_task(order, teller, encode, figures, warmup)
        coded = read_image(order.version / "lightfield.png")
        teller.picture("encode", pictures.coded_picture(coded))
        do_task(order, teller, share, figures, warmup, exemplar=exemplar)
    # The sitter's most frontal photo, beside the video: a study shows both.
    capture = Capture.load(order.job / "capture")
    front = int(frontal_order(capture.cameras)[0])
    write_image(order.version / "photo.jpg", capture.image_float(front), quality=92)
    hero = order.version / "hero.png"
    if hero.is_file():
        teller.picture("share", read_image(hero))
    resumed: list[str] = [name for name in ("capture", "reconstruct") if name in figures]
    write_json(order.version / "run.json", job.run_figures(
        figures, exemplar.name, panel.name, resumed))
    return {"display": panel.name, "key": key}


def _painted(order: Order, config: MakeConfig, exemplars: list[Exemplar]) -> tuple[str, str]:
    """The folder of the head that is painted in all styles of a version, and its key."""
    field = order.field_key()
    if len(exemplars) == 1:
        key = job.style_key(field, config, job.painting_key(exemplars[0]))
        return f"painted/{order.style_id}", key
    names = [one.name for one in exemplars[1:]]
    return f"painted/{order.style_id}-and-{hash_of(names)[:8]}", job.stage_key(
        "stylize", field, config.stylize, [(one.name, *job.painting_key(one)) for one in exemplars])


def mixed_file(order: Order, key: str, painted: str) -> str:
    """Write the version's ``styled.npz``: the painted head, or its mix; the key of that file."""
    source, target = order.folder / painted, order.version / "styled.npz"
    own = job.stage_key("stylize", "mix", key, order.mix) if order.mix else key
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
            "version": more.get("version"), "figures": plain_json(figures)}


_KINDS: dict[str, Callable[[Order, Teller], dict[str, Any]]] = {
    "head": _head, "check": _check, "networks": _networks, "fine": fine, "export": export}
