// The lattice points that color a block's samples, each once: a table in the workgroup's memory,
// filled by open addressing. 128 samples with eight corners can't need more than its 1024 places.

@group(0) @binding(1) var<storage, read> bricks: array<i32>;
@group(0) @binding(2) var<storage, read> packets: array<u32>;
@group(0) @binding(3) var<storage, read_write> blocks: Blocks;
@group(0) @binding(4) var<storage, read> samples: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> corners: array<vec4<u32>>;
@group(0) @binding(6) var<storage, read_write> records: array<vec4<u32>>;

var<workgroup> keys: array<atomic<u32>, 1024>;
var<workgroup> owners: array<u32, 1024>;
var<workgroup> numbers: array<u32, 1024>;
var<workgroup> count: atomic<u32>;
var<workgroup> first: u32;
var<workgroup> total: u32;

const UNKNOWN: u32 = 0x7ffu;

fn place_of(key: u32) -> u32 {
    var at = (key * 2654435761u) >> 22u;
    loop {
        let old = atomicCompareExchangeWeak(&keys[at], NONE, key);
        if (old.exchanged || old.old_value == key) { break; }
        // A weak exchange may fail although the place is free: it is tried again then.
        if (old.old_value != NONE) { at = (at + 1u) & 1023u; }
    }
    return at;
}

@compute @workgroup_size(128)
fn points(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
          @builtin(local_invocation_index) lane: u32) {
    if (lane == 0u) {
        total = select(0u, atomicLoad(&blocks.count), atomicLoad(&blocks.failed) == 0u);
    }
    let until = workgroupUniformLoad(&total);
    for (var block = group.x; block < until; block += groups.x) {
        for (var i = lane; i < 1024u; i += 128u) { atomicStore(&keys[i], NONE); }
        if (lane == 0u) { atomicStore(&count, 0u); }
        workgroupBarrier();
        let tile = blocks.data[BLOCK * block];
        let notes = step.packet * tile;
        let number = lane & 15u;
        // A place that rounding puts into an empty brick here takes no part.
        let shown = samples[128u * block + lane].w > 0.0;
        var cell = vec3<i32>(0);
        var slots = array<u32, 8>();
        if (shown) {
            let k = bitcast<f32>(blocks.data[BLOCK * block + COMB + number]) + f32(lane >> 4u);
            let ray = notes + 4u * number;
            let direction = vec3<f32>(bitcast<f32>(packets[ray]), bitcast<f32>(packets[ray + 1u]),
                                      bitcast<f32>(packets[ray + 2u]));
            let origin = vec3<f32>(bitcast<f32>(packets[notes + ORIGIN]),
                                   bitcast<f32>(packets[notes + ORIGIN + 1u]),
                                   bitcast<f32>(packets[notes + ORIGIN + 2u]));
            let t = bitcast<f32>(packets[ray + 3u]) + k * step.pace;
            let p = origin + t * direction;
            cell = min(vec3<i32>(max(p, vec3<f32>(0.0))), vec3<i32>(step.size) - vec3<i32>(2));
            let own = cell >> vec3<u32>(2u);
            let size = vec3<i32>(step.bricks);
            let brick = bricks[(own.z * size.y + own.y) * size.x + own.x];
            let inner = cell & vec3<i32>(3);
            let start = brick * 128 + inner.z * 25 + inner.y * 5 + inner.x;
            for (var corner = 0u; corner < 8u; corner++) {
                let step_to = vec3<i32>(i32(corner & 1u), i32((corner >> 1u) & 1u),
                                        i32(corner >> 2u));
                let point = vec3<u32>(cell + step_to);
                let at = place_of(point.x | (point.y << 10u) | (point.z << 20u));
                slots[corner] = at;
                // All that write here write the same row.
                owners[at] = step.empty;
                if (brick >= 0) {
                    owners[at] = u32(bricks[step.links + u32(
                        start + step_to.z * 25 + step_to.y * 5 + step_to.x)]);
                }
            }
        }
        workgroupBarrier();
        for (var i = lane; i < 1024u; i += 128u) {
            numbers[i] = UNKNOWN;
            if (atomicLoad(&keys[i]) != NONE && owners[i] != step.empty) {
                numbers[i] = atomicAdd(&count, 1u);
            }
        }
        workgroupBarrier();
        if (lane == 0u) {
            let own = atomicLoad(&count);
            first = atomicAdd(&blocks.records, own);
            if (first + own > step.record_room) {
                atomicStore(&blocks.failed, 1u);
                first = NONE;
            }
            blocks.data[BLOCK * block + 2u] = select(first, 0u, first == NONE);
            blocks.data[BLOCK * block + 3u] = select(own, 0u, first == NONE);
        }
        workgroupBarrier();
        if (first != NONE) {
            let order = (tile << 9u) | blocks.data[BLOCK * block + 1u];
            for (var i = lane; i < 1024u; i += 128u) {
                if (numbers[i] != UNKNOWN) {
                    records[first + numbers[i]] = vec4<u32>(owners[i], atomicLoad(&keys[i]), order,
                                                            NONE);
                }
            }
            if (shown) {
                corners[128u * block + lane] = vec4<u32>(
                    numbers[slots[0]] | (numbers[slots[1]] << 11u) | (u32(cell.x) << 22u),
                    numbers[slots[2]] | (numbers[slots[3]] << 11u) | (u32(cell.y) << 22u),
                    numbers[slots[4]] | (numbers[slots[5]] << 11u) | (u32(cell.z) << 22u),
                    numbers[slots[6]] | (numbers[slots[7]] << 11u));
            }
        }
        workgroupBarrier();
    }
}
