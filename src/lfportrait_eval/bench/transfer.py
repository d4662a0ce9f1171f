"""Speed of all methods of transfer side by side (Shen et al. 2023, Fig. 6)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lfportrait.arrays import Float64, Int32, UInt8
from lfportrait.example import Exemplar, MethodConfig, TransferConfig, prepare
from lfportrait.progress import Progress

from ..baselines.config import FaceBlitConfig, FaceStyleConfig, NetworkConfig

METHODS = ("styleblit", "faceblit", "facestyle", "network")
"""The methods of transfer that are compared: ours and the published ones."""
SHORT_NETWORK = NetworkConfig(pairs=6, budget=20.0)
"""A network trained for a moment: its synthesis costs what a good one's does, its training not."""
ROWS = 8
"""Rows (of 256) of FaceBlit's table that its exhaustive search is timed on."""


def timed(function: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Shortest of several runs in seconds, and the last result."""
    best, result = float("inf"), None
    for _ in range(repeats):
        start = time.perf_counter()
        result = function()
        best = min(best, time.perf_counter() - start)
    return best, result


def say(progress: Progress | None, text: str) -> None:
    """What is being measured, on the progress line."""
    if progress is not None:
        progress.update(progress.done, text)


def bench_transfer(image: UInt8 | None = None,
                   landmarks: NDArray[np.floating] | None = None,
                   exemplar: Exemplar | None = None, *, repeats: int = 3,
                   methods: tuple[str, ...] = METHODS, network: NetworkConfig | None = None,
                   progress: Progress | None = None) -> dict[str, Any]:
    """Transfer by all methods, pre-calculation and synthesis apart (Shen et al. 2023, Fig. 6).

    Picture, landmarks and exemplar are by default the embedded ones, 768 x 1024; the network trains
    20 seconds. The fastest of ``repeats`` runs counts; the slow methods run once.

    Returns
    -------
    figures : For each method ``precalculation_seconds`` (once per style), ``guides_seconds``,
        ``synthesis_seconds`` (with voting and blending), ``frame_seconds``, ``frames_per_second``,
        ``patch_fidelity``. For ``styleblit`` also ``table_seconds`` and ``prepare_seconds`` (the
        whole pre-calculation); for ``faceblit`` ``published_table_seconds``, the exhaustive search
        of the whole table, extrapolated from 8 of its 256 rows; for ``network``
        ``teacher_seconds``, ``training_seconds``, ``pairs``, ``steps``. ``size``: width and height.
    """
    if image is None:
        image, landmarks = _embedded_photo()
    if exemplar is None:
        from lfportrait.demo import demo_exemplar

        exemplar = demo_exemplar()
    assert landmarks is not None
    points = np.asarray(landmarks, np.float64)
    configs: dict[str, tuple[MethodConfig, int]] = {
        "styleblit": (TransferConfig(), repeats), "faceblit": (FaceBlitConfig(), repeats),
        "facestyle": (FaceStyleConfig(), 1), "network": (network or SHORT_NETWORK, repeats)}
    figures: dict[str, Any] = {}
    for method in methods:
        say(progress, f"transfer by {method}")
        figures[method] = _measured(image, points, exemplar, *configs[method])
    return {**figures, "size": [image.shape[1], image.shape[0]]}


def _measured(image: UInt8, points: Float64, exemplar: Exemplar,
              config: MethodConfig, repeats: int) -> dict[str, Any]:
    """Figures of one method."""
    from ..metrics.patches import patch_fidelity

    trains = isinstance(config, NetworkConfig)
    # A small picture compiles the kernels before the clock starts.
    small = Image.fromarray(image).reduce(4)
    quick = replace(config, pairs=1, steps=1) if isinstance(config, NetworkConfig) else config
    prepare(exemplar, quick).apply(np.asarray(small), points / 4)
    prepared_seconds, prepared = timed(lambda: prepare(exemplar, config, [(image, points)]),
                                       1 if trains else repeats)
    frame, result = timed(lambda: prepared.apply(image, points), repeats)
    seconds = result.seconds
    row = {"precalculation_seconds": prepared_seconds, "guides_seconds": seconds["guides_seconds"],
           "synthesis_seconds": seconds["synthesis_seconds"], "frame_seconds": frame,
           "frames_per_second": 1.0 / frame,
           "patch_fidelity": patch_fidelity(result.image, exemplar.image)}
    if isinstance(config, TransferConfig):
        row |= {"table_seconds": seconds["table_seconds"], "prepare_seconds": prepared_seconds}
    elif isinstance(config, FaceBlitConfig):
        row["published_table_seconds"] = _exhaustive(prepared.appearance, config)
    elif trains:
        row |= {name: prepared.facts[name]
                for name in ("teacher_seconds", "training_seconds", "pairs", "steps")}
    return row


def _exhaustive(appearance: Int32, config: FaceBlitConfig) -> float:
    """Seconds of FaceBlit's table searched as published, extrapolated from rows in its middle."""
    from ..baselines.transfer import STEPS, published_table

    whole = replace(config, table="exhaustive")
    # The first call compiles; rows at the border have smaller windows than those in the middle.
    published_table(appearance[:32, :32], whole, range(1))
    middle = range(STEPS // 2, STEPS // 2 + ROWS)
    seconds, _ = timed(lambda: published_table(appearance, whole, middle), 1)
    return seconds * STEPS / ROWS


def transfer_table(figures: dict[str, Any]) -> str:
    """The figures of `bench_transfer` as a table, one method a line."""
    lines = ["method       pre-calculation       guides    synthesis   whole picture   patches"]
    for method in METHODS:
        if method in figures:
            row = figures[method]
            lines.append(f"{method:<10} {row['precalculation_seconds']:>15.3f} s"
                         f"{row['guides_seconds']:>11.3f} s{row['synthesis_seconds']:>11.3f} s"
                         f"{row['frame_seconds']:>14.3f} s{row['patch_fidelity']:>10.2f}")
            if "published_table_seconds" in row:
                lines.append(f"  as published {row['published_table_seconds']:>11.1f} s")
    width, height = figures["size"]
    lines.append(f"{width} x {height}; pre-calculation once a style, the rest for each picture; "
                 "patches: delta E to the exemplar's nearest")
    return "\n".join(lines)


def _embedded_photo() -> tuple[UInt8, Float64]:
    """A frontal photo of the embedded head, 768 x 1024, and its landmarks."""
    from lfportrait.demo import demo_photo

    shot, points = demo_photo()
    alpha = shot[..., 3:].astype(np.float32) / 255.0
    image = (shot[..., :3] * alpha + 225.0 * (1.0 - alpha) + 0.5).astype(np.uint8)
    return image, points
