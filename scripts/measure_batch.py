"""Measure batches: against a loop of `make`, on two Ray nodes, with bad sitters, stage by stage.

Modelled heads with seeds are photographed, and portraits of them made.

Run: python scripts/measure_batch.py share OUT
         3 sitters x 3 styles x 2 displays, small: a batch here, on two Ray nodes where Ray is
         installed, and a loop of `lfportrait make`
     python scripts/measure_batch.py failures OUT
         20 sitters, one of them without a face and one with a torn photo
     python scripts/measure_batch.py stages OUT
         one sitter at the demo's full size, one core a task
     python scripts/measure_batch.py graph OUT
         the time that the graph itself takes
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lfportrait.capture import Capture
from lfportrait.demo import demo_exemplar
from lfportrait.files import write_image
from lfportrait.job.batch import BatchConfig, batch
from lfportrait.job.batch.jobs_file import Jobs, Panel, Sitter, Style
from lfportrait.job.batch.plan import Batch, draw_plan
from lfportrait.job.graph import MakeConfig
from lfportrait.lightfield import Display
from lfportrait.runner import Here, Outcome, run_tasks
from modelled_head import random_person, studio_capture

STYLES = ("fauve", "charcoal", "impression")
SMALL = {"reconstruct.resolutions": [24, 48], "reconstruct.rays": [0.12, 0.3],
         "reconstruct.batch": [1024], "reconstruct.sh_degree": 0, "stylize.pixels": 72.0,
         "stylize.fit_iterations": 2, "stylize.steps": 2, "stylize.content_network": "embedded",
         "stylize.style_network": "embedded", "sweep_size": 64}
FULL = {"reconstruct.resolutions": [128, 256], "reconstruct.rays": [1.0, 7.0],
        "stylize.content_network": "embedded", "stylize.style_network": "embedded"}


def studio(folder: Path, sitters: int, size: int, views: int, paintings: int) -> None:
    """Sittings, paintings and displays on the disk."""
    for seed in range(sitters):
        model = random_person(np.random.default_rng(seed))
        studio_capture(size, views, model).save(folder / "sittings" / f"sitter{seed}")
    for style in STYLES:
        exemplar = demo_exemplar(style, width=paintings * 3 // 4, height=paintings)
        write_image(folder / f"{style}.png", exemplar.image)
        (folder / f"{style}.landmarks.txt").write_text(
            "\n".join(f"{x} {y}" for x, y in exemplar.landmarks))
    for number, cone in enumerate((40, 50)):
        Display(192, 128, views=16, pitch=7.3, slant=0.15, cone=cone, quilt=(3, 2),
                quilt_size=(192, 128), name=f"panel{number}").save(folder / f"panel{number}.toml")


def write_jobs(folder: Path, settings: dict[str, Any], styles: tuple[str, ...],
               panels: tuple[str, ...]) -> Path:
    """The file of jobs."""
    lines = ["[defaults]", "sweeps = true",
             *(f"{key} = {json.dumps(value)}" for key, value in settings.items()),
             '[[sitter]]\nphotos = "sittings/*"',
             *(f'[[style]]\npainting = "{style}.png"' for style in styles),
             *(f'[[display]]\nname = "{Path(panel).stem}"\npanel = "{panel}"' for panel in panels)]
    (folder / "jobs.toml").write_text("\n".join(lines) + "\n")
    return folder / "jobs.toml"


def digests(results: Path) -> dict[str, str]:
    """Hashes of all that a batch made, without its own notes, which hold times."""
    return {str(path.relative_to(results)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted(results.rglob("*")) if path.is_file()
            and not any(part.startswith(".") for part in path.relative_to(results).parts)
            and path.name not in ("index.html", "results.json")}


@contextlib.contextmanager
def timed(name: str, figures: dict[str, Any]) -> Iterator[None]:
    """Wall time of a block, and the time on the cores of the processes that it started."""
    def on_cores() -> float:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    start, before = time.perf_counter(), on_cores()
    yield
    figures[name] = {"seconds": round(time.perf_counter() - start, 1),
                     "cpu_seconds": round(on_cores() - before, 1)}
    print(name, figures[name], flush=True)


def program(*words: object) -> None:
    """Run `lfportrait`."""
    subprocess.run([sys.executable, "-m", "lfportrait", *map(str, words)], check=True)


def share(out: Path) -> dict[str, Any]:
    """A batch here, on two Ray nodes, and a loop of `make`, one after the other."""
    studio(out, 3, 96, 16, 240)
    panels = ("panel0.toml", "panel1.toml")
    jobs = write_jobs(out, SMALL, STYLES, panels)
    figures: dict[str, Any] = {}
    # Kernels and whatever else is done once, before the first measurement.
    program("batch", jobs, "--out", out / "warm", "--quiet")
    with timed("local", figures):
        program("batch", jobs, "--out", out / "local", "--quiet")
    options = [word for key, value in SMALL.items() for word in (
        "--" + key.replace("_", "-"), *(value if isinstance(value, list) else [value]))]
    with timed("loop", figures):
        for sitter in sorted((out / "sittings").iterdir()):
            for style in STYLES:
                for panel in panels:
                    program("make", sitter, "--style", out / f"{style}.png", "--display",
                            out / panel, "--out",
                            out / "loop" / f"{sitter.name}-{style}-{Path(panel).stem}",
                            "--quiet", *options)
    ratio = figures["local"]["seconds"] / figures["loop"]["seconds"]
    figures["local_over_loop"] = round(ratio, 3)
    try:
        from ray.cluster_utils import Cluster
    except ImportError:
        print("Ray is not installed: no cluster")
    else:
        import ray

        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
        cluster.add_node(num_cpus=1)
        ray.init(address=cluster.address, log_to_driver=False, logging_level="ERROR")
        start = time.perf_counter()
        batch(jobs, out / "ray", BatchConfig(on="ray"))
        figures["ray"] = {"seconds": round(time.perf_counter() - start, 1)}
        cluster.shutdown()
        figures["ray_same_bytes"] = digests(out / "ray") == digests(out / "local")
    figures["files"] = len(digests(out / "local"))
    return figures


def failures(out: Path) -> dict[str, Any]:
    """Twenty sitters, two of which can't be portrayed; then the same once more."""
    studio(out, 20, 48, 10, 160)
    capture = Capture.load(out / "sittings" / "sitter7")
    shutil.rmtree(out / "sittings" / "sitter7")
    grey = [np.full_like(image, 128) for image in capture.images]
    replace(capture, images=grey, landmarks=None).save(out / "sittings" / "sitter7")
    torn = sorted((out / "sittings" / "sitter12").rglob("view_*.png"))[3]
    torn.write_bytes(torn.read_bytes()[:200])
    small = {**SMALL, "reconstruct.resolutions": [16, 32], "reconstruct.rays": [0.04, 0.08],
             "stylize.pixels": 48.0}
    jobs = write_jobs(out, small, STYLES[:1], ("panel0.toml",))
    figures = batch(jobs, out / "results")
    again = batch(jobs, out / "results")
    return {"failed": figures["failed"], "done": figures["done"], "tasks": figures["tasks"],
            "ran_again": again["ran"], "failed_again": again["failed"]}


def stages(out: Path) -> dict[str, Any]:
    """What each stage costs at the demo's full size."""
    studio(out, 1, 384, 60, 1024)
    jobs = write_jobs(out, FULL, STYLES[:1], ("generic-4k", "generic-8k"))
    batch(jobs, out / "results", BatchConfig(workers=1, cores=1))
    rows = {}
    for line in (out / "results/.batch/journal.jsonl").read_text().splitlines():
        event = json.loads(line)
        if event["event"] == "done":
            rows[event["task"]] = {name: event[name] for name in (
                "cpu_seconds", "seconds", "peak_memory_bytes", "bytes")}
    return rows


def graph(out: Path) -> dict[str, Any]:
    """The time on a core that planning and giving out take, for sitters that are not there."""
    for number in range(3):
        write_image(out / f"{number}.png", np.zeros((8, 8, 3)))
    figures: dict[str, Any] = {}
    panels = {name: Panel(name, Display.preset("generic-4k"), {}) for name in "abc"}
    styles = {name: Style(name, name, {}) for name in "vwxyz"}
    for count in (100, 1000, 10_000):
        sitters = {f"s{number}": Sitter(f"s{number}", out, tuple(styles), tuple(panels), True,
                                        False, 0, {}) for number in range(count)}
        jobs = Jobs(out / "jobs.toml", sitters, styles, panels, MakeConfig())
        start = time.process_time()
        plan = draw_plan(jobs, {name: (name, name) for name in styles}, lambda path: "photos")
        planned = time.process_time()
        found = Batch(jobs, plan, out, set())
        todo = found.plan.to_do(found.plan.done(out))
        looked = time.process_time()
        run_tasks(todo, Here(lambda task: Outcome(task.name)))
        figures[count] = {"tasks": len(todo), "plan_seconds": round(planned - start, 2),
                          "look_seconds": round(looked - planned, 2),
                          "give_out_seconds": round(time.process_time() - looked, 2)}
        print(count, figures[count], flush=True)
    return figures


def main() -> None:
    kinds = {"share": share, "failures": failures, "stages": stages, "graph": graph}
    if len(sys.argv) != 3 or sys.argv[1] not in kinds:
        sys.exit(__doc__)
    out = Path(sys.argv[2])
    out.mkdir(parents=True, exist_ok=True)
    figures = kinds[sys.argv[1]](out)
    (out / "figures.json").write_text(json.dumps(figures, indent=1))
    print(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
