// Total variation of the colors on a run of rows (Shen et al. 2023, Eq. 3): slopes, then a step.
//
// Neighbours of a page's rows are in it, in the page before or in the one behind: a lattice's
// plane is smaller than a page.

@group(0) @binding(1) var<storage, read> rows: array<f32>;
@group(0) @binding(2) var<storage, read> rows_before: array<f32>;
@group(0) @binding(3) var<storage, read> rows_behind: array<f32>;
@group(0) @binding(4) var<storage, read> after: array<i32>;
@group(0) @binding(5) var<storage, read> before: array<i32>;
@group(0) @binding(6) var<storage, read_write> color_slopes: array<f32>;
@group(0) @binding(7) var<storage, read_write> blocks: Blocks;
@group(0) @binding(8) var<uniform> page: vec4<u32>;   // first row, behind the last, first before

fn value_at(row: u32, column: u32) -> f32 {
    if (row < page.x) { return rows_before[(row - page.z) * step.row + column]; }
    if (row >= page.y) { return rows_behind[(row - page.y) * step.row + column]; }
    return rows[(row - page.x) * step.row + column];
}

fn color_differences(row: u32, column: u32) -> vec3<f32> {
    let own = value_at(row, column);
    return step.tv_scale * (vec3<f32>(value_at(u32(after[3u * row]), column),
                                      value_at(u32(after[3u * row + 1u]), column),
                                      value_at(u32(after[3u * row + 2u]), column)) - own);
}

@compute @workgroup_size(256)
fn vary_colors(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
               @builtin(local_invocation_index) lane: u32) {
    let at = (group.y * groups.x + group.x) * 256u + lane;
    let column = at % 32u;
    let row = step.tv_first + at / 32u;
    if (row >= step.tv_last || column >= 3u * step.basis || row < page.x || row >= page.y
        || atomicLoad(&blocks.failed) != 0u) { return; }
    let e = color_differences(row, column);
    var slope = -(e.x + e.y + e.z) / sqrt(dot(e, e) + 1e-9);
    for (var axis = 0u; axis < 3u; axis++) {
        let other = u32(before[3u * row + axis]);
        if (other != row) {
            let d = color_differences(other, column);
            slope += d[axis] / sqrt(dot(d, d) + 1e-9);
        }
    }
    color_slopes[at] = step.tv_color * step.tv_scale * slope;
}

@group(0) @binding(9) var<storage, read_write> rows_changed: array<f32>;
@group(0) @binding(10) var<storage, read> states: array<vec2<f32>>;

const FAINT: f32 = 0.02;

@compute @workgroup_size(256)
fn smooth_colors(@builtin(workgroup_id) group: vec3<u32>,
                 @builtin(num_workgroups) groups: vec3<u32>,
                 @builtin(local_invocation_index) lane: u32) {
    let at = (group.y * groups.x + group.x) * 256u + lane;
    let column = at % 32u;
    let row = step.tv_first + at / 32u;
    if (row >= step.tv_last || column >= 3u * step.basis || row < page.x || row >= page.y
        || atomicLoad(&blocks.failed) != 0u) { return; }
    let harmonic = column % step.basis;
    let gain = step.gain * select(select(0.15 / 5.0, 0.15 / 3.0, harmonic < 4u), 0.7,
                                  harmonic == 0u);
    rows_changed[(row - page.x) * step.row + column] -=
        gain / (states[row].x + FAINT) * color_slopes[at];
}
