"""Questions to the process that keeps heads in memory, asked one after the other.

It is started with the first question, and again where it was ended from outside. A newer question
of the same slot takes the place of an older one that waits: of a landmark that is dragged only the
last place counts. What somebody changes at this moment goes before what a page has just opened, and
that before the pictures of a gallery. A question whose page has gone is not asked any more.
"""

import asyncio
import contextlib
import itertools
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any

from ..models import OFFLINE
from ..runner import Callbacks, Child, Failure, Outcome, Schedule, Task, Workers
from .answers import Events, Refusal

_MOST = 64  # Questions of one turn that wait.


class Turn(IntEnum):
    """Which questions go first."""

    NOW = 0
    """What somebody changes at this moment and looks at: a landmark, a slider."""
    NEXT = 1
    """What a page needs to go on."""
    LATER = 2
    """Pictures that fill a gallery."""


_LOST = Failure("preview_lost", "the preview's process was ended from outside, as it happens where "
                "memory is short; it starts again with the next preview")


@dataclass(eq=False)
class _Question:
    name: str
    facts: dict[str, Any]
    slot: str
    turn: Turn
    answer: asyncio.Future[Any] = field(repr=False)
    waits: bool = True


class Previews:
    """The resident process of a studio; ``events`` hear when it was lost."""

    def __init__(self, log: Path, events: Events) -> None:
        self._log, self._events = log, events
        self._questions: dict[str, _Question] = {}
        self._numbers = itertools.count(1)
        self._child: Child | None = None
        self._loop: asyncio.AbstractEventLoop | None = None  # from the first question on
        self._runner = Workers[Task](
            1, self._process, lambda task: self._asked(task.name), _LOST,
            callbacks=Callbacks(wake=self._wake, read=lambda error: Failure(
                "preview_lost", f"the preview failed: {error}; try again")))
        self._schedule = Schedule(self._runner, self._heard)

    @property
    def process(self) -> int:
        """Number of the process, 0 where there is none."""
        return self._child.number if self._child is not None and self._child.alive else 0

    @property
    def busy(self) -> bool:
        """Whether questions are being answered."""
        return len(self._schedule) > 0

    async def ask(self, name: str, facts: dict[str, Any], slot: str = "", turn: Turn | None = None,
                  gone: Callable[[], Awaitable[None]] | None = None) -> Any:
        """The answer to a question, its name and facts (`lfportrait.studio.work.resident`).

        A newer question of the same ``slot`` takes its place, as long as it waits. By default it is
        asked at once with a slot, else next. ``gone`` returns when nobody waits for the answer any
        more: a question that still waits is then dropped, one that is being answered is not. Raises
        `Refusal` if it can't be answered, or was dropped.
        """
        if turn is None:
            turn = Turn.NOW if slot else Turn.NEXT
        if slot:
            for number, old in list(self._questions.items()):
                if old.slot == slot:
                    self._drop(number, "a newer preview was asked for")
        if sum(one.waits and one.turn == turn for one in self._questions.values()) >= _MOST:
            raise Refusal("busy", "too many previews wait; try again in a moment")
        self._loop = asyncio.get_running_loop()
        number, answer = str(next(self._numbers)), self._loop.create_future()
        self._questions[number] = _Question(name, facts, slot, turn, answer)
        self._schedule.add(Task(number, name, "", (), "", ()), turn)
        self._schedule.give()
        watch = None if gone is None else asyncio.ensure_future(self._watched(number, gone))
        try:
            return await answer
        finally:
            self._drop(number, "")  # its request was cancelled
            if watch is not None:
                watch.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await watch

    async def _watched(self, number: str, gone: Callable[[], Awaitable[None]]) -> None:
        """Drop a question when nobody waits for its answer."""
        await gone()
        self._drop(number, "the page that asked has gone")

    def _drop(self, number: str, why: str) -> None:
        """Do not ask a question that still waits."""
        if number in self._questions and self._questions[number].waits:
            self._schedule.end(Outcome.failed(number, Failure("busy", why)))

    def _process(self, _: Task) -> Child:
        self._child = Child("lfportrait.studio.work.resident:serve", self._log, {OFFLINE: "1"},
                            group=True)
        return self._child

    def _asked(self, number: str) -> tuple[str, dict[str, Any]]:
        return self._questions[number].name, self._questions[number].facts

    def _wake(self) -> None:
        """Take in what the process says, in the server's loop."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # it has ended
                self._loop.call_soon_threadsafe(self._schedule.step)

    def _heard(self, task: Task, outcome: Outcome | None) -> None:
        if outcome is None:
            self._questions[task.name].waits = False
            return
        answer = self._questions.pop(task.name).answer
        if outcome.error == _LOST.message:
            self._events.tell("notice", {"code": _LOST.code, "message": _LOST.message})
        if answer.done():
            return
        if outcome.code:
            answer.set_exception(Refusal(outcome.code, outcome.error))
        else:
            answer.set_result(outcome.figures)

    async def close(self) -> None:
        """End the process."""
        for number in list(self._questions):
            self._schedule.end(Outcome.failed(number, Failure("preview_lost", "the studio ends")))
        await asyncio.to_thread(self._runner.close)
