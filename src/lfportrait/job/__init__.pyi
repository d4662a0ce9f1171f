from .first_look import FirstLook
from .graph import (
    FULL,
    QUICK,
    STAGES,
    Task,
    capture_key,
    code_key,
    field_key,
    fitted,
    look_at,
    painting_key,
    portrait_tasks,
    share_key,
    source_key,
    stage_key,
    style_key,
)
from .inspection import Inspection, inspect, inspection_lines
from .made_from import MadeFrom, head_way, is_few
from .photo_check import FAIR, GOOD, PhotoCheck, PhotoFacts, check_photos, check_picture
from .pipeline import MakeConfig, Source, TimeLeft, get_networks, make, run_figures
from .prepare import capture_of_face, cut_person, find_face, prepare_capture
from .session import Session
from .style_check import StyleCheck, add_style, check_style, chosen_face, style_picture
from .warmup import Warmup, head_kernels
from .work import Tools, do_stage

__all__ = ["FAIR", "FULL", "GOOD", "QUICK", "STAGES", "FirstLook", "Inspection", "MadeFrom",
           "MakeConfig", "PhotoCheck", "PhotoFacts", "Session", "Source", "StyleCheck",
           "Task", "TimeLeft", "Tools", "Warmup", "add_style", "capture_key", "capture_of_face",
           "check_photos", "check_picture", "check_style", "chosen_face", "code_key", "cut_person",
           "do_stage", "field_key", "find_face", "fitted", "get_networks", "head_kernels",
           "head_way", "inspect", "inspection_lines", "is_few", "look_at", "make", "painting_key",
           "portrait_tasks", "prepare_capture", "run_figures", "share_key", "source_key",
           "stage_key", "style_key", "style_picture"]
