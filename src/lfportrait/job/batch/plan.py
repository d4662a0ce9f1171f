r"""The graph of a batch: which stages there are, what each reads and writes, and their keys.

::

    anna/capture -> anna/field -> anna/skin -> anna/ken/styled -> anna/ken/desk
                         |                \                   \-> anna/ken/page
                         |                 \-> anna/chalk/styled -> ...

A sitter has one capture, one field and one skin for all styles; a sitter in a style one styled
field for all displays. The keys are those of `lfportrait make` (`lfportrait.job.steps`), so a
changed style redoes what depends on it and nothing else. What is wanted in the end are the tasks
that nothing else needs; a task before them is only done if one of them is not there yet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...cache import key_of
from ...errors import UserError
from ...lightfield import Display, EncodeConfig
from ...measure import usable_cores
from ...stages import finished_record
from ..steps import (
    MakeConfig,
    capture_key,
    code_key,
    field_key,
    fitted,
    look_at,
    source_key,
    style_key,
)
from .jobs_file import Jobs, Panel, Sitter

__all__ = ["STAGES", "Plan", "Task", "draw_plan", "finished"]

STAGES = ("capture", "field", "skin", "stylize", "encode", "page", "sweep")
"""In the order of the work."""


@dataclass(frozen=True)
class Task:
    """One stage of one portrait: files in, files out.

    Attributes
    ----------
    name
        ``SITTER/STAGE`` or ``SITTER/STYLE/STAGE``.
    stage
        One of `STAGES`.
    folder
        Where it writes, relative to the results.
    outputs
        What it writes there.
    key
        Hash of all that the outputs depend on.
    needs
        Names of the tasks whose outputs it reads.
    config, seed
        Parameters.
    source
        What it reads that no task makes: photos, painting.
    display
        What is coded for; the sweep's angle is its, too.
    skin_key
        Key of the skin that is painted; empty where none is.
    label
        What the file calls it: style, display, file name.
    """

    name: str
    stage: str
    folder: str
    outputs: tuple[str, ...]
    key: str
    needs: tuple[str, ...]
    config: MakeConfig
    seed: int
    source: str = ""
    display: Display | None = None
    skin_key: str = ""
    label: str = ""

    @property
    def record(self) -> str:
        """Name of its record in the folder."""
        return self.name.rpartition("/")[2]

    @property
    def sitter(self) -> str:
        """Whose portrait it is."""
        return self.name.partition("/")[0]


@dataclass
class Plan:
    """The tasks of a batch, each after those that it needs.

    Attributes
    ----------
    tasks
        By name.
    refused
        Sitters whose photos can't be used at all, and why.
    """

    tasks: dict[str, Task] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)

    def wanted(self) -> list[Task]:
        """The tasks that nothing else needs: what the user gets."""
        needed = {need for task in self.tasks.values() for need in task.needs}
        return [task for task in self.tasks.values() if task.name not in needed]

    def before(self, names: Iterable[str]) -> set[str]:
        """These tasks and all that they need."""
        found: set[str] = set()
        left = list(names)
        while left:
            name = left.pop()
            if name not in found:
                found.add(name)
                left += self.tasks[name].needs
        return found

    def done(self, results: Path) -> set[str]:
        """Names of the tasks that were done before, from the same inputs."""
        return {name for name, task in self.tasks.items() if finished(task, results) is not None}

    def to_do(self, done: set[str]) -> list[Task]:
        """The tasks that are left, where these are done: what leads to something missing."""
        lacking: set[str] = set()
        left = [task.name for task in self.wanted() if task.name not in done]
        while left:
            name = left.pop()
            if name not in lacking:
                lacking.add(name)
                left += [need for need in self.tasks[name].needs if need not in done]
        return [task for name, task in self.tasks.items() if name in lacking]


def finished(task: Task, results: Path) -> dict[str, Any] | None:
    """The figures of a task whose outputs are there, made from the same inputs; else None."""
    return finished_record(results / task.folder, task.record, task.key, task.outputs)


def draw_plan(jobs: Jobs, paintings: dict[str, tuple[str, str]],
              fingerprint: Callable[[Path], str] = source_key) -> Plan:
    """The graph of the jobs of a file.

    Parameters
    ----------
    jobs
        What is wanted.
    paintings
        Hashes of the paintings (`painting_key`) by the names of the styles.
    fingerprint
        Hash of a sitter's photos; raises `UserError` where they can't be read.
    """
    def look(sitter: Sitter) -> str | UserError:
        try:
            look_at(sitter.source)
            return fingerprint(sitter.source)
        except UserError as error:
            return error

    plan = Plan()
    # Hashing waits for the disk and does without Python's lock.
    with ThreadPoolExecutor(min(8, usable_cores())) as threads:
        for sitter, source in zip(jobs.sitters.values(), threads.map(look, jobs.sitters.values())):
            if isinstance(source, UserError):
                plan.refused[sitter.name] = str(source)
                continue
            for task in _Portraits(jobs, sitter, paintings, source).tasks():
                plan.tasks[task.name] = task
    return plan


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
        key = capture_key(self.source, config, self.sitter.seed)
        capture = self._task("capture", "capture", ("capture", "photo.jpg"), key, needs=(),
                             config=config, source=str(self.sitter.source))
        config = fitted(config, self._shown())
        key = field_key(key, config)
        field = self._task("field", "field", ("field.npz",), key, needs=(capture.name,),
                           config=config)
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
        skin = ""
        if config.stylize.on_skin:
            # Skins of unlike resolution have files of their own.
            pixels = config.stylize.pixels
            file = f"skin-{pixels:g}"
            skin = key_of("example.skin.sitter", field.key, pixels)
            found.append(self._task("skin", file, (f"{file}.npz",), skin, needs=needs,
                                    config=config))
            needs = (*needs, found[0].name)
        key = style_key(field.key, config, self.paintings[style])
        styled = self._task("stylize", "styled", ("styled.npz", "thumbnail.jpg"), key, needs=needs,
                            config=config, style=style, label=style,
                            source=self.jobs.styles[style].painting, skin_key=skin)
        found.append(styled)
        for name in self.sitter.displays:
            found.append(self._coded(style, self.jobs.panels[name], styled))
        if self.sitter.pages:
            found.append(self._task("page", "page", ("portrait.html",),
                                    key_of("share.page", key, config.page), needs=(styled.name,),
                                    config=config, style=style, label="portrait.html"))
        if self.sitter.sweeps:
            display = self._first_display()
            found.append(self._task(
                "sweep", "sweep", ("sweep.mp4",),
                key_of(("share.video", "field.grid"), key, config.sweep_size,
                       display and display.cone, config.encode.background),
                needs=(styled.name,), config=config, style=style, display=display,
                label="sweep.mp4"))
        return found

    def _coded(self, style: str, panel: Panel, styled: Task) -> Task:
        config = self.jobs.parameters(self.sitter.name, style, panel.name)
        return self._task("encode", f"display-{panel.name}", (f"{panel.name}.png",),
                          code_key(styled.key, config, panel.display), needs=(styled.name,),
                          config=config, style=style, display=panel.display,
                          label=panel.name)

    def _first_display(self) -> Display | None:
        """The display whose cone the sweep goes over."""
        names = self.sitter.displays
        return self.jobs.panels[names[0]].display if names else None
