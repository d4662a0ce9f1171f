"""State of a batch: its plan, finished and failed tasks, and its summary for the user."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...measure import free_disk_bytes
from ...runner import Costs, Need, Plan
from ..graph import STAGES, Task
from .fingerprints import Fingerprints
from .jobs_file import Jobs

__all__ = ["Batch", "dry_figures"]


@dataclass
class Batch:
    """A file of jobs made ready: its plan, and what of it is done.

    Attributes
    ----------
    jobs, plan
        What is wanted, and the graph of it.
    results
        Folder of all results.
    done
        Names of the tasks that are done.
    failed
        Why tasks failed, by name.
    lost
        Tasks that can't be done as one before them failed: the name of that one.
    costs
        What tasks of each stage take.
    prints
        Hashes of the photos, to be kept.
    """

    jobs: Jobs
    plan: Plan[Task]
    results: Path
    done: set[str]
    failed: dict[str, str] = field(default_factory=dict)
    lost: dict[str, str] = field(default_factory=dict)
    costs: Costs = field(default_factory=lambda: Costs(
        {name: stage.need for name, stage in STAGES.items()}))
    prints: Fingerprints | None = None

    def learn(self, stage: str, figures: dict[str, Any]) -> None:
        """Take the figures of a task that is done into account."""
        if "cost" in figures:
            self.costs.learn(stage, Need.of(figures["cost"]))

    def summary(self) -> dict[str, Any]:
        """The figures for ``--json``: tasks by stage, and their estimated needs."""
        left = self.plan.to_do(self.done)
        stages = {}
        for stage in STAGES:
            every = [task for task in self.plan.tasks.values() if task.stage == stage]
            if every:
                need = self.costs.need(stage)
                count = sum(task.stage == stage for task in left)
                stages[stage] = {"tasks": len(every), "to_do": count,
                                 "core_seconds": round(count * need.seconds, 1),
                                 "memory_bytes": need.memory, "disk_bytes": count * need.disk}
        return {"sitters": len(self.jobs.sitters), "styles": len(self.jobs.styles),
                "displays": len(self.jobs.panels), "tasks": len(self.plan.tasks),
                "to_do": len(left), "stages": stages,
                "core_seconds": round(sum(one["core_seconds"] for one in stages.values()), 1),
                "disk_bytes": sum(one["disk_bytes"] for one in stages.values()),
                "refused": dict(self.plan.refused)}

    def failures(self) -> dict[str, str]:
        """Sitters and tasks that failed, and why."""
        return {**self.plan.refused, **self.failed}

    def jobs_table(self) -> list[dict[str, Any]]:
        """One entry per requested output: its place, or why it is missing."""
        rows = []
        for task in self.plan.wanted():
            row = {"sitter": task.sitter, "style": task.folder.partition("/")[2],
                   "output": task.label, "file": f"{task.folder}/{task.outputs[0]}"}
            if task.name in self.done:
                row["state"] = "done"
            else:
                cause = self.lost.get(task.name, task.name)
                row["state"] = "failed" if cause in self.failed else "waiting"
                row["why"] = self.failed.get(cause, "")
            rows.append(row)
        rows += [{"sitter": name, "style": "", "output": "", "file": "", "state": "failed",
                  "why": why} for name, why in self.plan.refused.items()]
        return rows


def dry_figures(found: Batch) -> dict[str, Any]:
    """Figures of ``--dry-run``: the summary, the graph, and the free space."""
    left = {task.name for task in found.plan.to_do(found.done)}
    return {**found.summary(), "free_disk_bytes": free_disk_bytes(found.results),
            "graph": [{"task": task.name, "stage": task.stage, "needs": list(task.needs),
                       "to_do": task.name in left} for task in found.plan.tasks.values()]}
