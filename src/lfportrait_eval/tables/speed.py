"""Speed as the paper reports it: Table 1 (the mask guide) and Fig. 6 (transfer by example)."""

from __future__ import annotations

from typing import Any

from lfportrait.example import Exemplar
from lfportrait.progress import Progress

from ..baselines.transfer import NetworkConfig
from ..bench import METHODS as TRANSFERS
from ..bench import bench_masks, bench_transfer
from .methods import Sizes
from .sitters import Sitter

__all__ = ["speed_tables"]


def speed_tables(sitter: Sitter, exemplar: Exemplar, sizes: Sizes, size: str,
                 progress: Progress | None) -> dict[str, Any]:
    """Measure the coding with and without the mask guide, and all methods of transfer.

    Parameters
    ----------
    sitter
        Whose field is coded.
    exemplar
        The style of the transfers; their photo is the embedded head, 768 x 1024, as the paper's
        pictures.
    sizes, size
        Of this run; the shortest of some runs counts: ``quick`` codes twice and transfers once.
    progress
        Updated with what is being measured.

    Returns
    -------
    figures
        ``table_1``: a row by resolution. ``fig_6``: by method of transfer
        ``precalculation_seconds`` and ``synthesis_seconds`` (guides and synthesis of one picture),
        and ``whole_seconds``, both for all views that a field is fitted to; ``views``, how many.
    """
    repeats = 1 if size == "quick" else 3
    # Coding is fast; a single run would measure the machine's noise rather than the mask.
    masks = bench_masks(sitter.field, repeats=repeats + 1, progress=progress)
    found = bench_transfer(exemplar=exemplar, repeats=repeats, progress=progress,
                           network=NetworkConfig(pairs=sizes.network_pairs,
                                                 budget=sizes.network_seconds,
                                                 device=sitter.device))
    views = 3 * sizes.painted_views
    rows = {}
    for method in TRANSFERS:
        row = found[method]
        once = row.get("published_table_seconds", row["precalculation_seconds"])
        each = row["guides_seconds"] + row["synthesis_seconds"]
        rows[method] = {"precalculation_seconds": row["precalculation_seconds"],
                        "published_seconds": row.get("published_table_seconds"),
                        "synthesis_seconds": each, "patch_fidelity": row["patch_fidelity"],
                        "whole_seconds": once + views * each}
    return {"table_1": masks, "fig_6": rows, "fig_6_views": views}
