"""What people bring: one place decides what a file is, and how it is read.

`kinds` says what a file is, by its content, and what decoders pass over in it; `folders` what a
folder of pictures holds, in which order, and what is left out; `colors` what the numbers of a
picture mean; `pictures` reads pictures, looks at files without decoding them, and says what a mask
is and where it lies; `depth` reads the depth that phones store. All readers of all stages use
these, and nothing else.
"""
