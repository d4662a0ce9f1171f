"""Create MediaPipe's tasks without log output; they are not closed when the process ends."""

from __future__ import annotations

import atexit
import os
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from ..arrays import UInt8

__all__ = ["made", "picture"]

_LOCK = threading.Lock()
"""Standard error is silenced for the whole process: by one thread at a time."""


def made(make: Callable[[], Any], first: Callable[[Any], object]) -> Any:
    """A task and its first run, with nothing on standard error.

    Parameters
    ----------
    make
        Makes the task.
    first
        Runs it once: some of the chatter comes only then.
    """
    with _LOCK:
        return _made(make, first)


def _made(make: Callable[[], Any], first: Callable[[Any], object]) -> Any:
    os.environ.setdefault("GLOG_minloglevel", "3")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    saved = os.dup(2)
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 2)
    try:
        task = make()
        # When the process ends, closing would fail on threads and modules that are gone already
        # (and say so on standard error); the system frees everything anyway.
        atexit.register(setattr, task, "_handle", None)
        first(task)
        return task
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(silent)


def picture(image: UInt8) -> Any:
    """A picture, uint8 [H, W, 3 or 4], as MediaPipe wants it."""
    import mediapipe

    kind = mediapipe.ImageFormat.SRGB if image.shape[2] == 3 else mediapipe.ImageFormat.SRGBA
    return mediapipe.Image(image_format=kind, data=np.ascontiguousarray(image))
