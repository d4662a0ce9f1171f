"""Questions to the process that keeps heads in memory, asked one after the other.

It is started with the first question, and again where it was ended from outside. A newer question
of the same slot takes the place of an older one that waits: of a landmark that is dragged only the
last place counts. What somebody changes at this moment goes before what a page has just opened, and
that before the pictures of a gallery. A question whose page has gone is not asked any more.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any

from .answers import Refusal
from .events import Child, Events

_MOST = 64
"""Questions of one turn that wait."""


class Turn(IntEnum):
    """Which questions go first."""

    NOW = 0
    """What somebody changes at this moment and looks at: a landmark, a slider."""
    NEXT = 1
    """What a page needs to go on."""
    LATER = 2
    """Pictures that fill a gallery."""


@dataclass(eq=False)
class _Question:
    number: int
    name: str
    facts: dict[str, Any]
    slot: str
    turn: Turn
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
        self._waiting: list[_Question] = []
        self._numbers = itertools.count(1)
        self._child: Child | None = None
        self._task: asyncio.Task[None] | None = None

    @property
    def process(self) -> int:
        """Number of the process, 0 where there is none."""
        return self._child.number if self._child is not None and self._child.alive else 0

    @property
    def busy(self) -> bool:
        """Whether questions are being answered."""
        return self._task is not None and not self._task.done()

    async def ask(self, name: str, facts: dict[str, Any], slot: str = "",
                  turn: Turn | None = None,
                  gone: Callable[[], Awaitable[None]] | None = None) -> Any:
        """The answer to a question (`lfportrait.studio.work.resident`).

        Parameters
        ----------
        name, facts
            The question.
        slot
            A newer question of the same slot takes its place, as long as it waits.
        turn
            When it is asked; by default at once with a slot, else next.
        gone
            Returns when nobody waits for the answer any more: a question that still waits is then
            dropped. One that is being answered is answered to its end.

        Raises
        ------
        Refusal
            If it can't be answered, nobody waits for it, or a newer one of the same slot came.
        """
        if turn is None:
            turn = Turn.NOW if slot else Turn.NEXT
        if slot:
            for old in [one for one in self._waiting if one.slot == slot]:
                self._drop(old, "a newer preview was asked for")
        if sum(one.turn == turn for one in self._waiting) >= _MOST:
            raise Refusal("busy", "too many previews wait; try again in a moment")
        question = _Question(next(self._numbers), name, facts, slot, turn,
                             asyncio.get_running_loop().create_future())
        self._waiting.append(question)
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._work())
        watch = None if gone is None else asyncio.ensure_future(self._watched(question, gone))
        try:
            return await question.answer
        finally:
            if watch is not None:
                watch.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await watch

    async def _watched(self, question: _Question, gone: Callable[[], Awaitable[None]]) -> None:
        """Drop a question when nobody waits for its answer."""
        await gone()
        self._drop(question, "the page that asked has gone")

    def _drop(self, question: _Question, why: str) -> None:
        """Do not ask a question that still waits."""
        if question in self._waiting:
            self._waiting.remove(question)
            _refuse(question, Refusal("busy", why))

    async def _work(self) -> None:
        """Ask what waits, one after the other."""
        while self._waiting:
            question = min(self._waiting, key=lambda one: (one.turn, one.number))
            self._waiting.remove(question)
            if question.answer.done():  # its request was cancelled
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
            if self._child is not None:
                await self._child.end()
            self._child = Child("lfportrait.studio.work.resident:serve", self._log)
        await self._child.tell((question.number, question.name, question.facts))
        message = await self._child.hear()
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
