"""Whole trainings on a GPU: as good as the CPU's, and brought to an end where the GPU is lost."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.field import ReconstructConfig
from lfportrait.field.training.meter import held_out_quality
from lfportrait.field.training.trainer import Trainer
from lfportrait.gpu import GpuLostError
from lfportrait.progress import Progress
from tests.field.test_field import ball_capture

pytestmark = pytest.mark.slow  # shaders; their steps are in test_steps.py

CONFIG = ReconstructConfig(resolutions=(12, 24), rays=(0.002, 0.006), batch=(256,),
                           fill_back=False, cut_base=False).resolved(False, 3.0, 0.1)


class Said(Progress):
    """A progress line that keeps what is said."""

    def __init__(self):
        super().__init__("reconstruct", enabled=False)
        self.lines = []

    def say(self, line):
        self.lines.append(line)


class Fragile:
    """A device's process that is lost at a call.

    It only says so, and the process serves the next test: a new one compiles shaders for seconds.
    """

    def __init__(self, process, call, number=0):
        self.process, self.fatal, self.number = process, call, number
        self.calls, self.lost = [], False

    def __getattr__(self, name):
        return getattr(self.process, name)

    def holds(self, *what):
        return not self.lost and self.process.holds(*what)

    def call(self, name, *arguments):
        if self.lost:
            raise GpuLostError("Card 9 was lost")
        name = name.partition(":")[2]
        self.calls.append(name)
        if name == self.fatal and self.calls.count(name) > self.number:
            self.lost = True
            raise GpuLostError("Card 9 was lost")
        return self.process.call(f"lfportrait.field.gpu.training:{name}", *arguments)


@pytest.fixture
def process(gpu_child):
    return gpu_child


def trained(process, config=CONFIG, checkpoint=None, capture=None, look=None):
    """The trainer at its end, and what it said."""
    said = Said()
    trainer = Trainer(capture or ball_capture(count=12, size=28), config, said, checkpoint,
                      process=process, look=look)
    trainer.restore()
    while trainer.level < len(config.resolutions):
        trainer.run_level()
        trainer.offer()
    trainer.finish()
    return trainer, said.lines


@pytest.fixture(scope="module")
def on_gpu(gpu_children):
    """The same training on the GPU, and what it said."""
    return trained(gpu_children())


@pytest.fixture(scope="module")
def on_cpu():
    """The same training on the CPU from its beginning to its end."""
    return trained(None)[0]


def quality(trainer):
    """PSNR in dB of all photos."""
    capture = replace(trainer.capture, held_out=np.ones(len(trainer.capture), bool))
    return held_out_quality(trainer.field(), capture, 1.0)["psnr"]


def test_a_training_ends_where_the_cpus_does(on_gpu, on_cpu):
    on_gpu, lines = on_gpu
    assert abs(quality(on_gpu) - quality(on_cpu)) < 0.3
    assert quality(on_gpu) > 25
    assert on_gpu.device != "cpu"
    assert on_gpu.rays_done == on_cpu.rays_done
    assert abs(on_gpu.lattice.count / on_cpu.lattice.count - 1) < 0.03
    assert not any("CPU" in line for line in lines)


def test_looks_change_nothing(process, on_gpu):
    seen = []

    def look(trainer):
        if len(seen) < 2:  # after the first level, and within the second
            seen.append(trainer.field(trainer.cleaned()))

    plain, looked = on_gpu[0].field(), trained(process, look=look)[0].field()
    assert len(seen) == 2 and not np.array_equal(looked.density, seen[1].density)
    for name in ("links", "density", "sh"):
        assert np.array_equal(getattr(looked, name), getattr(plain, name)), name


def test_a_room_is_trained_as_on_the_cpu(process, monkeypatch):
    monkeypatch.setattr("lfportrait.field.geometry.start.BACKGROUND_ROWS", 32)
    capture = ball_capture(count=12, size=24, alpha=False, room=True)
    config = ReconstructConfig(resolutions=(10, 20), rays=(0.002, 0.005), batch=(256,),
                               background_nlayers=8, mvs_init=False,
                               ).resolved(True, 3.0, 0.1)
    on_gpu, lines = trained(process, config, capture=capture)
    on_cpu, _ = trained(None, config, capture=capture)
    assert on_gpu.device != "cpu" and on_gpu.background is not None
    assert abs(quality(on_gpu) - quality(on_cpu)) < 0.3
    assert not any("CPU" in line for line in lines)


@pytest.mark.parametrize("call, number", [
    ("begin", 0), *(pytest.param(call, 0, marks=pytest.mark.slow) for call in ("take", "largest")),
    ("fetch", 1)])
def test_a_lost_gpu_is_one_line_and_the_cpu_goes_on(process, on_cpu, call, number):
    fragile = Fragile(process, call, number)
    on_both, lines = trained(fragile)
    assert fragile.calls[-1] == call
    assert [line for line in lines if "CPU" in line] == [
        "Card 9 was lost; the training goes on on the CPU"]
    assert on_both.device == "cpu"
    assert abs(quality(on_both) - quality(on_cpu)) < 0.5


def test_the_cpu_goes_on_from_the_last_checkpoint(process, on_cpu, tmp_path,
                                                     monkeypatch):
    # Saved in the middle of the second level; the GPU is lost at its end.
    path = tmp_path / "state.npz"
    saved = []

    def now_and_then(self):
        if self.level == 1 and self.step == 10:
            self.save()
            saved.append(self.step)

    monkeypatch.setattr(Trainer, "save_now_and_then", now_and_then)
    fragile = Fragile(process, "fetch", 2)
    trainer, lines = trained(fragile, checkpoint=path)
    # Calls: the first level's end, the checkpoint, the second level's end.
    assert fragile.calls.count("fetch") == 3
    assert saved == [10]  # was not passed again
    assert sum("CPU" in line for line in lines) == 1
    assert abs(quality(trainer) - quality(on_cpu)) < 0.5


def test_a_gpus_checkpoint_is_gone_on_from_on_the_cpu_and_the_other_way(process, on_cpu,
                                                                        tmp_path, monkeypatch):
    path = tmp_path / "state.npz"

    class Stop(Exception):
        pass

    def stop(self):
        if self.level == 1 and self.step == 16:
            self.save()
            raise Stop

    for first, then in ((process, None), (None, process)):
        path.unlink(missing_ok=True)
        with monkeypatch.context() as patch, pytest.raises(Stop):
            patch.setattr(Trainer, "save_now_and_then", stop)
            trained(first, checkpoint=path)
        trainer, _ = trained(then, checkpoint=path)
        assert trainer.rays_done == on_cpu.rays_done
        assert abs(quality(trainer) - quality(on_cpu)) < 0.3
