// Total variation of the densities on a run of rows (Shen et al. 2023, Eq. 3): slopes, then a step.

@group(0) @binding(1) var<storage, read_write> density: array<f32>;
@group(0) @binding(2) var<storage, read_write> states: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read> after: array<i32>;     // next rows along x, y, z
@group(0) @binding(4) var<storage, read> before: array<i32>;
@group(0) @binding(5) var<storage, read_write> slopes: array<f32>;
@group(0) @binding(6) var<storage, read_write> blocks: Blocks;

const TINY: f32 = 1e-8;

fn differences(row: u32) -> vec3<f32> {
    let own = density[row];
    return step.tv_scale * (vec3<f32>(density[after[3u * row]], density[after[3u * row + 1u]],
                                      density[after[3u * row + 2u]]) - own);
}

fn size_of(e: vec3<f32>) -> f32 { return sqrt(dot(e, e) + 1e-9); }

@compute @workgroup_size(64)
fn vary(@builtin(global_invocation_id) id: vec3<u32>) {
    let row = step.tv_first + id.x;
    if (row >= step.tv_last || atomicLoad(&blocks.failed) != 0u) { return; }
    let e = differences(row);
    var slope = -(e.x + e.y + e.z) / size_of(e);
    for (var axis = 0u; axis < 3u; axis++) {
        let other = u32(before[3u * row + axis]);
        if (other != row) {
            let d = differences(other);
            slope += d[axis] / size_of(d);
        }
    }
    slopes[id.x] = step.tv_weight * step.tv_scale * slope;
}

@compute @workgroup_size(64)
fn smooth_run(@builtin(global_invocation_id) id: vec3<u32>) {
    if (atomicLoad(&blocks.failed) != 0u) { return; }
    let row = step.tv_first + id.x;
    if (row < step.tv_last && step.tv_weight > 0.0) {
        let slope = slopes[id.x];
        let square = step.decay * states[row].y + (1.0 - step.decay) * slope * slope;
        states[row].y = square;
        density[row] = max(density[row] - step.rate * slope / (sqrt(square) + TINY), step.lowest);
    }
    if (id.x == 0u) {
        // The step is over.
        atomicMax(&blocks.most_blocks, atomicExchange(&blocks.count, 0u));
        atomicMax(&blocks.most_records, atomicExchange(&blocks.records, 0u));
        atomicAdd(&blocks.done, 1u);
    }
}
