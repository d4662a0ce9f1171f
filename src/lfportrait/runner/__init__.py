"""How work is run, whatever it is.

`scheduler`: tasks and what needs what, what work costs, what errors mean, and how each task ends;
`processes` of our own, the one way to talk to them, and tasks in them.
"""

from .processes import CAN_PAUSE, Callbacks, Child, Pipe, Workers, serve
from .scheduler import (
           Costs,
           Failure,
           Here,
           Need,
           Outcome,
           Plan,
           Runner,
           Schedule,
           Task,
           failure_of,
           finished,
           outcome_of,
           run_tasks,
)

__all__ = ["CAN_PAUSE", "Callbacks", "Child", "Costs", "Failure", "Here", "Need", "Outcome", "Pipe",
           "Plan", "Runner", "Schedule", "Task", "Workers", "failure_of", "finished", "outcome_of",
           "run_tasks", "serve"]
