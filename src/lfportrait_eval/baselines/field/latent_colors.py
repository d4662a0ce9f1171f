"""Colors of a field that may differ a little from view to view, by a latent code of each view.

StylizedNeRF's teacher paints every view on its own, so views contradict each other. There the
color is a network of the place and of a latent code that belongs to the view; what views can't
agree on goes into the codes, and the mean code shows what they have in common. Here the color of a
row is linear in the code: its own color plus a change for each of the code's numbers. Codes have
mean 0 and spread 1, so that the mean code shows the rows' own colors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lfportrait.stylize.fit import ColorModel

from .photo_views import PhotoView

__all__ = ["LatentColors"]

Float32 = NDArray[np.float32]


class LatentColors:
    """A model's colors and how they change with the codes.

    Parameters
    ----------
    model
        The colors of the mean code; changed in place.
    views
        The views.
    numbers
        Length of a code; 0 is the model alone.
    ridge
        Weight of a code's squared length beside the mean squared error of its view.
    random
        Chooses the first codes.
    """

    def __init__(self, model: ColorModel, views: list[PhotoView], numbers: int, ridge: float,
                 random: np.random.Generator) -> None:
        self.model, self.views, self.ridge = model, views, ridge
        self.codes = random.standard_normal((len(views), numbers)).astype(np.float32)
        self.changes = np.zeros((numbers, *model.colors.shape), np.float32)
        self._normalise()

    def picture(self, index: int) -> Float32:
        """What a view shows with its own code, float32 [h, w, 3]."""
        code = self.codes[index]
        colors = self.model.colors + np.tensordot(code, self.changes, 1)
        return self.model.picture(self.views[index], np.ascontiguousarray(colors, np.float32))

    def fit(self, iterations: int) -> list[float]:
        """Fit colors, changes and codes to the views' examples; error of each iteration (RMS)."""
        errors = []
        weight = self._column_sums()
        for _ in range(iterations):
            errors.append(self._iterate(weight))
            self._fit_codes()
            weight = self._column_sums()
        return errors

    def _column_sums(self) -> Float32:
        """How much each row counts in color and changes, float32 [1 + D, N]."""
        sums = np.zeros((1 + len(self.changes), len(self.model.colors)), np.float32)
        for view, code in zip(self.views, self.codes):
            seen = np.zeros((3, sums.shape[1]), np.float32)
            self.model.pulled_back(view, np.repeat(view.trusted[..., None], 3, 2), seen)
            sums[0] += seen[0]
            sums[1:] += np.abs(code)[:, None] * seen[0]
        self.model.seen = sums[0].copy()
        return sums

    def _iterate(self, sums: Float32) -> float:
        """One simultaneous iteration (SIRT) of colors and changes; returns the error before."""
        updates = np.zeros((len(sums), 3, sums.shape[1]), np.float32)
        total = mass = 0.0
        for index, (view, code) in enumerate(zip(self.views, self.codes)):
            residual = view.example - self.picture(index)
            total += float((residual ** 2 * view.trusted[..., None]).sum())
            mass += 3.0 * float(view.trusted.sum())
            rows = np.maximum(view.alpha, 0.05) * (1 + np.abs(code).sum())
            back = np.zeros_like(updates[0])
            self.model.pulled_back(view, view.trusted[..., None] * residual / rows[..., None], back)
            updates[0] += back
            updates[1:] += code[:, None, None] * back
        updates /= np.maximum(sums, 1e-4)[:, None]
        known = sums[0] > 1e-4
        self.model.colors[known] += updates[0].T[known]
        np.clip(self.model.colors, 0.0, 1.0, out=self.model.colors)
        self.changes[:, known] += updates[1:].transpose(0, 2, 1)[:, known]
        return float(np.sqrt(total / max(mass, 1e-9)))

    def _fit_codes(self) -> None:
        """The code of each view by least squares, colors and changes held."""
        if not len(self.changes):
            return
        for index, view in enumerate(self.views):
            trust = np.sqrt(view.trusted)[..., None]
            behind = self.model.picture(view, np.zeros_like(self.model.colors))
            shown = [(trust * (self.model.picture(view, change) - behind)).ravel()
                     for change in self.changes]
            wanted = (trust * (view.example - self.model.picture(view))).ravel()
            matrix = np.stack(shown, 1).astype(np.float64)
            ridge = self.ridge * max(float(view.trusted.sum()) * 3, 1.0)
            normal = matrix.T @ matrix + ridge * np.eye(matrix.shape[1])
            self.codes[index] = np.linalg.solve(normal, matrix.T @ wanted)
        self._normalise()

    def _normalise(self) -> None:
        """Codes of mean 0 and spread 1; colors and changes follow, so that nothing else moves."""
        if len(self.codes) < 2 or not len(self.changes):
            return
        mean, spread = self.codes.mean(0), np.maximum(self.codes.std(0), 1e-6)
        self.model.colors += np.tensordot(mean, self.changes, 1)
        np.clip(self.model.colors, 0.0, 1.0, out=self.model.colors)
        self.codes = (self.codes - mean) / spread
        self.changes *= spread[:, None, None]
