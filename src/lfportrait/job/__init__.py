"""The main job: all stages in order, from photos to a coded light field.

`steps` has them as functions, `pipeline` joins them, `stages` sees that nothing finished is done
twice, `person` cuts the person out of photos with a background, `summary` fills the report.
`photo_check` looks at photos before any of that, `check_picture` draws what it found. `batch` is a
room of its own: many jobs at once.
"""

from .check_picture import check_picture
from .person import cut_person
from .photo_check import PhotoCheck, PhotoFacts, check_photos
from .pipeline import MakeConfig, make, prepare_capture
from .warmup import Warmup

__all__ = ["MakeConfig", "PhotoCheck", "PhotoFacts", "Warmup", "check_photos", "check_picture",
           "cut_person", "make", "prepare_capture"]
