// What all kernels of the training share: a step's numbers, the layout of its notes, the lattice.
//
// A packet is a tile of 4x4 pixels, 16 rays. Going along its rays, 8 samples of each of the 16
// are a block. Blocks with something visible are numbered as they are found: what is kept of
// samples is kept by these numbers. A record is one lattice point of one block.

const NONE: u32 = 0xffffffffu;

struct Step {
    size: vec3<u32>,        // lattice points along x, y, z
    tiles: u32,
    bricks: vec3<u32>,      // bricks of the table along x, y, z
    links: u32,             // where the links begin behind the table
    pace: f32,              // distance between samples in voxels
    threshold: f32,         // densities up to this are not visible
    stop: f32,              // transmittance at which a ray ends
    near: f32,              // distance from the camera that rays start at, world units
    alpha_weight: f32,
    narrow: f32,            // weight of the distortion loss
    share: f32,             // 1 / rays
    rate: f32,              // of the density
    decay: f32,
    lowest: f32,
    memory: f32,            // weight of rays that a color remembers
    tv_weight: f32,
    tv_scale: f32,
    tv_first: u32,
    tv_last: u32,
    input: u32,             // where the step's tiles begin
    output: u32,            // where its errors begin
    packet: u32,            // words of a packet's notes
    empty: u32,             // number of the empty row
    block_room: u32,
    record_room: u32,
    workers: u32,           // threads whose order records are taken up in
    basis: u32,             // harmonics a channel
    row: u32,               // floats of a row
    gain: f32,              // of a color's first harmonic; higher ones have theirs by `gain_of`
    layers: u32,            // of the spheres behind the lattice; 0: there are none
    tv_color: f32,
    high: u32,              // rows of their map
    grey: f32,              // behind them
    rate_shell: f32,
    rate_shell_density: f32,
}

// Words of a packet's notes: directions and starts of 16 rays (vec4), world lengths of their
// steps, the origin, number of blocks, harmonics, numbers of the blocks.
const DELTA: u32 = 64u;
const ORIGIN: u32 = 80u;
const COUNT: u32 = 84u;
const BASIS: u32 = 88u;
const LIST: u32 = 100u;

// Words of a block: tile, place in the packet's order, first record, records, and where the comb
// of samples begins for each ray.
const BLOCK: u32 = 20u;
const COMB: u32 = 4u;

// Words of a tile that is given: view, row, column, grey, 16 pixels.
const TILE: u32 = 20u;

struct Blocks {
    count: atomic<u32>,
    records: atomic<u32>,
    failed: atomic<u32>,    // 1: too little room, all steps from this one on do nothing
    done: atomic<u32>,      // steps
    most_blocks: atomic<u32>,
    most_records: atomic<u32>,
    unused_a: u32,
    unused_b: u32,
    data: array<u32>,
}

@group(0) @binding(0) var<uniform> step: Step;
