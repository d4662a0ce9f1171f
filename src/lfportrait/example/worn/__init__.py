"""What the painter's sitter wears: found in the painting, and taken off.

Hats and bonnets shade or cover a forehead, spectacles lie across nose and cheeks. Copied onto a
sitter who wears none, they are patches of another color. So they are taken off before a painting is
painted from: `hat` finds what is no bare skin above the brows, `lfportrait.face.glasses` finds
spectacles by their rims, and `inpainting` paints what they cover as the painter might have, in his
light and with his strokes. Where it is asked for, `hat` finds the hat as a thing, and lays it over
the picture of a photo's sitter; on a head it is painted on the surface (`skin.hat`).
"""
