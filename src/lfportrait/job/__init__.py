"""The main job: the stages in order, from photos to a coded light field, each resumable."""

from .person import cut_person
from .pipeline import MakeConfig, make, prepare_capture

__all__ = ["MakeConfig", "cut_person", "make", "prepare_capture"]
