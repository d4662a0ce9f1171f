// The table of bricks without those in which no density is above the threshold: as
// `lfportrait.field.kernels.bricks.bright_table`. The distance to the nearest bright brick, the
// largest of those along x, y and z, is found one axis after the other.

@group(0) @binding(1) var<storage, read_write> bricks: array<i32>;
@group(0) @binding(2) var<storage, read> density: array<f32>;
@group(0) @binding(3) var<storage, read> whole: array<i32>;     // the table of all bricks
@group(0) @binding(4) var<storage, read_write> near: array<i32>;
@group(0) @binding(5) var<storage, read_write> nearer: array<i32>;
@group(0) @binding(6) var<storage, read_write> blocks: Blocks;

fn cell_of(group: vec3<u32>, groups: vec3<u32>, lane: u32) -> u32 {
    return (group.y * groups.x + group.x) * 64u + lane;
}

fn cells() -> u32 { return step.bricks.x * step.bricks.y * step.bricks.z; }

fn farthest() -> i32 { return i32(max(step.bricks.x, max(step.bricks.y, step.bricks.z))); }

@compute @workgroup_size(64)
fn bright(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
          @builtin(local_invocation_index) lane: u32) {
    let cell = cell_of(group, groups, lane);
    if (cell >= cells() || atomicLoad(&blocks.failed) != 0u) { return; }
    let brick = whole[cell];
    var most = 0.0;
    if (brick >= 0) {
        for (var i = 0u; i < 128u; i++) {
            most = max(most, density[bricks[step.links + 128u * u32(brick) + i]]);
        }
    }
    near[cell] = select(farthest(), 0, brick >= 0 && most > step.threshold);
}

// The least, over the cells of a line, of the larger of their distance and of what they have.
fn least_along(cell: u32, place: u32, size: u32, stride: u32, first: bool) -> i32 {
    let start = cell - place * stride;
    var least = farthest();
    for (var i = 0u; i < size; i++) {
        let away = abs(i32(i) - i32(place));
        if (away < least) {
            let at = start + i * stride;
            var own = 0;
            if (first) { own = near[at]; } else { own = nearer[at]; }
            least = min(least, max(away, own));
        }
    }
    return least;
}

@compute @workgroup_size(64)
fn along_x(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
           @builtin(local_invocation_index) lane: u32) {
    let cell = cell_of(group, groups, lane);
    if (cell >= cells() || atomicLoad(&blocks.failed) != 0u) { return; }
    nearer[cell] = least_along(cell, cell % step.bricks.x, step.bricks.x, 1u, true);
}

@compute @workgroup_size(64)
fn along_y(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
           @builtin(local_invocation_index) lane: u32) {
    let cell = cell_of(group, groups, lane);
    if (cell >= cells() || atomicLoad(&blocks.failed) != 0u) { return; }
    near[cell] = least_along(cell, cell / step.bricks.x % step.bricks.y, step.bricks.y,
                             step.bricks.x, false);
}

@compute @workgroup_size(64)
fn along_z(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
           @builtin(local_invocation_index) lane: u32) {
    let cell = cell_of(group, groups, lane);
    if (cell >= cells() || atomicLoad(&blocks.failed) != 0u) { return; }
    let stride = step.bricks.x * step.bricks.y;
    let away = least_along(cell, cell / stride, step.bricks.z, stride, true);
    bricks[cell] = select(-away, whole[cell], away == 0);
}
