"""Pictures and videos for frames, stereo viewers and flat panels, and the drives they stand on.

`export` writes what a file's name asks for: a quilt, a package of Looking Glass Studio, a stereo
pair, color and depth, an anaglyph, a flat video. `fill_drive` fills the drive of a frame that
stands alone.
"""
