"""The painter for everything but the face: patches of the same material, for photos and heads.

`picture_materials` says what a picture is made of, `materials` what patches of which are laid where
and in which tones, `pieces` where the search for them begins, `looks` and `light` how tones, edges
and the painted face's light go into it. `patch_painter` lays the patches; it is asked by `photo`
for a photo and by `skin.painting` for the surface of a head. `ground` goes on with a painting's
background, for what is behind a head on a panel.
"""
