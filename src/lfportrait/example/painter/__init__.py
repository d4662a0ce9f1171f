"""The painter for everything but the face: patches of the same material, for photos and heads.

`picture_materials` says what a picture is made of, `plain_skin` what of a face is no plain skin,
`materials` what patches of which are laid where, in which tones, and where the search for them
begins. `light` carries the painted face's light to its surroundings. `patch_painter` lays the
patches; it is asked by `photo` for a photo and by `skin.painting` for the surface of a head.
`ground` goes on with a painting's background, for what is behind a head on a panel.
"""
