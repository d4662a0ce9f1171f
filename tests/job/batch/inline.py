"""Tasks of a batch in this process."""

from lfportrait.job.batch.runners import do_task


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
