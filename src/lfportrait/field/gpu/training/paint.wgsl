// The colors take up their share of the errors: a lane for each coefficient of a row.

@group(0) @binding(1) var<storage, read_write> rows: array<f32>;
@group(0) @binding(2) var<storage, read> records: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> values: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> lines: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> packets: array<u32>;
@group(0) @binding(6) var<storage, read_write> blocks: Blocks;
@group(0) @binding(7) var<uniform> page: vec4<u32>;    // first row of the page, and behind its last

@compute @workgroup_size(256)
fn paint(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
         @builtin(local_invocation_index) lane: u32) {
    if (atomicLoad(&blocks.failed) != 0u) { return; }
    let until = atomicLoad(&blocks.records);
    let column = lane & 31u;
    if (column >= 3u * step.basis) { return; }
    let channel = column / step.basis;
    let harmonic = column % step.basis;
    // A band's harmonics share its part: 0.7, 0.15, 0.15, by 4 pi / (2 l + 1).
    let gain = step.gain * select(select(0.15 / 5.0, 0.15 / 3.0, harmonic < 4u), 0.7,
                                  harmonic == 0u);
    for (var speaker = 8u * group.x + (lane >> 5u); speaker < until; speaker += 8u * groups.x) {
        let own = records[speaker];
        if (own.w != NONE || own.x < page.x || own.x >= page.y) { continue; }
        var change = 0.0;
        var record = lines[speaker].x;
        while (record != NONE) {
            let basis = step.packet * (records[record].z >> 9u) + BASIS;
            change += values[2u * record][channel] * bitcast<f32>(packets[basis + harmonic]);
            record = lines[record].y;
        }
        rows[(own.x - page.x) * step.row + column] -= gain * change;
    }
}
