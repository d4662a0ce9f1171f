"""Questions to the process that keeps heads in memory, asked one after the other.

It is started with the first question, and again where it was ended from outside. A newer question
of the same slot takes the place of an older one that waits: of a landmark that is dragged only the
last place counts.
"""

from __future__ import annotations

import asyncio
import itertools
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .answers import Refusal
from .child import Child
from .events import Events

__all__ = ["Previews"]

_MOST = 64
"""Questions that wait."""


@dataclass
class _Question:
    number: int
    name: str
    facts: dict[str, Any]
    slot: str
    answer: asyncio.Future[Any] = field(repr=False)


class Previews:
    """The resident process of a studio.

    Parameters
    ----------
    log
        File for what it prints.
    events
        Told when it was lost.
    """

    def __init__(self, log: Path, events: Events) -> None:
        self._log, self._events = log, events
        self._waiting: deque[_Question] = deque()
        self._numbers = itertools.count(1)
        self._child: Child | None = None
        self._task: asyncio.Task[None] | None = None

    @property
    def process(self) -> int:
        """Number of the process, 0 where there is none."""
        return self._child.number if self._child is not None else 0

    @property
    def busy(self) -> bool:
        """Whether questions are being answered."""
        return self._task is not None and not self._task.done()

    async def ask(self, name: str, facts: dict[str, Any], slot: str = "") -> Any:
        """The answer to a question (`lfportrait.studio.work.resident`).

        Raises
        ------
        Refusal
            If it can't be answered, or a newer one of the same slot came.
        """
        if slot:
            for old in [one for one in self._waiting if one.slot == slot]:
                self._waiting.remove(old)
                _refuse(old, Refusal("busy", "a newer preview was asked for"))
        if len(self._waiting) >= _MOST:
            raise Refusal("busy", "too many previews wait; try again in a moment")
        question = _Question(next(self._numbers), name, facts, slot,
                             asyncio.get_running_loop().create_future())
        self._waiting.append(question)
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._work())
        return await question.answer

    async def _work(self) -> None:
        """Ask what waits, one after the other."""
        while self._waiting:
            question = self._waiting.popleft()
            if question.answer.done():  # the page has gone
                continue
            try:
                await self._asked(question)
            except Refusal as refusal:
                _refuse(question, refusal)
            except Exception as error:
                _refuse(question, Refusal("preview_lost", f"the preview failed: {error}; try "
                                          "again"))

    async def _asked(self, question: _Question) -> None:
        if self._child is None or not self._child.alive:
            self._child = Child("lfportrait.studio.work.resident:serve", self._log)
            await self._child.start()
        await self._child.send((question.number, question.name, question.facts))
        message = await self._child.receive()
        if message is None:
            text = ("the preview's process was ended from outside, as it happens where memory is "
                    "short; it starts again with the next preview")
            self._events.tell("notice", {"code": "preview_lost", "message": text})
            raise Refusal("preview_lost", text)
        _, code, found = message
        if code != "ok":
            raise Refusal(code, found)
        if not question.answer.done():
            question.answer.set_result(found)

    async def close(self) -> None:
        """End the process."""
        for question in self._waiting:
            _refuse(question, Refusal("preview_lost", "the studio ends"))
        self._waiting.clear()
        if self._child is not None:
            await self._child.end()
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)


def _refuse(question: _Question, refusal: Refusal) -> None:
    if not question.answer.done():
        question.answer.set_exception(refusal)
