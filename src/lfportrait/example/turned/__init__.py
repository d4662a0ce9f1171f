"""Paintings whose face is turned: their pose, and the frontal picture that is painted from.

`pose` finds how a face is turned, `frontal` unrolls the painting with the help of a head that
stands for any (`generic_head`).
"""

from .frontal import FRONTAL, PROFILE, Frontal, frontal_view, frontalised, suited
from .pose import FacePose, face_pose

__all__ = ["FRONTAL", "PROFILE", "FacePose", "Frontal", "face_pose", "frontal_view", "frontalised",
           "suited"]
