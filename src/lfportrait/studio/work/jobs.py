"""A job in a process of its own: it gets one order, does it stage by stage, and ends."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from PIL import Image

from ... import models
from ...demo import demo_capture
from ...face import is_portrait
from ...files import write_image, write_json
from ...job import (
    FULL,
    QUICK,
    STAGES,
    Task,
    Warmup,
    capture_key,
    check_photos,
    do_stage,
    field_key,
    get_networks,
    head_kernels,
    head_way,
    look_at,
    portrait_tasks,
    source_key,
)
from ...measure import usable_cores
from ...runner import finished, workers
from ...stages import StageFolder
from ..answers import read_error
from ..orders import Order
from ..photos import VIDEO_FRAME
from .pictures import cameras_picture, head_picture, photo_picture, turned
from .telling import Teller

_FITTED = {"capture": 2.5, "reconstruct": 7.5}
"""Seconds of a head that is fitted to a face."""


def serve() -> None:
    """Do what is ordered."""
    workers.serve(_do, read_error)


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
        do_stage, task, order.folder, stages, own, figures))


def expected(*stages: tuple[str, str]) -> list[tuple[str, float]]:
    """Names of stages with the seconds that they take here, before any was measured."""
    cores = usable_cores()
    return [(name, STAGES[stage].need.seconds / cores) for name, stage in stages]


def _head(order: Order, teller: Teller) -> dict[str, Any]:
    """Cameras, field and surface: all that previews need; a first look at the chosen painting."""
    from ...capture import Capture
    from ...field import VoxelField
    from ...stylize import kept_skin
    from .pictures import EarlyPicture

    look = EarlyPicture(order, teller)
    config = order.config()
    fitted = not order.demo and head_way(order.source, config.made_from) == "face"
    seconds = dict(expected(("capture", "capture"), ("reconstruct", "field"), ("surface", "skin")))
    teller.tell("stages", [*(seconds | (_FITTED if fitted else {})).items()])
    with Warmup(head_kernels(fitted, order.demo)) as warmup:
        look.warmup = warmup
        if order.demo and not any(order.source.glob("transforms.json")):
            _take_embedded(order)
        look_at(order.source)
        get_networks(order.source, None, config.keep_background, offline=True, quiet=True)
        key, figures = capture_key(source_key(order.source), config, 0), dict[str, Any]()
        capture, field_task = portrait_tasks(
            {"capture": key, "reconstruct": field_key(key, config)}, config,
            folders=dict.fromkeys(("capture", "reconstruct"), order.inside(order.job)),
            inputs=order.inputs(), source=str(order.source))
        do_task(order, teller, capture, figures, warmup,
                sheet=order.folder / ".studio" / "photos-left-out.jpg")
        taken = Capture.load(order.job / "capture")
        teller.picture("capture", photo_picture(taken) if is_portrait(taken)
                       else cameras_picture(taken))
        number = iter(range(1 << 30))

        def draw(field: VoxelField) -> Any:
            if is_portrait(taken):  # it is not trained, and shown once
                teller.page("reconstruct", field)
            return head_picture(field, 320, (turned(next(number)),))

        do_task(order, teller, field_task, figures, warmup, draw=draw, look=look)
        with teller.stage("surface") as progress:
            warmup.wait(("transfer",), progress)
            progress.update(0, "the head's surface")
            field = VoxelField.load(order.job / "field.npz")
            picture = head_picture(field)
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
    """Look at each photo."""
    teller.tell("stages", [("check", 10.0)])
    with teller.stage("check") as progress:
        progress.total = int(order.more["count"])
        found = check_photos(order.source, progress)
    figures = found.figures()
    facts = {one.pop("name"): one for one in figures.pop("photos")}
    if order.source.is_file() and found.images:
        frame = Image.fromarray(found.images[len(found.images) // 2][..., :3])
        frame.thumbnail((480, 480))
        write_image(order.folder / ".studio" / "small" / VIDEO_FRAME, np.asarray(frame),
                    quality=85)
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


def _later(module: str, name: str, order: Order, teller: Teller) -> dict[str, Any]:
    from importlib import import_module

    found: dict[str, Any] = getattr(import_module(module, __package__), name)(order, teller)
    return found


_KINDS: dict[str, Callable[[Order, Teller], dict[str, Any]]] = {
    "head": _head, "check": _check, "networks": _networks,
    "fine": partial(_later, ".fine", "fine"), "export": partial(_later, ".fine", "export")}
