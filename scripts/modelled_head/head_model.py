"""Parameters of a modelled head: proportions, features, hair, and colors.

`HeadModel` is a named tuple, so that Numba compiles it as a record.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["HeadModel"]

Color = tuple[float, float, float]


class HeadModel(NamedTuple):
    """A person. Lengths are factors on an average adult's, or world units where they say so."""

    skull_width: float = 1.0
    face_width: float = 1.0
    jaw_width: float = 1.0
    chin_drop: float = 0.0
    """How much lower than average the chin is, world units."""
    chin_width: float = 1.0
    chin_forward: float = 0.0
    cheekbone: float = 1.0
    cheek_hollow: float = 0.0
    nose_width: float = 1.0
    nose_length: float = 0.0
    """How much lower than average the nose ends, world units."""
    nose_out: float = 0.0
    """How much further than average the tip stands out, world units."""
    nose_hump: float = 0.0
    eye_size: float = 1.0
    eye_open: float = 1.0
    eye_tilt: float = 0.010
    """How much higher the outer corner is than the inner one, world units."""
    lid_fold: float = 1.0
    """Depth of the fold above the eye, a factor."""
    eye_space: float = 0.0
    """How much further than average each eye is from the middle, world units."""
    brow_height: float = 0.0
    brow_arch: float = 1.0
    brow_width: float = 1.0
    brow_ridge: float = 1.0
    lip_upper: float = 1.0
    lip_lower: float = 1.0
    mouth_width: float = 1.0
    smile: float = 0.0
    """How much higher the corners of the mouth are, world units."""
    ear_size: float = 1.0
    neck_width: float = 1.0
    folds: float = 0.0
    """Depth of the folds that come with age: nose to mouth, under the eyes, forehead."""
    hairline: float = 0.0
    """How much higher than average the hair begins, world units."""
    hair_top: float = 0.06
    """Thickness of the hair on top, world units."""
    hair_side: float = 0.04
    hair_quiff: float = 0.0
    """Extra thickness above the forehead, world units."""
    hair_knot: float = 0.0
    """Radius of a knot at the pole of the strands, world units; 0 = none."""
    hair_pole_y: float = 0.62
    """Height of the pole to which the strands run."""
    hair_pole_z: float = -0.42
    hair_twist: float = 0.0
    """Radians by which a strand turns about the pole on its way."""
    hair_relief: float = 1.0
    hair_recede: float = 0.0
    """How far the hair has gone back above the temples, world units."""
    hair_curl: float = 0.0
    """Height of curls, world units; hair that has them stands up from the scalp at once."""
    hair_fringe: float = 0.0
    """Thickness of a fringe that ends above the brows, world units; 0 = none."""
    hair_length: float = 0.0
    """How far below the eyes hair hangs, world units; 0 = none does."""
    hair_front: float = 0.12
    """How far forward of the ears hanging hair comes, world units."""
    hair_wave: float = 0.0
    """How far hanging strands swing to the sides, radians."""
    hair_parting: float = 0.0
    """Depth of a parting in the middle, world units; 0 = none."""
    beard: float = 0.0
    """Cover of the beard's shadow in [0, 1]."""
    beard_full: float = 0.0
    """Thickness of a full beard on cheeks and chin, world units; 0 = none."""
    beard_length: float = 0.0
    """How far it hangs below the chin, world units."""
    spectacles: float = 0.0
    """Radius of the rims' wire, world units; 0 = none are worn."""
    freckles: float = 0.0
    skin: Color = (0.80, 0.57, 0.45)
    """Linear albedo of the skin, RGB in [0, 1]; so for the other colors."""
    blush: Color = (0.78, 0.36, 0.29)
    lips: Color = (0.60, 0.22, 0.20)
    iris: Color = (0.13, 0.22, 0.16)
    brow: Color = (0.075, 0.040, 0.025)
    hair: Color = (0.12, 0.045, 0.02)
    hair_light: Color = (0.36, 0.15, 0.06)
    cloth: Color = (0.02, 0.13, 0.17)
    worn: Color = (0.02, 0.014, 0.010)
