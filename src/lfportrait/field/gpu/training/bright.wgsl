// Which bricks have a density above the threshold; and sums of states, for their mean.

@group(0) @binding(1) var<storage, read> bricks: array<i32>;
@group(0) @binding(2) var<storage, read> density: array<f32>;
@group(0) @binding(3) var<storage, read_write> found: array<u32>;

@compute @workgroup_size(64)
fn bright(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
          @builtin(local_invocation_index) lane: u32) {
    let brick = (group.y * groups.x + group.x) * 64u + lane;
    if (brick >= arrayLength(&found)) { return; }
    var most = 0.0;
    for (var i = 0u; i < 128u; i++) {
        most = max(most, density[bricks[step.links + 128u * brick + i]]);
    }
    found[brick] = select(0u, 1u, most > step.threshold);
}

@group(0) @binding(4) var<storage, read> given: array<f32>;
@group(0) @binding(5) var<storage, read_write> sums: array<f32>;
@group(0) @binding(6) var<storage, read_write> blocks: Blocks;

@compute @workgroup_size(256)
fn add(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
       @builtin(local_invocation_index) lane: u32) {
    let at = (group.y * groups.x + group.x) * 256u + lane;
    if (at < arrayLength(&sums) && atomicLoad(&blocks.failed) == 0u) { sums[at] += given[at]; }
}
