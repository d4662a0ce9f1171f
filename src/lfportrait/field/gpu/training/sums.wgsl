// Sums of states, for their mean.

@group(0) @binding(1) var<storage, read> given: array<f32>;
@group(0) @binding(2) var<storage, read_write> sums: array<f32>;
@group(0) @binding(3) var<storage, read_write> blocks: Blocks;

@compute @workgroup_size(256)
fn add(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
       @builtin(local_invocation_index) lane: u32) {
    let at = (group.y * groups.x + group.x) * 256u + lane;
    if (at < arrayLength(&sums) && atomicLoad(&blocks.failed) == 0u) { sums[at] += given[at]; }
}
