"""Sums of the states of a lattice, and rows from them."""

from __future__ import annotations

from ...lanes.decorators import lean_kernel
from ...lanes.threads import shared

__all__ = ["add_rows", "put_means"]


@shared("sums")
@lean_kernel
def put_means(since, until, sums, columns, count, rows, first):
    """Write means into the first columns of rows; one state is written as it is.

    Parameters
    ----------
    sums
        float32 [M, columns or more].
    columns
        How many values of a row are written.
    count
        Number of states, a float32.
    rows
        float32 [first + M or more, columns or more], written.
    first
        The row that the first sums belong to.
    """
    for row in range(since, until):
        for column in range(columns):
            rows[first + row, column] = sums[row, column] / count


@shared("sums")
@lean_kernel
def add_rows(since, until, sums, rows):
    """Add the first columns of rows to sums.

    Parameters
    ----------
    sums
        float32 [N, columns], written.
    rows
        float32 [N, width], at least as wide.
    """
    for row in range(since, until):
        for column in range(sums.shape[1]):
            sums[row, column] += rows[row, column]
