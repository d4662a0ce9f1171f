"""Training on a GPU: the steps of `lfportrait.field.training` as compute shaders.

A step casts a batch of packets, 16 rays each, forward and backward, and takes up what they found.
Nothing is added by floating-point atomics, and the result does not depend on the order in which
the GPU works: as on the CPU, packets leave *records*, one a lattice point, and each row takes up
its records one after the other, in the order of the CPU's threads.

===================  =======================================================  ================
Kernel               Work                                                     One thread for
===================  =======================================================  ================
``march``            densities along the rays; notes *blocks* of 16 x 8       a sample
                     samples with something visible
``shells_forward``   colors of spheres behind the lattice, for a room         a ray
``points``           lattice points of each block, each once: its records     a sample
``color``            color of each record for its packet's direction          a record
``blend``            color of each sample                                     a sample
``composite``        rays' colors, errors, and slopes of all samples          a sample
``gather``           slopes of each record from the samples around it         a record
``settle``           densities (RMSProp), weights of colors (SART), in order  a row with records
``paint``            colors                                                   a coefficient
``vary``,            total variation of the density on a run of rows          a row
``smooth_run``
``vary_colors``,     the same of the colors, for a room                       a coefficient
``smooth_colors``
``bright``,          the table of bricks with visible density, every 400      a brick
``along_x``, ...     steps
``shells_backward``  slopes of the spheres, as sums of integers               a ray
``shells_step``      the spheres (RMSProp)                                    a value
===================  =======================================================  ================

Bytes that a step of R records moves (degree 2, rows of 28 floats): ``color`` reads 112 R of
coefficients, ``paint`` reads and writes 108 R each, the others read and write about 170 R of
records; ``march`` reads 64 bytes a sample (8 links, 8 densities), most of them from caches, and
``blend`` 8 colors of 16 bytes a visible sample. Atomics: one exchange a record (its row's chain),
8 compare-exchanges in the workgroup's memory a visible sample, and 3 additions a block. A step of
2048 rays on a finished head of 0.86 million points has 10 visible samples a ray and 14,400 records:
7 MB, which a card of 900 GB/s moves in 8 microseconds. So a step takes as long as its kernels take
to begin and to wait for memory, one after the other; larger batches cost little more.

`steps` has the buffers on the device, runs the kernels, and has the functions that
`lfportrait.gpu.GpuProcess` calls. Colors are in pages, each within what a shader can see.
Notes have room for what steps need as a rule; a step that needs more, and all that were sent off
behind it, do nothing, and are taken once more with more room.
"""
