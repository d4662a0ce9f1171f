"""Checkpoints of a reconstruction, to resume it."""

from __future__ import annotations

import time
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ...arrays import Float32, Float64, Int32, UInt8
from ...capture import Capture
from ...files import UNREADABLE_ARRAYS, atomic_write
from ..background import Background, BackgroundTrainer
from ..config import Settings
from .lattice import Average, Lattice
from .pixels import Batches
from .poses import PoseRefiner


class State(Protocol):
    """The state of a running reconstruction (`Trainer`) that a checkpoint keeps."""

    key: str
    capture: Capture
    config: Settings
    level: int
    step: int
    rays_done: int
    began: float
    level_done: float
    lattice: Lattice | None
    gains: Float64
    test_gains: Float64
    recent: Float64
    average: Average | None
    table: Int32 | None
    laid: UInt8 | None
    poses: PoseRefiner | None
    background: Background | None
    behind: BackgroundTrainer | None
    batches: Batches | None

    def place(self, capture: Capture) -> None:
        """Go on with other cameras of the same photos."""

    def lay_mattes(self, mattes: list[UInt8]) -> None:
        """Go on with other mattes."""

    def background_trainer(self, mean_square: Float32 | None = None) -> BackgroundTrainer | None:
        """What trains the background."""

    def new_batches(self) -> Batches:
        """The order of the level's rays."""


def deflated(mattes: list[UInt8]) -> UInt8:
    """Mattes as they are kept: a hundredth of their size."""
    return np.frombuffer(zlib.compress(b"".join(map(np.ndarray.tobytes, mattes)), 1), np.uint8)


def _inflated(data: UInt8, like: Sequence[UInt8]) -> list[UInt8]:
    """The mattes again; ``like`` has their shapes."""
    flat = np.frombuffer(zlib.decompress(data.tobytes()), np.uint8)
    ends = np.cumsum([matte.size for matte in like])
    return [part.reshape(matte.shape)
            for part, matte in zip(np.split(flat, ends[:-1]), like, strict=True)]


def write_checkpoint(trainer: State, path: Path) -> None:
    """Write the state that the rest of the training depends on."""
    lattice = trainer.lattice
    assert lattice is not None
    state: dict[str, Any] = {
        "key": trainer.key,
        "counts": np.array([trainer.level, trainer.step, trainer.rays_done]),
        "elapsed": time.perf_counter() - trainer.began, "links": lattice.links,
        "density": lattice.density, "rows": lattice.rows, "center": lattice.center,
        "radius": lattice.radius, "gains": trainer.gains, "test_gains": trainer.test_gains,
        "recent": trainer.recent,
        "rates": np.array([trainer.level_done, trainer.config.lr_sigma])}
    if trainer.poses is not None:
        state.update(trainer.poses.state())
    if trainer.background is not None:
        state["background_links"] = trainer.background.links
        state["background_data"] = trainer.background.data
        if trainer.behind is not None:
            state["background_mean_square"] = trainer.behind.mean_square
    if trainer.batches is not None:
        state |= trainer.batches.state
    if trainer.average is not None:
        state |= trainer.average.state
    if trainer.laid is not None:
        state["mattes"] = trainer.laid
    if trainer.table is not None:
        state["table"] = trainer.table
    with atomic_write(path) as stream:
        np.savez(stream, **state)


def read_checkpoint(trainer: State, path: Path) -> None:
    """Load a checkpoint of the same capture and parameters; others are ignored."""
    try:
        with np.load(path, allow_pickle=False) as data:
            if str(data["key"]) != trainer.key:
                return
            state = {name: data[name] for name in data.files}
        level, step, rays = (int(count) for count in state["counts"])
        lattice = Lattice(state["links"], state["density"], state["rows"], state["center"],
                          state["radius"])
        average = Average.restored(state, lattice)
        gains, test_gains, recent = state["gains"], state["test_gains"], state["recent"]
        elapsed = float(state["elapsed"])
        level_done, lr_sigma = (float(number) for number in state["rates"])
        capture = (trainer.capture if trainer.poses is None
                   else trainer.poses.restore(state, trainer.capture))
        mattes = None
        if "mattes" in state:
            assert capture.alphas is not None
            mattes = _inflated(state["mattes"], capture.alphas)
    except UNREADABLE_ARRAYS:
        return
    trainer.level, trainer.step, trainer.rays_done, trainer.lattice = level, step, rays, lattice
    trainer.gains, trainer.test_gains, trainer.recent = gains, test_gains, recent
    trainer.level_done, trainer.table = level_done, state.get("table")
    trainer.average = average
    trainer.place(capture)
    if mattes is not None:
        trainer.lay_mattes(mattes)
    trainer.began -= elapsed
    trainer.config = replace(trainer.config, lr_sigma=lr_sigma)
    if "background_links" in state:
        trainer.background = Background(state["background_links"], state["background_data"])
    if "background_mean_square" in state:
        trainer.behind = trainer.background_trainer(state["background_mean_square"])
    if "batch_part" in state:
        trainer.batches = trainer.new_batches()
        trainer.batches.restore(state)
