"""The optimiser of the networks that are compared takes torch's own steps."""

import pytest
import torch

from lfportrait_eval.baselines.adam import Adam


@pytest.mark.slow  # torch's class takes seconds to import its compiler; others step by `Adam`
def test_its_steps_are_those_of_torchs_class():
    found = []
    for kind in (Adam, torch.optim.Adam):
        torch.manual_seed(0)
        weights = [torch.randn(5, 3, requires_grad=True), torch.randn(7, requires_grad=True)]
        optimiser = kind(weights, 0.01, (0.5, 0.99))
        for step in range(1, 7):
            for one in weights:
                one.grad = None
            sum((one ** 3).sum() for one in weights).backward()
            if kind is Adam:
                optimiser.rate = 0.01 / step
            else:
                optimiser.param_groups[0]["lr"] = 0.01 / step
            optimiser.step()
        found.append(weights)
    assert all(torch.equal(one, other) for one, other in zip(*found, strict=True))
