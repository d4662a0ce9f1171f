// The color of each record's point for its packet's middle direction.

@group(0) @binding(1) var<storage, read> rows: array<f32>;
@group(0) @binding(2) var<storage, read> records: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> packets: array<u32>;
@group(0) @binding(4) var<storage, read_write> blocks: Blocks;
@group(0) @binding(5) var<storage, read_write> values: array<vec4<f32>>;
@group(0) @binding(6) var<uniform> page: vec4<u32>;    // first row of the page, and behind its last

@compute @workgroup_size(64)
fn color(@builtin(global_invocation_id) id: vec3<u32>,
         @builtin(num_workgroups) groups: vec3<u32>) {
    if (atomicLoad(&blocks.failed) != 0u) { return; }
    let until = atomicLoad(&blocks.records);
    for (var record = id.x; record < until; record += 64u * groups.x) {
        let own = records[record];
        if (own.x < page.x || own.x >= page.y) { continue; }
        let start = (own.x - page.x) * step.row;
        let basis = step.packet * (own.z >> 9u) + BASIS;
        var sum = vec3<f32>(0.5);
        for (var i = 0u; i < step.basis; i++) {
            let harmonic = bitcast<f32>(packets[basis + i]);
            let at = start + i;
            sum += harmonic * vec3<f32>(rows[at], rows[at + step.basis],
                                        rows[at + 2u * step.basis]);
        }
        values[2u * record] = vec4<f32>(sum, 0.0);
    }
}
