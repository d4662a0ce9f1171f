// Take up the records of each row, in the order of their tiles: the densities, and how much of its
// error each color takes up. The record that was chained first speaks for its row.

@group(0) @binding(1) var<storage, read_write> density: array<f32>;
@group(0) @binding(2) var<storage, read_write> states: array<vec2<f32>>;  // rays' weight; slope^2
@group(0) @binding(3) var<storage, read_write> heads: array<u32>;
@group(0) @binding(4) var<storage, read> records: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read_write> values: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> lines: array<vec2<u32>>;   // first, next in order
@group(0) @binding(7) var<storage, read_write> blocks: Blocks;

const FAINT: f32 = 0.02;
const TINY: f32 = 1e-8;

fn order_of(record: u32) -> u32 {
    let own = records[record].z;
    let tile = own >> 9u;
    return (((tile % step.workers) * ((step.tiles - 1u) / step.workers + 1u)
             + tile / step.workers) << 9u) | (own & 0x1ffu);
}

fn in_order(head: u32) -> u32 {
    var first = NONE;
    var record = head;
    while (record != NONE) {
        let following = records[record].w;
        let order = order_of(record);
        if (first == NONE || order < order_of(first)) {
            lines[record].y = first;
            first = record;
        } else {
            var at = first;
            var after = lines[at].y;
            while (after != NONE && order_of(after) < order) {
                at = after;
                after = lines[at].y;
            }
            lines[record].y = after;
            lines[at].y = record;
        }
        record = following;
    }
    return first;
}

@compute @workgroup_size(64)
fn settle(@builtin(global_invocation_id) id: vec3<u32>,
          @builtin(num_workgroups) groups: vec3<u32>) {
    if (atomicLoad(&blocks.failed) != 0u) { return; }
    let until = atomicLoad(&blocks.records);
    for (var speaker = id.x; speaker < until; speaker += 64u * groups.x) {
        if (records[speaker].w != NONE) { continue; }
        let row = records[speaker].x;
        let first = in_order(heads[row]);
        heads[row] = NONE;
        lines[speaker].x = first;
        var known = states[row].x;
        var square = states[row].y;
        var own = density[row];
        var record = first;
        while (record != NONE) {
            var sum = values[2u * record];
            var sigma = values[2u * record + 1u].x;
            // A packet's blocks share the points between them: one record of them all.
            var next = lines[record].y;
            while (next != NONE && (records[next].z >> 9u) == (records[record].z >> 9u)) {
                sum += values[2u * next];
                sigma += values[2u * next + 1u].x;
                next = lines[next].y;
            }
            lines[record].y = next;
            known = max(min(known + sum.w, step.memory), sum.w);
            values[2u * record] = sum / (known + FAINT);
            square = step.decay * square + (1.0 - step.decay) * sigma * sigma;
            own = max(own - step.rate * sigma / (sqrt(square) + TINY), step.lowest);
            record = next;
        }
        states[row] = vec2<f32>(known, square);
        density[row] = own;
    }
}
