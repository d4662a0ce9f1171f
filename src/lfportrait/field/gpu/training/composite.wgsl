// Colors of a packet's rays, their errors, and back along the rays the slopes of all samples
// (Shen et al. 2023, Eq. 1 and 2, differentiated; the distortion loss of Mip-NeRF 360, Eq. 15).

@group(0) @binding(1) var<storage, read_write> packets: array<u32>;
@group(0) @binding(2) var<storage, read_write> blocks: Blocks;
@group(0) @binding(3) var<storage, read_write> samples: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> sides: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read> cameras: array<f32>;
@group(0) @binding(6) var<storage, read> inputs: array<u32>;
@group(0) @binding(7) var<storage, read_write> errors: array<f32>;
@group(0) @binding(8) var<storage, read_write> grounds: array<vec4<f32>>;   // of spheres: color

var<workgroup> fades: array<f32, 128>;
var<workgroup> sums: array<vec4<f32>, 128>;
var<workgroup> pulls: array<f32, 128>;
var<workgroup> through: array<f32, 16>;
var<workgroup> slopes: array<vec4<f32>, 16>;   // by red, green, blue, and by the opacity
var<workgroup> far: array<f32, 16>;            // the background's part of what lies behind
var<workgroup> squares: array<f32, 16>;
var<workgroup> behind: array<vec4<f32>, 16>;   // slope, weight, weight * t of all behind
var<workgroup> pulled: array<f32, 16>;
var<workgroup> total: u32;

@compute @workgroup_size(128)
fn composite(@builtin(workgroup_id) group: vec3<u32>,
             @builtin(local_invocation_index) lane: u32) {
    let tile = step.input + TILE * group.x;
    let notes = step.packet * group.x;
    let number = lane & 15u;
    let place = lane >> 4u;
    let delta = bitcast<f32>(packets[notes + DELTA + number]);
    let start = bitcast<f32>(packets[notes + 4u * number + 3u]);
    if (lane == 0u) {
        total = select(0u, packets[notes + COUNT], atomicLoad(&blocks.failed) == 0u);
    }
    if (place == 0u) { through[number] = 1.0; }
    let count = workgroupUniformLoad(&total);
    var color = vec3<f32>(0.0);
    var spread = 0.0;
    for (var i = 0u; i < count; i++) {
        let block = packets[notes + LIST + i];
        let at = 128u * block + lane;
        let own = samples[at];
        let fade = exp(-own.w * delta);
        fades[lane] = fade;
        workgroupBarrier();
        var before = through[number];
        for (var j = 0u; j < place; j++) { before *= fades[16u * j + number]; }
        let weight = before * (1.0 - fade);
        let t = start + (bitcast<f32>(blocks.data[BLOCK * block + COMB + number]) + f32(place))
            * step.pace;
        sides[at] = vec2<f32>(weight, before * fade);
        color += weight * max(own.xyz, vec3<f32>(0.0));
        spread += weight * t;
        workgroupBarrier();
        if (place == 7u) { through[number] = before * fade; }
        workgroupBarrier();
    }
    sums[lane] = vec4<f32>(color, spread);
    workgroupBarrier();
    let end = through[number];
    var whole = vec4<f32>(0.0);
    for (var j = 0u; j < 8u; j++) { whole += sums[16u * j + number]; }
    if (place == 0u) {
        let camera = 32u * inputs[tile];
        let pixel = unpack4x8unorm(inputs[tile + 4u + number]);
        let ray = 2u * (16u * group.x + number);
        var ground = vec3<f32>(bitcast<f32>(inputs[tile + 3u]));
        if (step.layers > 0u) { ground = grounds[ray].xyz; }
        let bytes = vec3<f32>(cameras[camera + 22u], cameras[camera + 23u], cameras[camera + 24u])
            * 255.0;
        let truth = pixel.xyz * bytes * pixel.w + (1.0 - pixel.w) * ground;
        let error = whole.xyz + end * ground - truth;
        squares[number] = dot(error, error);
        let slope = 2.0 * step.share / 3.0 * error;
        slopes[number] = vec4<f32>(
            slope, 2.0 * step.alpha_weight * (1.0 - end - pixel.w) * step.share * end);
        if (step.layers > 0u) { grounds[ray + 1u] = vec4<f32>(slope * end, 0.0); }
        far[number] = dot(slope, end * ground);
        behind[number] = vec4<f32>(0.0);
        pulled[number] = 0.0;
    }
    workgroupBarrier();
    if (lane == 0u) {
        var error = 0.0;
        for (var j = 0u; j < 16u; j++) { error += squares[j]; }
        errors[step.output + group.x] = error;
    }
    let unit = delta / step.pace;
    let slope_of = slopes[number];
    for (var back = 0u; back < count; back++) {
        let block = packets[notes + LIST + count - 1u - back];
        let at = 128u * block + lane;
        let own = samples[at];
        let side = sides[at];
        let weight = side.x;
        let shown = max(own.xyz, vec3<f32>(0.0));
        let t = start + (bitcast<f32>(blocks.data[BLOCK * block + COMB + number]) + f32(place))
            * step.pace;
        let bright = dot(slope_of.xyz, shown);
        let mine = vec4<f32>(weight * bright, weight, weight * t, 0.0);
        sums[lane] = mine;
        workgroupBarrier();
        var after = behind[number];
        for (var j = place + 1u; j < 8u; j++) { after += sums[16u * j + number]; }
        let weight_before = 1.0 - end - after.y - weight;
        let spread_before = whole.w - after.z - weight * t;
        let pull = 2.0 * unit * (t * (weight_before - after.y) - spread_before + after.z
                                 + weight * (step.pace / 3.0));
        pulls[lane] = weight * pull;
        workgroupBarrier();
        var pull_behind = pulled[number];
        for (var j = place + 1u; j < 8u; j++) { pull_behind += pulls[16u * j + number]; }
        var slope = slope_of.w + side.y * bright - far[number] - after.x
            + step.narrow * step.share * (side.y * pull - pull_behind);
        slope *= delta;
        // A color below zero, shown as zero, can only rise.
        let taught = select(vec3<f32>(0.0), slope_of.xyz * weight,
                            (own.xyz > vec3<f32>(0.0)) | (slope_of.xyz < vec3<f32>(0.0)));
        let visible = own.w > 0.0;
        samples[at] = select(vec4<f32>(0.0), vec4<f32>(taught, weight), visible);
        sides[at] = vec2<f32>(slope, select(0.0, 1.0, visible));
        workgroupBarrier();
        if (place == 0u) {
            behind[number] = after + mine;
            pulled[number] = pull_behind + weight * pull;
        }
        workgroupBarrier();
    }
}
