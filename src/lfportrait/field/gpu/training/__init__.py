"""Training on a GPU: the steps of `lfportrait.field.training` as compute shaders.

A step casts a batch of packets, 16 rays each, forward and backward, and takes up what they found.
Nothing is added by floating-point atomics, and the result does not depend on the order in which
the GPU works: as on the CPU, packets leave *records*, one a lattice point, and each row takes up
its records one after the other, in the order of the CPU's threads.

============  ==============================================================  ====================
Kernel        Work                                                            One thread for
============  ==============================================================  ====================
``march``     densities along the rays; notes *blocks* of 16 x 8 samples      a sample
              with something visible
``points``    lattice points of each block, each once: its records            a sample
``color``     color of each record for its packet's direction                 a record
``blend``     color of each sample                                            a sample
``composite``  rays' colors, errors, and slopes of all samples                a sample
``gather``    slopes of each record from the samples around it                a record
``settle``    densities (RMSProp), weights of colors (SART), in order         a row with records
``paint``     colors                                                          a coefficient
``vary``,     total variation of the density on a run of rows                 a row
``smooth``
============  ==============================================================  ====================

Bytes that a step of R records moves (degree 2, rows of 28 floats): ``color`` reads 112 R of
coefficients, ``paint`` reads and writes 108 R each, ``settle`` and the others read and write about
170 R; ``march`` reads 64 bytes a sample (8 links, 8 densities), most of them from caches, and
``blend`` 8 colors of 16 bytes a sample. Atomics: one integer exchange a record (its row's chain),
8 compare-exchanges in the workgroup's memory a visible sample, and 3 additions a block.

`calls` has the functions that `lfportrait.gpu.GpuProcess` calls; `lattice` and `notes` hold
buffers, `steps` runs the kernels.
"""
