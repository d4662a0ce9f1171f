"""How work is run, whatever it is.

`graph`: tasks and what needs what; `scheduler` has them run and takes in how each ended;
`processes` of our own and the one way to talk to them; `costs`, learnt from what work took;
`failures`: errors, read for the user.
"""

from .processes import CAN_PAUSE, Child, Pipe
from .scheduler import (
           Costs,
           Failure,
           Here,
           Need,
           Outcome,
           Plan,
           Runner,
           Task,
           failure_of,
           finished,
           outcome_of,
           run_tasks,
)

__all__ = ["CAN_PAUSE", "Child", "Costs", "Failure", "Here", "Need", "Outcome", "Pipe",
           "Plan", "Runner", "Task", "failure_of", "finished", "outcome_of", "run_tasks"]
