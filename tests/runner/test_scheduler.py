"""Tasks begin when those that they need are done; one that fails takes those with it."""

import pytest

from lfportrait.errors import UserError
from lfportrait.runner import Here, Outcome, Schedule, Task, outcome_of, run_tasks


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


class Room:
    """A runner that says when tasks end."""

    def __init__(self, slots=9):
        self.slots, self.running, self.ended = slots, [], []

    def fits(self, memory):
        return len(self.running) < self.slots

    def start(self, task, memory):
        self.running.append(task.name)

    def wait(self, seconds):
        ended, self.ended = self.ended, []
        self.running = [name for name in self.running if name not in {one.task for one in ended}]
        return ended


def scheduled(room, **more):
    """A schedule, what it told, and a call that ends tasks."""
    heard = []
    schedule = Schedule(room, lambda task, outcome: heard.append(
        (task.name, None if outcome is None else outcome.error or "done")), **more)

    def end(**errors):
        room.ended += [Outcome(name, error) for name, error in errors.items()]
        schedule.step()

    return schedule, heard, end


def test_a_task_that_comes_later_may_go_first():
    room = Room(1)
    schedule, _, end = scheduled(room)
    for task, place in zip(tasks(a="", b="", c="", d=""), (1, 2, 3, 0), strict=True):
        schedule.add(task, place)
        schedule.give()
    assert room.running == ["a"]
    schedule.move("c", 1)
    began = []
    while len(schedule):
        began += room.running
        end(**dict.fromkeys(room.running, ""))
    assert began == ["a", "d", "c", "b"]


def test_lanes_do_not_hold_each_other_up():
    room = Room()
    schedule, _, end = scheduled(room, lane=lambda task: task.name[0],
                                 at_once={"h": 1, "l": 2})
    for task in tasks(h1="", h2="", l1="", l2="", l3=""):
        schedule.add(task)
    schedule.give()
    assert room.running == ["h1", "l1", "l2"]
    end(l1="", h1="")
    assert room.running == ["l2", "h2", "l3"]


def test_a_task_that_is_given_up_waits_no_more():
    room = Room(1)
    schedule, heard, end = scheduled(room)
    for task in tasks(a="", b="", c="a"):
        schedule.add(task)
    schedule.give()
    schedule.end(Outcome("b", "given up"))
    schedule.end(Outcome("c", "given up"))
    end(a="")
    assert heard == [("a", None), ("b", "given up"), ("c", "given up"), ("a", "done")]
    assert "b" not in schedule and len(schedule) == 0 and room.running == []


def test_what_is_lost_may_come_again_without_its_needs():
    room, lost = Room(), []

    def lose(task, cause):
        lost.append((task.name, cause))
        if task.name == "b":
            schedule.add(Task("b", "stage", "", (), "", ()))

    schedule, heard, end = scheduled(room, lost=lose)
    for task in tasks(a="", b="a", c="b"):
        schedule.add(task)
    schedule.give()
    end(a="no light")
    assert lost == [("b", "a"), ("c", "a")] and room.running == ["b"]
    assert heard == [("a", None), ("a", "no light"), ("b", None)]


def test_a_task_that_comes_again_waits_for_its_new_needs_alone():
    room, lost = Room(), []
    schedule, _, end = scheduled(room, lost=lambda task, cause: lost.append(task.name))
    for task in tasks(a="", b="", c="a"):
        schedule.add(task)
    schedule.give()
    schedule.end(Outcome("c", "given up"))
    schedule.add(tasks(c="b")[0])
    end(a="no light")
    assert lost == [] and "c" in schedule and room.running == ["b"]
    end(b="")
    assert room.running == ["c"]
