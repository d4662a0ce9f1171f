r"""The plan of a batch: the tasks of all sitters, styles and displays (`lfportrait.job.graph`).

::

    anna/capture -> anna/field -> anna/skin -> anna/ken/styled -> anna/ken/desk
                         |                \                   \-> anna/ken/page
                         |                 \-> anna/chalk/styled -> ...

A sitter has one capture, one field and one skin for all styles; a sitter in a style one styled
field for all displays. The keys are those of `lfportrait make`, so a
changed style redoes what depends on it and nothing else. What is wanted in the end are the tasks
that nothing else needs; a task before them is only done if one of them is not there yet.
"""

import json
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...cache import hash_of
from ...errors import UserError
from ...files import file_state, tells_changes, write_json
from ...lightfield import Display, EncodeConfig
from ...measure import free_disk_bytes, usable_cores
from ...runner import Costs, Need, Plan
from .. import graph
from ..graph import STAGES, MakeConfig, Task
from .jobs_file import Jobs, Panel, Sitter


def draw_plan(jobs: Jobs, paintings: dict[str, tuple[str, str]],
              fingerprint: Callable[[Path], str] = graph.source_key) -> Plan[Task]:
    """The graph of the jobs of a file.

    ``paintings`` has the hashes of the paintings (`painting_key`) by the names of the styles;
    ``fingerprint`` gives that of a sitter's photos, or a `UserError` where they can't be read.
    """
    def look(sitter: Sitter) -> str | UserError:
        try:
            graph.look_at(sitter.source)
            return fingerprint(sitter.source)
        except UserError as error:
            return error

    plan = Plan[Task]()
    # Hashing waits for the disk and does without Python's lock.
    with ThreadPoolExecutor(min(8, usable_cores())) as threads:
        for sitter, source in zip(jobs.sitters.values(), threads.map(look, jobs.sitters.values())):
            if isinstance(source, UserError):
                plan.refused[sitter.name] = str(source)
                continue
            for task in _Portraits(jobs, sitter, paintings, source).tasks():
                plan.tasks[task.name] = task
    return plan


def cores_of_a_task(plan: Plan[Task], cores: int) -> int:
    """Cores for each task where none are asked for.

    Tasks beside each other on a core each waste least, so they get more only where there are fewer
    sitters than cores. It follows from the whole plan, not from what is left of it: what is
    computed depends on the number of threads in its last bits, and a batch that goes on must end
    with the same files.
    """
    sitters = len({task.sitter for task in plan.tasks.values()})
    return max(1, min(8, cores // max(1, sitters)))


class _Portraits:
    """The tasks of one sitter."""

    def __init__(self, jobs: Jobs, sitter: Sitter, paintings: dict[str, tuple[str, str]],
                 source: str) -> None:
        self.jobs, self.sitter, self.paintings, self.source = jobs, sitter, paintings, source

    def _task(self, stage: str, name: str, outputs: tuple[str, ...], key: str, *,
              needs: tuple[str, ...], config: MakeConfig, style: str = "", **more: Any) -> Task:
        folder = f"{self.sitter.name}/{style}" if style else self.sitter.name
        return Task(f"{folder}/{name}", stage, folder, outputs, key, needs, config,
                    self.sitter.seed, **more)

    def tasks(self) -> list[Task]:
        """All tasks, each after those that it needs."""
        config = self.jobs.parameters(self.sitter.name)
        key = graph.capture_key(self.source, config, self.sitter.seed)
        capture = self._task("capture", "capture", ("capture", "photo.jpg"), key, needs=(),
                             config=config, source=str(self.sitter.source))
        config = graph.fitted(config, self._shown())
        key = graph.field_key(key, config)
        field = self._task("field", "field", ("field.npz",), key, needs=(capture.name,),
                           config=config, inputs={"capture": self._path("capture")})
        found = {task.name: task for task in (capture, field)}
        for style in self.sitter.styles:
            for task in self._styled(style, field):
                found[task.name] = task
        order = [capture.name, field.name,
                 *(task.name for task in found.values() if task.stage == "skin")]
        return [found[name] for name in dict.fromkeys([*order, *found])]

    def _shown(self) -> Iterator[tuple[Display, EncodeConfig]]:
        """The displays that the sitter's field is coded for, and how."""
        for style in self.sitter.styles:
            for name in self.sitter.displays:
                panel = self.jobs.panels[name]
                encode = self.jobs.parameters(self.sitter.name, style, panel.name).encode
                yield panel.display, encode

    def _styled(self, style: str, field: Task) -> list[Task]:
        """A sitter in a style: the skin, the styled field, and all that is made of it."""
        config = self.jobs.parameters(self.sitter.name, style)
        capture, found = field.needs[0], []
        needs: tuple[str, ...] = (capture, field.name)
        inputs = {"capture": self._path("capture"), "field": self._path("field.npz")}
        skin = ""
        if config.stylize.on_skin:
            # Skins of unlike resolution have files of their own.
            pixels = config.stylize.pixels
            file = f"skin-{pixels:g}"
            skin = graph.skin_key(field.key, pixels)
            found.append(self._task("skin", file, (f"{file}.npz",), skin, needs=needs,
                                    config=config, inputs=dict(inputs)))
            needs = (*needs, found[0].name)
            inputs["skin"] = self._path(f"{file}.npz")
        key = graph.style_key(field.key, config, self.paintings[style])
        styled = self._task("stylize", "styled", ("styled.npz", "thumbnail.jpg"), key, needs=needs,
                            config=config, style=style, label=style,
                            source=self.jobs.styles[style].painting, skin_key=skin,
                            inputs=inputs)
        found.append(styled)
        for name in self.sitter.displays:
            found.append(self._coded(style, self.jobs.panels[name], styled))
        if self.sitter.pages:
            found.append(self._task("page", "page", ("portrait.html",), graph.page_key(key, config),
                                    needs=(styled.name,), config=config, style=style,
                                    label="portrait.html", inputs=self._styled_file(style)))
        if self.sitter.sweeps:
            # The sweep goes over the cone of the first one.
            names = self.sitter.displays
            display = self.jobs.panels[names[0]].display if names else None
            found.append(self._task(
                "sweep", "sweep", ("sweep.mp4",), graph.sweep_key(key, config, display),
                needs=(styled.name,), config=config, style=style, display=display,
                label="sweep.mp4", inputs=self._styled_file(style)))
        return found

    def _coded(self, style: str, panel: Panel, styled: Task) -> Task:
        config = self.jobs.parameters(self.sitter.name, style, panel.name)
        return self._task("encode", f"display-{panel.name}", (f"{panel.name}.png",),
                          graph.code_key(styled.key, config, panel.display), needs=(styled.name,),
                          config=config, style=style, display=panel.display,
                          label=panel.name, inputs=self._styled_file(style))

    def _path(self, name: str) -> str:
        """A file of the sitter's, relative to the results."""
        return f"{self.sitter.name}/{name}"

    def _styled_file(self, style: str) -> dict[str, str]:
        return {"styled": self._path(f"{style}/styled.npz")}


class Fingerprints:
    """Hash of a sitter's photos, from a file of known ones or computed by their contents."""

    def __init__(self, file: Path, compute: Callable[[Path], str]) -> None:
        self._file, self._compute = file, compute
        self._known: dict[str, str] = {}
        with suppress(OSError, ValueError):
            self._known = dict(json.loads(file.read_text(encoding="utf-8")))

    def __call__(self, source: Path) -> str:
        """The hash of a sitter's photos; `UserError` if one can't be read."""
        try:
            states = [(str(path), file_state(path)) for path in sorted(graph.source_files(source))]
        except OSError as error:
            raise UserError(f"can't read the photos in {source}: {error.strerror}") from error
        key = hash_of(*states)
        if key in self._known:
            return self._known[key]
        found = self._compute(source)
        if all(tells_changes(state) for _, state in states):
            self._known[key] = found
        return found

    def keep(self) -> None:
        """Write what is known."""
        with suppress(UserError):
            write_json(self._file, self._known)


@dataclass
class Batch:
    """A file of jobs made ready: its plan, and what of it is done."""

    # jobs, plan: What is wanted, and the graph of it.
    jobs: Jobs
    plan: Plan[Task]
    results: Path  # Folder of all results.
    done: set[str]  # Names of the tasks that are done.
    failed: dict[str, str] = field(default_factory=dict)  # Why tasks failed, by name.
    # Tasks that can't be done as one before them failed: the name of that one.
    lost: dict[str, str] = field(default_factory=dict)
    costs: Costs = field(default_factory=lambda: Costs(
        {name: stage.need for name, stage in STAGES.items()}))  # What tasks of each stage take.
    prints: Fingerprints | None = None  # Hashes of the photos, to be kept.

    def learn(self, stage: str, figures: dict[str, Any]) -> None:
        """Take the figures of a task that is done into account."""
        if "cost" in figures:
            self.costs.learn(stage, Need.of(figures["cost"]))

    def summary(self) -> dict[str, Any]:
        """The figures for ``--json``: tasks by stage, and their estimated needs."""
        left = self.plan.to_do(self.done)
        stages = {}
        for stage in STAGES:
            every = [task for task in self.plan.tasks.values() if task.stage == stage]
            if every:
                need = self.costs.need(stage)
                count = sum(task.stage == stage for task in left)
                stages[stage] = {"tasks": len(every), "to_do": count,
                                 "core_seconds": round(count * need.seconds, 1),
                                 "memory_bytes": need.memory, "disk_bytes": count * need.disk}
        return {"sitters": len(self.jobs.sitters), "styles": len(self.jobs.styles),
                "displays": len(self.jobs.panels), "tasks": len(self.plan.tasks),
                "to_do": len(left), "stages": stages,
                "core_seconds": round(sum(one["core_seconds"] for one in stages.values()), 1),
                "disk_bytes": sum(one["disk_bytes"] for one in stages.values()),
                "refused": dict(self.plan.refused)}

    def failures(self) -> dict[str, str]:
        """Sitters and tasks that failed, and why."""
        return {**self.plan.refused, **self.failed}

    def jobs_table(self) -> list[dict[str, Any]]:
        """One entry per requested output: its place, or why it is missing."""
        rows = []
        for task in self.plan.wanted():
            row = {"sitter": task.sitter, "style": task.folder.partition("/")[2],
                   "output": task.label, "file": f"{task.folder}/{task.outputs[0]}"}
            if task.name in self.done:
                row["state"] = "done"
            else:
                cause = self.lost.get(task.name, task.name)
                row["state"] = "failed" if cause in self.failed else "waiting"
                row["why"] = self.failed.get(cause, "")
            rows.append(row)
        rows += [{"sitter": name, "style": "", "output": "", "file": "", "state": "failed",
                  "why": why} for name, why in self.plan.refused.items()]
        return rows


def dry_figures(found: Batch) -> dict[str, Any]:
    """Figures of ``--dry-run``: the summary, the graph, and the free space."""
    left = {task.name for task in found.plan.to_do(found.done)}
    return {**found.summary(), "free_disk_bytes": free_disk_bytes(found.results),
            "graph": [{"task": task.name, "stage": task.stage, "needs": list(task.needs),
                       "to_do": task.name in left} for task in found.plan.tasks.values()]}
