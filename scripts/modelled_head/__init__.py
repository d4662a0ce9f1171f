"""A modelled head: exact photos with depth, landmarks, paintings of it, and a field of it.

The demo's data are made of it (`make_demo_data.py`), and tests and scripts measure on it where the
truth has to be known. It is no part of the installed package.
"""

from .head_model import HeadModel
from .lattice import head_field
from .painting import STYLES, exemplar_camera, painted_exemplar
from .people import PAINTED, PEOPLE, SITTER, landmarks
from .sitters import random_person
from .studio import Picture, photograph, studio_cameras, studio_capture

__all__ = ["PAINTED", "PEOPLE", "SITTER", "STYLES", "HeadModel", "Picture", "exemplar_camera",
           "head_field", "landmarks", "painted_exemplar", "photograph", "random_person",
           "studio_cameras", "studio_capture"]
