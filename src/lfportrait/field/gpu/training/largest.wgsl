// The largest weight of each row: weights are not negative, so that their bits are ordered alike.

@group(0) @binding(1) var<storage, read> bricks: array<i32>;
@group(0) @binding(2) var<storage, read> packets: array<u32>;
@group(0) @binding(3) var<storage, read_write> blocks: Blocks;
@group(0) @binding(4) var<storage, read> samples: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> most: array<atomic<u32>>;

var<workgroup> fades: array<f32, 128>;
var<workgroup> through: array<f32, 16>;
var<workgroup> total: u32;

@compute @workgroup_size(128)
fn largest(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let notes = step.packet * group.x;
    let number = lane & 15u;
    let place = lane >> 4u;
    let delta = bitcast<f32>(packets[notes + DELTA + number]);
    let ray = notes + 4u * number;
    if (lane == 0u) {
        total = select(0u, packets[notes + COUNT], atomicLoad(&blocks.failed) == 0u);
    }
    if (place == 0u) { through[number] = 1.0; }
    let count = workgroupUniformLoad(&total);
    for (var i = 0u; i < count; i++) {
        let block = packets[notes + LIST + i];
        let sigma = samples[128u * block + lane].w;
        fades[lane] = exp(-sigma * delta);
        workgroupBarrier();
        var before = through[number];
        for (var j = 0u; j < place; j++) { before *= fades[16u * j + number]; }
        let weight = before * (1.0 - fades[lane]);
        if (sigma > 0.0) {
            let k = bitcast<f32>(blocks.data[BLOCK * block + COMB + number]) + f32(place);
            let t = bitcast<f32>(packets[ray + 3u]) + k * step.pace;
            let p = vec3<f32>(
                bitcast<f32>(packets[notes + ORIGIN]) + t * bitcast<f32>(packets[ray]),
                bitcast<f32>(packets[notes + ORIGIN + 1u]) + t * bitcast<f32>(packets[ray + 1u]),
                bitcast<f32>(packets[notes + ORIGIN + 2u]) + t * bitcast<f32>(packets[ray + 2u]));
            let cell = min(vec3<i32>(max(p, vec3<f32>(0.0))), vec3<i32>(step.size) - vec3<i32>(2));
            let own = cell >> vec3<u32>(2u);
            let size = vec3<i32>(step.bricks);
            let brick = bricks[(own.z * size.y + own.y) * size.x + own.x];
            if (brick >= 0) {
                let inner = cell & vec3<i32>(3);
                let start = step.links + u32(brick * 128 + inner.z * 25 + inner.y * 5 + inner.x);
                for (var corner = 0u; corner < 8u; corner++) {
                    let row = bricks[start + (corner >> 2u) * 25u + ((corner >> 1u) & 1u) * 5u
                                     + (corner & 1u)];
                    atomicMax(&most[row], bitcast<u32>(weight));
                }
            }
        }
        workgroupBarrier();
        if (place == 7u) { through[number] = before * fades[lane]; }
        workgroupBarrier();
    }
}

// Blocks of this band of tiles are done with.
@compute @workgroup_size(1)
fn next_band() {
    if (atomicLoad(&blocks.failed) != 0u) { return; }
    atomicMax(&blocks.most_blocks, atomicExchange(&blocks.count, 0u));
    atomicAdd(&blocks.done, 1u);
}
