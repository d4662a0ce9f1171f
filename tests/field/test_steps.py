"""Many steps of a training in one call, beside the same steps one by one."""

import numpy as np
import pytest

from lfportrait.field.kernels.descent import descend
from lfportrait.field.kernels.packet import Records
from lfportrait.field.training.stepping import DECAY, Caster, CpuSteps, color_gains, smooth_run
from tests.field.gpu.training.scene import on_cpu, taken_steps


class OneByOne(CpuSteps):
    """Each step by kernels of its own."""

    def flush(self):
        plans, self._waiting = self._waiting, []
        lattice, config = self.lattice, self.config
        for plan in plans:
            caster = Caster(lattice, self.data, self.basis, len(self.caster.losses))
            caster.table, caster._cameras = self.caster.table, self.caster._cameras
            ground = np.repeat(np.repeat(plan.greys[:, None], 3, axis=1), 16, axis=0)
            caster.cast(plan.tiles, ground, self.scale(), self.options)
            self.taken(plan, caster.errors, float(caster.losses[:, 0].sum()))
            gains = color_gains(16 * len(plan.tiles), self.basis, self.width)
            descend(lattice.density, lattice.rows.ravel(), self.width, caster.records.arrays,
                    caster.bases, plan.rate, DECAY, self.lowest, gains,
                    np.float32(1.0) / plan.rate_sh)
            smooth_run(lattice, config, self.level, lattice.neighbours(), plan.place, plan.rate,
                       self.lowest, gains)
            if plan.averaged:
                self._average()


def one_by_one(_, level):
    return OneByOne(level)


def with_little_room(_, level):
    steps = CpuSteps(level)
    steps.caster.records = Records.empty(len(steps.caster.losses), 40)
    return steps


@pytest.mark.parametrize("make", [on_cpu, with_little_room])
# Rows of few coefficients are narrower, and have kernels of their own, which take eight seconds to
# compile.
@pytest.mark.parametrize(("basis", "more"), [
    pytest.param(1, {}, marks=pytest.mark.slow),
    pytest.param(4, {"lambda_tv": 0.02}, marks=pytest.mark.slow),
    (9, {"lambda_tv": 0.02, "lambda_tv_sh": 0.02})])
def test_steps_together_equal_steps_one_by_one(make, basis, more):
    wanted, wanted_errors, wanted_sums, _, _ = taken_steps(one_by_one, basis, **more)
    found, errors, sums, _, _ = taken_steps(make, basis, **more)
    assert len(errors) == len(wanted_errors) == 5
    for (own, total), (other, other_total) in zip(errors, wanted_errors, strict=True):
        assert np.array_equal(own, other)
        assert total == other_total
    assert np.array_equal(found.density, wanted.density)
    assert np.array_equal(found.rows, wanted.rows)
    assert np.array_equal(sums.rows, wanted_sums.rows)
    assert sums.count == wanted_sums.count
