"""Regions that are decided on a surface as a whole."""

import numpy as np
import pytest

from lfportrait.field.surface import LEAST, SurfaceGraph

DARK, LIGHT = (0.2, 0.12, 0.08), (0.9, 0.7, 0.6)


def sheet(rows=40, columns=60):
    y, x = np.mgrid[:rows, :columns].astype(float)
    return x.ravel(), y.ravel()


def test_the_solution_is_that_of_the_dense_system():
    rng = np.random.default_rng(0)
    points, colors = rng.random((60, 3)), rng.random((60, 3))
    votes, trust = rng.random(60), rng.random(60)
    graph = SurfaceGraph.over(points, colors, 0.2)
    cells = len(graph.count)
    matrix, right = np.zeros((cells, cells)), np.zeros(cells)
    for (i, j), ease in zip(graph.edges, graph.ease):
        matrix[[i, j], [i, j]] += ease
        matrix[[i, j], [j, i]] -= ease
    for cell, vote, weight in zip(graph.cell, votes, trust):
        matrix[cell, cell] += weight / graph.count[cell]
        right[cell] += weight * vote / graph.count[cell]
    expected = np.linalg.solve(matrix, right)[graph.cell]
    assert np.abs(graph.decided(votes, trust) - expected).max() < 0.02


def test_a_step_is_easy_within_a_color_and_hard_across_an_edge():
    x, y = sheet()
    colors = np.where((x < 30)[:, None], DARK, LIGHT)
    graph = SurfaceGraph.over(np.stack([x, y, 0 * x], axis=1), colors, 1.0)
    across = (graph.cell[:, None] == graph.edges.T[0][None]).argmax(axis=0), (
        graph.cell[:, None] == graph.edges.T[1][None]).argmax(axis=0)
    apart = (x[across[0]] < 30) != (x[across[1]] < 30)
    assert apart.any() and np.allclose(graph.ease[apart], LEAST, atol=1e-3)
    assert np.allclose(graph.ease[~apart], 1)


@pytest.mark.parametrize("known", [True, False])
def test_a_seam_in_hair_becomes_hair_and_the_edge_of_skin_stays(known):
    """Half of a sheet is dark and voted hair, but for a seam where nothing is sure."""
    x, y = sheet()
    truth = x < 30.2
    colors = np.where(truth[:, None], DARK, LIGHT)
    seam = np.abs(y - 20) < 3
    if not known:
        colors[seam] = np.nan
    votes = np.where(seam, 0.3, truth)
    graph = SurfaceGraph.over(np.stack([x, y, 0 * x], axis=1), colors, 1.0)
    found = graph.decided(votes, np.where(seam, 0.01, 1.0)) > 0.5
    assert (found == truth)[~seam].all()
    clear = seam & (np.abs(x - 30) > (0 if known else 4))
    assert (found == truth)[clear].all()
