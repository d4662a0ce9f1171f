"""Tasks begin when those that they need are done; one that fails takes those with it."""

import pytest

from lfportrait.errors import UserError
from lfportrait.runner import Here, Task, outcome_of, run_tasks


def tasks(**needs):
    return [Task(name, "stage", "", (), "", tuple(of.split())) for name, of in needs.items()]


PLAN = tasks(a="", b="a", c="b x", d="")


def ran(fails=()):
    """What was heard, in its order, and what was lost."""
    heard = []

    def work(task):
        def do():
            if task.name in fails:
                raise UserError("no light")
            return {"name": task.name}

        return outcome_of(task, do)

    lost = run_tasks(PLAN, Here(work), lambda task, outcome: heard.append(
        (task.name, None if outcome is None else outcome.error or outcome.figures["name"])))
    return heard, lost


def test_the_first_that_can_begin_begins():
    heard, lost = ran()
    assert [name for name, told in heard if told is None] == ["a", "b", "c", "d"]
    assert [told for _, told in heard if told] == ["a", "b", "c", "d"] and lost == {}


def test_what_needs_a_task_that_failed_is_lost_and_the_rest_goes_on():
    heard, lost = ran(fails=("a",))
    assert heard == [("a", None), ("a", "no light"), ("d", None), ("d", "d")]
    assert lost == {"b": "a", "c": "a"}


def test_what_is_raised_here_ends_the_run():
    def work(task):
        raise UserError(task.name)

    with pytest.raises(UserError, match="a"):
        run_tasks(PLAN, Here(work))
