// Spheres behind the lattice, as in `lfportrait.field.kernels.shells`: colors of rays, and back.
//
// Slopes are summed as integers of 2^-33, so that the order does not matter: the slopes of all
// rays of a step with an error of one add up to less than one, those that share a place to much
// less.

@group(0) @binding(1) var<storage, read> packets: array<u32>;
@group(0) @binding(2) var<storage, read_write> blocks: Blocks;
@group(0) @binding(3) var<storage, read> map: array<i32>;             // [2 R, R], place or -1
@group(0) @binding(4) var<storage, read_write> spheres: array<vec4<f32>>;   // [place, layer]
@group(0) @binding(5) var<storage, read_write> grounds: array<vec4<f32>>;   // color, then slope
@group(0) @binding(6) var<storage, read_write> sums: array<atomic<i32>>;
@group(0) @binding(7) var<storage, read_write> squares: array<vec4<f32>>;

const C0: f32 = 0.28209479177387814;
const PI: f32 = 3.14159265358979;
const SCALE: f32 = 8589934592.0;
const FAINTEST: f32 = 1e-3;     // transmittance at which a ray ends
const TINY: f32 = 1e-8;

struct CubeRay {
    origin: vec3<f32>,
    direction: vec3<f32>,
    inner: f32,                 // radius of the first sphere that counts
}

struct Meeting {
    inverse: f32,               // of the radius; -1: the ray does not meet the sphere
    place: vec2<f32>,           // longitude and latitude in pixels of the map
}

struct Corners {
    rows: array<i32, 8>,
    weights: array<f32, 8>,
}

fn cube_ray(ray: u32) -> CubeRay {
    let notes = step.packet * (ray >> 4u);
    let at = notes + 4u * (ray & 15u);
    let half = vec3<f32>(step.size) * 0.5;
    let origin = vec3<f32>(bitcast<f32>(packets[notes + ORIGIN]),
                           bitcast<f32>(packets[notes + ORIGIN + 1u]),
                           bitcast<f32>(packets[notes + ORIGIN + 2u]));
    let direction = vec3<f32>(bitcast<f32>(packets[at]), bitcast<f32>(packets[at + 1u]),
                              bitcast<f32>(packets[at + 2u]));
    let o = (origin + 0.5) / half - 1.0;
    let d = normalize(direction / half);
    let along = dot(o, d);
    return CubeRay(o, d, max(1.0, sqrt(max(0.0, dot(o, o) - along * along)) + 1e-3));
}

fn meet(ray: CubeRay, number: u32) -> Meeting {
    let steps = f32(step.layers + 2u);
    let radius = steps / (steps - f32(number) - 0.5);
    let along = dot(ray.origin, ray.direction);
    let inside = along * along - dot(ray.origin, ray.origin) + radius * radius;
    if (radius < ray.inner || inside < 0.0) { return Meeting(-1.0, vec2<f32>(0.0)); }
    let t = -along + sqrt(inside);
    if (t <= 0.0) { return Meeting(-1.0, vec2<f32>(0.0)); }
    let inverse = 1.0 / radius;
    let p = (ray.origin + t * ray.direction) * inverse;
    return Meeting(inverse, vec2<f32>(
        (0.5 + atan2(p.x, p.z) * (0.5 / PI)) * f32(2u * step.high),
        (0.5 - asin(clamp(p.y, -1.0, 1.0)) / PI) * f32(step.high)));
}

fn corners_of(found: Meeting) -> Corners {
    let high = i32(step.high);
    let wide = 2 * high;
    let layers = i32(step.layers);
    let w = clamp((1.0 - found.inverse) * f32(layers) - 0.5, 0.0, f32(layers) - 1.0);
    let column = min(i32(found.place.x), wide - 1);
    let row = min(i32(found.place.y), high - 1);
    let layer = min(i32(w), layers - 2);
    let f = vec3<f32>(found.place - vec2<f32>(f32(column), f32(row)), w - f32(layer));
    var out = Corners(array<i32, 8>(), array<f32, 8>());
    for (var corner = 0u; corner < 8u; corner++) {
        var i = column + i32(corner & 1u);
        let j = min(row + i32((corner >> 1u) & 1u), high - 1);
        if (i >= wide) { i -= wide; }
        let link = map[i * high + j];
        out.rows[corner] = select(-1, link * layers + layer + i32(corner >> 2u), link >= 0);
        out.weights[corner] = select(1.0 - f.x, f.x, (corner & 1u) != 0u)
            * select(1.0 - f.y, f.y, (corner & 2u) != 0u)
            * select(1.0 - f.z, f.z, (corner & 4u) != 0u);
    }
    return out;
}

fn value_of(corners: Corners) -> vec4<f32> {
    var own = corners;
    var value = vec4<f32>(0.0);
    for (var corner = 0u; corner < 8u; corner++) {
        if (own.rows[corner] >= 0) {
            value += own.weights[corner] * spheres[own.rows[corner]];
        }
    }
    return value;
}

@compute @workgroup_size(64)
fn shells_forward(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= 16u * step.tiles || atomicLoad(&blocks.failed) != 0u) { return; }
    let ray = cube_ray(id.x);
    var last = 1.0 / ray.inner;
    var through = 1.0;
    var color = vec3<f32>(0.0);
    for (var number = 0u; number < step.layers + 2u; number++) {
        let found = meet(ray, number);
        if (found.inverse < 0.0) { continue; }
        let value = value_of(corners_of(found));
        if (value.w > 0.0) {
            let fade = exp(-value.w * (last - found.inverse));
            color += through * (1.0 - fade) * max(C0 * value.xyz + 0.5, vec3<f32>(0.0));
            through *= fade;
            if (through < FAINTEST) { break; }
        }
        last = found.inverse;
    }
    grounds[2u * id.x] = vec4<f32>(color + through * step.grey, 0.0);
}

@compute @workgroup_size(64)
fn shells_backward(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= 16u * step.tiles || atomicLoad(&blocks.failed) != 0u) { return; }
    let slope = grounds[2u * id.x + 1u].xyz;
    if (all(slope == vec3<f32>(0.0))) { return; }
    let ray = cube_ray(id.x);
    var last = 1.0 / ray.inner;
    var through = 1.0;
    // The color still to come, weighted by the slopes.
    var behind = dot(slope, grounds[2u * id.x].xyz);
    for (var number = 0u; number < step.layers + 2u; number++) {
        let found = meet(ray, number);
        if (found.inverse < 0.0) { continue; }
        var corners = corners_of(found);
        let value = value_of(corners);
        if (value.w > 0.0) {
            let width = last - found.inverse;
            let fade = exp(-value.w * width);
            let weight = through * (1.0 - fade);
            through *= fade;
            let color = C0 * value.xyz + 0.5;
            let here = dot(slope, max(color, vec3<f32>(0.0)));
            behind -= weight * here;
            let change = vec4<f32>(
                select(vec3<f32>(0.0), C0 * weight * slope, color > vec3<f32>(0.0)),
                width * (through * here - behind));
            for (var corner = 0u; corner < 8u; corner++) {
                if (corners.rows[corner] >= 0) {
                    let own = round(corners.weights[corner] * change * SCALE);
                    let at = 4u * u32(corners.rows[corner]);
                    for (var channel = 0u; channel < 4u; channel++) {
                        atomicAdd(&sums[at + channel], i32(own[channel]));
                    }
                }
            }
            if (through < FAINTEST) { break; }
        }
        last = found.inverse;
    }
}

@compute @workgroup_size(256)
fn shells_step(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
               @builtin(local_invocation_index) lane: u32) {
    let row = (group.y * groups.x + group.x) * 256u + lane;
    if (row >= arrayLength(&spheres) || atomicLoad(&blocks.failed) != 0u) { return; }
    let slope = vec4<f32>(f32(atomicLoad(&sums[4u * row])), f32(atomicLoad(&sums[4u * row + 1u])),
                          f32(atomicLoad(&sums[4u * row + 2u])),
                          f32(atomicLoad(&sums[4u * row + 3u]))) / SCALE;
    if (all(slope == vec4<f32>(0.0))) { return; }
    let taken = slope != vec4<f32>(0.0);
    let square = select(squares[row], 0.95 * squares[row] + 0.05 * slope * slope, taken);
    squares[row] = square;
    let rates = vec4<f32>(vec3<f32>(step.rate_shell), step.rate_shell_density);
    var value = spheres[row] - rates * slope / (sqrt(square) + TINY);
    value.w = max(value.w, 0.0);
    spheres[row] = select(spheres[row], value, taken);
    for (var channel = 0u; channel < 4u; channel++) {
        atomicStore(&sums[4u * row + channel], 0);
    }
}
