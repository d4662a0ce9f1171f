"""Kernels compiled ahead of their use, in processes of their own, on all cores.

Numba compiles a kernel when it is first called, for seconds, one at a time in a process, without a
word. So each stage is run once on next to nothing (`specimens`) in a process of its own, which
leaves the compiled code in Numba's cache on the disk; the job goes on with what needs no kernels
yet and waits for a stage's code where it is needed. A mark beside the cache tells that a stage's
kernels are there: the next run starts no process.
"""

from __future__ import annotations

import os
import queue
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from ..keys import key_of
from ..progress import Progress

__all__ = ["KERNELS", "Warmup", "main"]

KERNELS = {"photograph": 66, "reconstruct": 50, "transfer": 46, "stylize": 21, "encode": 21}
"""Functions that each stage compiles, about: they are more or fewer on other processors."""


def _photograph() -> None:
    from ..demo import demo_capture, demo_exemplar

    demo_capture(size=16, views=3)
    demo_exemplar(width=48, height=64)


def _reconstruct() -> None:
    from ..field import ReconstructConfig, reconstruct
    from .specimens import ball_capture

    reconstruct(ball_capture(), ReconstructConfig(resolutions=(16, 24), rays=(0.004, 0.004),
                                                  batch=(1024,)))


def _transfer() -> None:
    from ..example import SurfaceGuide, Transfer
    from .specimens import ball_capture, ball_field, drawn_exemplar

    capture, exemplar = ball_capture(size=96), drawn_exemplar()
    assert capture.landmarks is not None
    transfer = Transfer(exemplar)
    guide = SurfaceGuide(capture.landmarks, exemplar, transfer.regions)
    from ..stylize.views import prepare_view

    prepare_view(ball_field(9), capture.cameras, 8, transfer, guide, capture.landmarks, 1.0)


def _stylize() -> None:
    from ..stylize import StylizeConfig, stylize
    from .specimens import ball_capture, ball_field, drawn_exemplar

    stylize(ball_field(9), ball_capture(), drawn_exemplar(),
            StylizeConfig(size=64, views=1, pitches=(0.0,), steps=1, fit_iterations=1,
                          content_network="embedded", style_network="embedded"))


def _encode() -> None:
    import math

    from ..lightfield import Display, ViewMask, encode, quilt_of, simulate
    from .specimens import ball_field

    display = Display(48, 24, views=6, pitch=5.3, slant=math.radians(10), quilt=(3, 2),
                      quilt_size=(48, 32))
    field = ball_field(1)
    image = encode(field, display, mask=ViewMask.build(display))
    simulate(image, display, 0.1)
    quilt_of(field, display)


_STAGES: dict[str, Callable[[], None]] = {
    "photograph": _photograph, "reconstruct": _reconstruct, "transfer": _transfer,
    "stylize": _stylize, "encode": _encode}
