// Rays through the densities: a workgroup takes a packet, 16 samples of each of 16 rays at a time.
//
// Samples lie on a comb, so that leaping over empty bricks changes nothing. What is visible is
// noted by blocks of 8 samples a ray.

@group(0) @binding(1) var<storage, read> bricks: array<i32>;
@group(0) @binding(2) var<storage, read> density: array<f32>;
@group(0) @binding(3) var<storage, read> cameras: array<f32>;
@group(0) @binding(4) var<storage, read> inputs: array<u32>;
@group(0) @binding(5) var<storage, read_write> packets: array<u32>;
@group(0) @binding(6) var<storage, read_write> blocks: Blocks;
@group(0) @binding(7) var<storage, read_write> samples: array<vec4<f32>>;

var<workgroup> fades: array<f32, 256>;
var<workgroup> reaches: array<f32, 256>;
var<workgroup> through: array<f32, 16>;
var<workgroup> comb: array<f32, 16>;
var<workgroup> shown: array<atomic<u32>, 2>;
var<workgroup> going: atomic<u32>;
var<workgroup> places: array<u32, 2>;
var<workgroup> more: u32;
var<workgroup> found: u32;

struct Ray {
    origin: vec3<f32>,
    start: f32,
    direction: vec3<f32>,
    end: f32,
    delta: f32,
}

fn world_direction(camera: u32, x: f32, y: f32) -> vec3<f32> {
    let c = vec3<f32>((x + 0.5 - cameras[camera + 18u]) / cameras[camera + 16u],
                      (y + 0.5 - cameras[camera + 19u]) / cameras[camera + 17u], 1.0);
    let along = vec3<f32>(
        cameras[camera + 4u] * c.x + cameras[camera + 5u] * c.y + cameras[camera + 6u],
        cameras[camera + 7u] * c.x + cameras[camera + 8u] * c.y + cameras[camera + 9u],
        cameras[camera + 10u] * c.x + cameras[camera + 11u] * c.y + cameras[camera + 12u]);
    return along * inverseSqrt(dot(c, c));
}

fn pixel_of(camera: u32, tile: u32, number: u32) -> vec2<f32> {
    let corner = vec2<f32>(f32(inputs[tile + 2u] + (number & 3u)),
                           f32(inputs[tile + 1u] + (number >> 2u)));
    return min(corner, vec2<f32>(cameras[camera + 20u] - 1.0, cameras[camera + 21u] - 1.0));
}

fn ray_of(camera: u32, tile: u32, number: u32) -> Ray {
    let pixel = pixel_of(camera, tile, number);
    let scale = vec3<f32>(cameras[camera + 13u], cameras[camera + 14u], cameras[camera + 15u]);
    let g = world_direction(camera, pixel.x, pixel.y) * scale;
    let norm = length(g);
    var ray: Ray;
    ray.origin = vec3<f32>(cameras[camera], cameras[camera + 1u], cameras[camera + 2u]);
    ray.direction = g / norm;
    ray.delta = step.pace / norm;
    ray.start = 0.0;
    ray.end = 1e30;
    for (var axis = 0u; axis < 3u; axis++) {
        let last = f32(step.size[axis] - 1u);
        let o = ray.origin[axis];
        let d = ray.direction[axis];
        if (abs(d) < 1e-9) {
            if (o < 0.0 || o > last) { ray.end = -1.0; }
        } else {
            let a = -o / d;
            let b = (last - o) / d;
            ray.start = max(ray.start, min(a, b));
            ray.end = min(ray.end, max(a, b));
        }
    }
    ray.start = max(ray.start, step.near * norm);
    return ray;
}

fn note_basis(notes: u32, d: vec3<f32>) {
    packets[notes] = bitcast<u32>(0.28209479177387814);
    if (step.basis > 1u) {
        packets[notes + 1u] = bitcast<u32>(-0.4886025119029199 * d.y);
        packets[notes + 2u] = bitcast<u32>(0.4886025119029199 * d.z);
        packets[notes + 3u] = bitcast<u32>(-0.4886025119029199 * d.x);
    }
    if (step.basis > 4u) {
        packets[notes + 4u] = bitcast<u32>(1.0925484305920792 * d.x * d.y);
        packets[notes + 5u] = bitcast<u32>(-1.0925484305920792 * d.y * d.z);
        packets[notes + 6u] = bitcast<u32>(0.31539156525252005
                                           * (2.0 * d.z * d.z - d.x * d.x - d.y * d.y));
        packets[notes + 7u] = bitcast<u32>(-1.0925484305920792 * d.x * d.z);
        packets[notes + 8u] = bitcast<u32>(0.5462742152960396 * (d.x * d.x - d.y * d.y));
    }
}

struct Found {
    sigma: f32,
    advance: f32,
}

fn at_place(p: vec3<f32>, d: vec3<f32>) -> Found {
    let highest = vec3<i32>(step.size) - vec3<i32>(2);
    let cell = min(vec3<i32>(max(p, vec3<f32>(0.0))), highest);
    let own = cell >> vec3<u32>(2u);
    let size = vec3<i32>(step.bricks);
    let brick = bricks[(own.z * size.y + own.y) * size.x + own.x];
    var found = Found(0.0, 1.0);
    if (brick < 0) {
        let reach = f32(-brick - 1) * 4.0;
        let low = vec3<f32>(own * 4) - reach;
        let high = low + (reach + reach + 4.0);
        let away = select(d, vec3<f32>(1e-9), abs(d) < vec3<f32>(1e-9));
        let leave = (select(low, high, d > vec3<f32>(0.0)) - p) / away;
        let nearest = min(leave.x, min(leave.y, leave.z));
        found.advance = min(floor(max(nearest, 0.0) / step.pace) + 1.0, 1e6);
        return found;
    }
    let inner = cell & vec3<i32>(3);
    let first = step.links + u32(brick * 128 + inner.z * 25 + inner.y * 5 + inner.x);
    let f = p - vec3<f32>(cell);
    let a = mix(density[bricks[first]], density[bricks[first + 1u]], f.x);
    let b = mix(density[bricks[first + 5u]], density[bricks[first + 6u]], f.x);
    let c = mix(density[bricks[first + 25u]], density[bricks[first + 26u]], f.x);
    let e = mix(density[bricks[first + 30u]], density[bricks[first + 31u]], f.x);
    let sigma = mix(mix(a, b, f.y), mix(c, e, f.y), f.z);
    if (sigma > step.threshold) { found.sigma = sigma; }
    return found;
}

@compute @workgroup_size(256)
fn march(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = step.input + TILE * group.x;
    let notes = step.packet * group.x;
    let camera = 32u * inputs[tile];
    let number = lane & 15u;
    let place = lane >> 4u;
    let ray = ray_of(camera, tile, number);
    if (place == 0u) {
        through[number] = 1.0;
        comb[number] = 0.0;
        packets[notes + 4u * number] = bitcast<u32>(ray.direction.x);
        packets[notes + 4u * number + 1u] = bitcast<u32>(ray.direction.y);
        packets[notes + 4u * number + 2u] = bitcast<u32>(ray.direction.z);
        packets[notes + 4u * number + 3u] = bitcast<u32>(ray.start);
        packets[notes + DELTA + number] = bitcast<u32>(ray.delta);
    }
    if (lane == 0u) {
        var middle = vec3<f32>(0.0);
        for (var i = 0u; i < 16u; i++) {
            let pixel = pixel_of(camera, tile, i);
            middle += world_direction(camera, pixel.x, pixel.y);
        }
        note_basis(notes + BASIS, normalize(middle));
        packets[notes + ORIGIN] = bitcast<u32>(ray.origin.x);
        packets[notes + ORIGIN + 1u] = bitcast<u32>(ray.origin.y);
        packets[notes + ORIGIN + 2u] = bitcast<u32>(ray.origin.z);
        found = 0u;
        more = select(0u, 1u, atomicLoad(&blocks.failed) == 0u);
        atomicStore(&shown[0], 0u);
        atomicStore(&shown[1], 0u);
        atomicStore(&going, 0u);
    }
    var alive = ray.start < ray.end;
    loop {
        // Its barriers also let all see what was noted so far.
        if (workgroupUniformLoad(&more) == 0u) { break; }
        let k = comb[number] + f32(place);
        let t = ray.start + k * step.pace;
        // Written out: a loop's variable without a value keeps the last round's in some compilers.
        var here = Found(0.0, 1.0);
        if (alive && t < ray.end) { here = at_place(ray.origin + t * ray.direction,
                                                    ray.direction); }
        fades[lane] = exp(-here.sigma * ray.delta);
        reaches[lane] = k + here.advance;
        workgroupBarrier();
        var before = through[number];
        for (var i = 0u; i < place; i++) { before *= fades[16u * i + number]; }
        if (before <= step.stop) { here.sigma = 0.0; }
        if (here.sigma > 0.0) { atomicAdd(&shown[place >> 3u], 1u); }
        workgroupBarrier();
        if (lane == 0u) {
            for (var half = 0u; half < 2u; half++) {
                places[half] = NONE;
                if (atomicLoad(&shown[half]) > 0u) {
                    let block = atomicAdd(&blocks.count, 1u);
                    if (block < step.block_room) {
                        places[half] = block;
                        blocks.data[BLOCK * block] = group.x;
                        blocks.data[BLOCK * block + 1u] = found;
                        packets[notes + LIST + found] = block;
                        found += 1u;
                    } else {
                        atomicStore(&blocks.failed, 1u);
                    }
                }
            }
        }
        workgroupBarrier();
        let block = places[place >> 3u];
        if (block != NONE) {
            samples[128u * block + (lane & 127u)] = vec4<f32>(0.0, 0.0, 0.0, here.sigma);
            if ((place & 7u) == 0u) {
                blocks.data[BLOCK * block + COMB + number] = bitcast<u32>(k);
            }
        }
        if (place == 0u) {
            var after = through[number];
            var far = comb[number] + 16.0;
            for (var i = 0u; i < 16u; i++) {
                if (after > step.stop) { after *= fades[16u * i + number]; }
                far = max(far, reaches[16u * i + number]);
            }
            through[number] = after;
            comb[number] = far;
            if (alive && after > step.stop && ray.start + far * step.pace < ray.end) {
                atomicAdd(&going, 1u);
            }
        }
        workgroupBarrier();
        alive = alive && through[number] > step.stop;
        if (lane == 0u) {
            more = select(0u, 1u, atomicLoad(&going) > 0u);
            atomicStore(&shown[0], 0u);
            atomicStore(&shown[1], 0u);
            atomicStore(&going, 0u);
        }
    }
    if (lane == 0u) { packets[notes + COUNT] = found; }
}
