// What a block's samples leave at each of its lattice points: a record gathers the slopes of all
// samples around it, in their order, so that nothing is added by atomics. Records of one row are
// then chained: the row's first by the exchange of its head.

@group(0) @binding(1) var<storage, read> packets: array<u32>;
@group(0) @binding(2) var<storage, read_write> blocks: Blocks;
@group(0) @binding(3) var<storage, read> samples: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> sides: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read_write> records: array<vec4<u32>>;
@group(0) @binding(6) var<storage, read_write> values: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> heads: array<atomic<u32>>;

var<workgroup> marks: array<atomic<u32>, 4>;
var<workgroup> places: array<vec4<f32>, 128>;   // position and slope of the density
var<workgroup> slopes: array<vec4<f32>, 128>;
var<workgroup> total: u32;

@compute @workgroup_size(128)
fn gather(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
          @builtin(local_invocation_index) lane: u32) {
    if (lane == 0u) {
        total = select(0u, atomicLoad(&blocks.count), atomicLoad(&blocks.failed) == 0u);
    }
    let until = workgroupUniformLoad(&total);
    for (var block = group.x; block < until; block += groups.x) {
        if (lane < 4u) { atomicStore(&marks[lane], 0u); }
        workgroupBarrier();
        let at = 128u * block + lane;
        let side = sides[at];
        let shown = side.y > 0.0;
        if (shown) { atomicOr(&marks[lane >> 5u], 1u << (lane & 31u)); }
        workgroupBarrier();
        var count = 0u;
        var rank = 0u;
        for (var i = 0u; i < 4u; i++) {
            let mark = atomicLoad(&marks[i]);
            if (i < (lane >> 5u)) { rank += countOneBits(mark); }
            if (i == (lane >> 5u)) { rank += countOneBits(mark & ((1u << (lane & 31u)) - 1u)); }
            count += countOneBits(mark);
        }
        if (shown) {
            let notes = step.packet * blocks.data[BLOCK * block];
            let number = lane & 15u;
            let k = bitcast<f32>(blocks.data[BLOCK * block + COMB + number]) + f32(lane >> 4u);
            let ray = notes + 4u * number;
            let t = bitcast<f32>(packets[ray + 3u]) + k * step.pace;
            places[rank] = vec4<f32>(
                bitcast<f32>(packets[notes + ORIGIN]) + t * bitcast<f32>(packets[ray]),
                bitcast<f32>(packets[notes + ORIGIN + 1u]) + t * bitcast<f32>(packets[ray + 1u]),
                bitcast<f32>(packets[notes + ORIGIN + 2u]) + t * bitcast<f32>(packets[ray + 2u]),
                side.x);
            slopes[rank] = samples[at];
        }
        workgroupBarrier();
        let first = blocks.data[BLOCK * block + 2u];
        let own = blocks.data[BLOCK * block + 3u];
        for (var i = lane; i < own; i += 128u) {
            let record = first + i;
            let row = records[record].x;
            let key = records[record].y;
            let point = vec3<f32>(f32(key & 0x3ffu), f32((key >> 10u) & 0x3ffu),
                                  f32(key >> 20u));
            var sum = vec4<f32>(0.0);
            var sigma = 0.0;
            for (var j = 0u; j < count; j++) {
                let place = places[j];
                let near = max(vec3<f32>(1.0) - abs(place.xyz - point), vec3<f32>(0.0));
                let share = near.x * near.y * near.z;
                sum += share * slopes[j];
                sigma += share * place.w;
            }
            values[2u * record] = sum;
            values[2u * record + 1u] = vec4<f32>(sigma, 0.0, 0.0, 0.0);
            records[record].w = atomicExchange(&heads[row], record);
        }
        workgroupBarrier();
    }
}
