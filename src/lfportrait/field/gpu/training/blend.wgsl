// The color of each sample from its cell's eight corners.

@group(0) @binding(1) var<storage, read> packets: array<u32>;
@group(0) @binding(2) var<storage, read_write> blocks: Blocks;
@group(0) @binding(3) var<storage, read_write> samples: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> corners: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read> values: array<vec4<f32>>;

@compute @workgroup_size(128)
fn blend(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
         @builtin(local_invocation_index) lane: u32) {
    if (atomicLoad(&blocks.failed) != 0u) { return; }
    let until = atomicLoad(&blocks.count);
    for (var block = group.x; block < until; block += groups.x) {
        let at = 128u * block + lane;
        let sigma = samples[at].w;
        if (sigma <= 0.0) { continue; }
        let notes = step.packet * blocks.data[BLOCK * block];
        let number = lane & 15u;
        let k = bitcast<f32>(blocks.data[BLOCK * block + COMB + number]) + f32(lane >> 4u);
        let ray = notes + 4u * number;
        let t = bitcast<f32>(packets[ray + 3u]) + k * step.pace;
        let word = corners[at];
        let f = vec3<f32>(
            bitcast<f32>(packets[notes + ORIGIN]) + t * bitcast<f32>(packets[ray])
                - f32(word.x >> 22u),
            bitcast<f32>(packets[notes + ORIGIN + 1u]) + t * bitcast<f32>(packets[ray + 1u])
                - f32(word.y >> 22u),
            bitcast<f32>(packets[notes + ORIGIN + 2u]) + t * bitcast<f32>(packets[ray + 2u])
                - f32(word.z >> 22u));
        let first = blocks.data[BLOCK * block + 2u];
        var sum = vec3<f32>(0.0);
        for (var pair = 0u; pair < 4u; pair++) {
            let share = select(1.0 - f.y, f.y, (pair & 1u) != 0u)
                * select(1.0 - f.z, f.z, (pair & 2u) != 0u);
            let near = word[pair] & 0x7ffu;
            let far = (word[pair] >> 11u) & 0x7ffu;
            // An empty point is grey: all its coefficients are zero.
            var low = vec3<f32>(0.5);
            var high = vec3<f32>(0.5);
            if (near != 0x7ffu) { low = values[2u * (first + near)].xyz; }
            if (far != 0x7ffu) { high = values[2u * (first + far)].xyz; }
            sum += share * mix(low, high, f.x);
        }
        samples[at] = vec4<f32>(sum, sigma);
    }
}
