"""Pipeline of steps, each on its own thread, a few items ahead."""

from __future__ import annotations

import queue
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

__all__ = ["ahead", "in_turn"]

Item = TypeVar("Item")
Made = TypeVar("Made")


def ahead(items: Iterator[Item], count: int = 2,
          start: Callable[[], Any] | None = None) -> Iterator[Item]:
    """The same items, made on another thread up to ``count`` of them ahead.

    Parameters
    ----------
    items
        What is taken on that thread; what it raises is raised here.
    count
        How many may wait.
    start
        Called first on that thread.

    Closing this iterator, or leaving a loop over it, ends the thread.
    """
    waiting: queue.Queue[tuple[bool, Any]] = queue.Queue(count)
    closed = threading.Event()

    def put(entry: tuple[bool, Any]) -> bool:
        while not closed.is_set():
            try:
                waiting.put(entry, timeout=0.1)
                return True
            except queue.Full:
                continue
        return False

    def work() -> None:
        try:
            if start is not None:
                start()
            for item in items:
                if not put((True, item)):
                    break
            else:
                put((False, None))
        except BaseException as error:
            put((False, error))
        finally:
            close = getattr(items, "close", None)
            if close is not None:
                close()

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        while True:
            more, item = waiting.get()
            if not more:
                if item is not None:
                    raise item
                return
            yield item
    finally:
        closed.set()
        thread.join()


def in_turn(make: Callable[[Item], Made], items: Iterator[Item], threads: int,
            start: Callable[[], Any] | None = None) -> Iterator[Made]:
    """What ``make`` makes of the items, in their order, made on several threads.

    As many items again as there are threads may wait to be taken. ``start`` is called first on each
    thread.
    """
    with ThreadPoolExecutor(threads, initializer=start) as pool:
        under_way: deque[Future[Made]] = deque()
        try:
            for item in items:
                under_way.append(pool.submit(make, item))
                if len(under_way) > threads:
                    yield under_way.popleft().result()
            while under_way:
                yield under_way.popleft().result()
        finally:
            for future in under_way:
                future.cancel()
            close = getattr(items, "close", None)
            if close is not None:
                close()
