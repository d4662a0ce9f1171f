"""Adam without a wait: the same steps as `torch.optim.Adam`, bit by bit.

That class first imports torch's compiler, and with it SymPy: seconds, for networks that are trained
for seconds. Torch's function for a step does without.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch.optim.adam import adam


class Adam:
    """The optimiser of some parameters; ``rate`` may be changed between steps."""

    def __init__(self, parameters: Iterable[torch.Tensor], rate: float,
                 betas: tuple[float, float] = (0.9, 0.999)) -> None:
        self.parameters, self.rate, self.betas = list(parameters), rate, betas
        self._means, self._squares = (
            [torch.zeros_like(one, memory_format=torch.preserve_format) for one in self.parameters]
            for _ in range(2))
        self._steps = [torch.tensor(0.0) for _ in self.parameters]

    def clear(self) -> None:
        """Forget the gradients."""
        for one in self.parameters:
            one.grad = None

    @torch.no_grad()
    def step(self) -> None:
        """Take a step along the gradients."""
        gradients = [one.grad for one in self.parameters if one.grad is not None]
        assert len(gradients) == len(self.parameters)
        adam(self.parameters, gradients, self._means, self._squares, [], self._steps, amsgrad=False,
             beta1=self.betas[0], beta2=self.betas[1], lr=self.rate, weight_decay=0.0, eps=1e-8,
             maximize=False)
