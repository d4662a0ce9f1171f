"""What the choice of a device comes to."""

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.device import computing_device
from lfportrait.errors import UserError
from lfportrait.lightfield import Display, encode
from tests.fields import shell_field


def test_this_version_computes_on_the_cpu():
    assert computing_device() == computing_device("auto") == computing_device("cpu") == "cpu"


@pytest.mark.parametrize("choice", ["gpu", "gpu:radeon"])
def test_a_gpu_is_not_used(choice):
    with pytest.raises(UserError, match="computes on the CPU"):
        computing_device(choice)


@pytest.mark.parametrize("choice", ["", "gpu:", "CPU", "gpus", "npu"])
def test_other_words_are_told_the_choices(choice):
    with pytest.raises(UserError, match="auto, cpu, gpu or gpu:NAME"):
        computing_device(choice)


def test_stages_do_not_pass_over_the_choice():
    field = shell_field(size=8)
    with pytest.raises(UserError, match="computes on the CPU"):
        encode(field, Display(8, 6, views=2, pitch=3.0), device="gpu")
    camera = Camera.arc(np.zeros(1), distance=4.0, width=4, height=4, focal=8.0)
    with pytest.raises(UserError, match="computes on the CPU"):
        field.render(camera, 0, device="gpu:any")
