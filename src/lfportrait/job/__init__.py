"""The main job: all stages in order, from photos to a coded light field.

`pipeline` joins them, `stages` sees that nothing finished is done twice, `person` cuts the person
out of photos with a background, `summary` fills the report.
"""

from .person import cut_person
from .pipeline import MakeConfig, make, prepare_capture
from .warmup import Warmup

__all__ = ["MakeConfig", "Warmup", "cut_person", "make", "prepare_capture"]
