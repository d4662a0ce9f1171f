"""Tasks of a batch in this process."""

from collections.abc import Iterator
from contextlib import contextmanager

import numba
import torch

from lfportrait.job.batch.driver import do_task


@contextmanager
def single_thread() -> Iterator[None]:
    """As many threads as a worker has: torch adds up in another order with more of them."""
    before = numba.get_num_threads(), torch.get_num_threads()
    numba.set_num_threads(1)
    torch.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before[0])
        torch.set_num_threads(before[1])


class Inline:
    """A runner without processes: tasks are done when they are waited for."""

    slots = 1

    def __init__(self, results, *_):
        self.results, self.task = results, None

    def fits(self, memory):
        return self.task is None

    def start(self, task, memory):
        self.task = task

    def wait(self, seconds):
        task, self.task = self.task, None
        return [do_task(task, self.results)]

    def close(self):
        pass
