"""How a job's process says how far it is: stages, progress, notes, pictures.

The messages, each a tuple: ``("stages", [(name, seconds)])``, ``("begin", stage)``,
``("progress", stage, share, note)``, ``("note", text)``, ``("picture", stage)``,
``("page", stage)``,
``("done", stage, seconds)``, ``("skipped", stage)``, ``("end", result)``, and
``("failed", code, text)``.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...arrays import UInt8
from ...field import VoxelField
from ...files import write_image
from ...job import STAGES, Tools
from ...progress import Progress
from ...share import PageConfig, write_page
from ...simd.host import watched_compilations

_SIZE = 2.0
"""Of a page in MB, at most."""
_EVERY = 0.25
"""Seconds between two messages of progress at least."""
_SHOWN = 3.0
"""Seconds between two intermediate pictures at least; or ten times what one takes."""


@dataclass
class Teller:
    """What a job tells the server.

    Attributes
    ----------
    tell
        Sends a message.
    pictures
        Folder for the stages' pictures.
    """

    tell: Callable[..., None]
    pictures: Path

    def picture(self, stage: str, image: UInt8) -> None:
        """A stage's picture, uint8 [H, W, 3]."""
        self.pictures.mkdir(parents=True, exist_ok=True)
        write_image(self.pictures / f"{stage}.jpg", image, quality=88)
        self.tell("picture", stage)

    def page(self, stage: str, field: VoxelField) -> None:
        """A page that turns the head as far as a stage has made it."""
        self.pictures.mkdir(parents=True, exist_ok=True)
        write_page(field, self.pictures / f"{stage}.html", PageConfig(sh=0, max_size=_SIZE))
        self.tell("page", stage)

    @contextmanager
    def stage(self, name: str, draw: Callable[[Any], UInt8] | None = None,
              ) -> Iterator[Progress]:
        """A stage of the work, with its progress, its warnings and its time.

        Parameters
        ----------
        name
            Of the stage.
        draw
            Draws an intermediate result.
        """
        begun = time.perf_counter()
        self.tell("begin", name)
        progress = Told(self, name, draw)

        def compiled(_: str) -> None:
            progress.compiled += 1
            progress.update(progress.done, f"compiling kernels, once: {progress.compiled}")

        with warnings.catch_warnings(), watched_compilations(compiled):
            warnings.simplefilter("ignore")
            warnings.filterwarnings("always", category=UserWarning, module=r"lfportrait\w*\.")
            warnings.showwarning = lambda message, *_, **__: self.tell(
                "note", " ".join(str(message).split()))
            yield progress
        self.tell("done", name, round(time.perf_counter() - begun, 3))

    def tools(self, stage: str, draw: Callable[[Any], UInt8] | None = None,
              **more: Any) -> Tools:
        """Tools whose progress is a stage's (`lfportrait.job.do_stage`)."""
        teller = self

        class Own(Tools):
            @contextmanager
            def progress(self, name: str) -> Iterator[Progress]:
                with teller.stage(stage, draw) as progress:
                    if self.warmup is not None:
                        self.warmup.wait(STAGES[name].kernels, progress)
                    yield progress

        return Own(shown=True, **more)


class Told(Progress):
    """Progress that goes to the server."""

    def __init__(self, teller: Teller, stage: str,
                 draw: Callable[[Any], UInt8] | None = None) -> None:
        super().__init__(stage, enabled=False)
        self.compiled = 0
        self._teller, self._stage, self._draw = teller, stage, draw
        self._last = -1e9
        self._shown, self._took = time.perf_counter(), 0.0

    def update(self, done: int, note: str = "") -> None:
        """Tell how much is done."""
        self.done = done
        if self._due(note, _EVERY):
            share = min(1.0, done / self.total) if self.total else None
            self._teller.tell("progress", self._stage, share, note)

    def say(self, line: str) -> None:
        """Tell a line that stays."""
        self._teller.tell("note", line)

    def show(self, make: Callable[[], object], *, at_once: bool = False) -> None:
        """Draw an intermediate result now and then, or at once."""
        now = time.perf_counter()
        soon = now - self._shown < max(_SHOWN, 10 * self._took)
        if self._draw is None or (soon and not at_once):
            return
        self._teller.picture(self._stage, self._draw(make()))
        self._shown = time.perf_counter()
        self._took = self._shown - now

    def close(self, note: str = "") -> None:
        """Nothing is written at the end."""
