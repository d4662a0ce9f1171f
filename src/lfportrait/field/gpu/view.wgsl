// Rendering a pinhole view: a ray a pixel, then the texture along the surface, then bytes.

struct View {
    // Camera to world, row by row; focal and principal point, in pixels.
    pose: array<vec4<f32>, 3>,
    lens: vec4<f32>,
    // Lattice coordinate = world * scale + offset. scale.w: samples on planes of axis 1, 2, 3, or 0:
    // at fixed steps; offset.w: planes or lattice units from one to the next.
    scale: vec4<f32>,
    offset: vec4<f32>,
    // Width, height, first row and rows of the band.
    size: vec4<u32>,
    // Length of surface for one look-up of the texture, most look-ups, reach, first layer's z.
    filtered: vec4<f32>,
    // What is behind the field; 1: the ground.
    behind: vec4<f32>,
    // In texels of the ground: eye, growth of its rays for a pixel to the right, below, the first.
    ground: array<vec4<f32>, 4>,
}

@group(0) @binding(8) var<uniform> view: View;
@group(0) @binding(9) var<storage, read_write> shots: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> depths: array<f32>;
@group(0) @binding(11) var ground: texture_2d<f32>;
@group(0) @binding(12) var<storage, read_write> picture: array<u32>;

fn from_camera(x: f32, y: f32) -> vec3<f32> {
    return vec3<f32>((x + 0.5 - view.lens.z) / view.lens.x, (y + 0.5 - view.lens.w) / view.lens.y,
                     1.0);
}

fn turned(way: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(dot(view.pose[0].xyz, way), dot(view.pose[1].xyz, way),
                     dot(view.pose[2].xyz, way));
}

fn eye_place() -> vec3<f32> {
    return vec3<f32>(view.pose[0].w, view.pose[1].w, view.pose[2].w);
}

@compute @workgroup_size(8, 8)
fn look(@builtin(global_invocation_id) id: vec3<u32>) {
    let row = id.y + view.size.z;
    if (id.x >= view.size.x || id.y >= view.size.w) { return; }
    let way = from_camera(f32(id.x), f32(row));
    let scale = inverseSqrt(dot(way, way));
    let in_lattice = turned(way) * scale * view.scale.xyz;
    let norm = length(in_lattice);
    let direction = in_lattice / norm;
    let origin = eye_place() * view.scale.xyz + view.offset.xyz;
    var bounds = enter(origin, direction);
    var shown = Shown(vec3<f32>(0.0), 1.0, NOWHERE);
    if (bounds.x < bounds.y) {
        var comb = vec2<f32>(bounds.x, view.offset.w);
        let axis = u32(view.scale.w);
        if (axis > 0u) {
            let planes = planes_of(origin, direction, bounds, axis, view.offset.w);
            comb = planes.comb;
            bounds = planes.bounds;
        }
        shown = march(origin, direction, comb, bounds, comb.y / norm, view.filtered.w);
    }
    let pixel = row * view.size.x + id.x;
    shots[pixel] = vec4<f32>(shown.color, 1.0 - shown.through);
    depths[pixel] = select(shown.depth * scale / norm, NOWHERE, shown.depth > 1e30);
}

// How the depth changes from pixel to pixel: the smaller way, to either side, or 0 unknown.
fn slope_of(pixel: u32, step: u32, before: u32, after: u32) -> f32 {
    let here = depths[pixel];
    var left = NOWHERE;
    var right = NOWHERE;
    if (before > 0u) { left = (here - depths[pixel - step * before]) / f32(before); }
    if (after > 0u) { right = (depths[pixel + step * after] - here) / f32(after); }
    if (abs(right) < abs(left)) { left = right; }
    return select(0.0, left, abs(left) < 1e30);
}

@compute @workgroup_size(8, 8)
fn paint(@builtin(global_invocation_id) id: vec3<u32>) {
    let y = id.y + view.size.z;
    if (id.x >= view.size.x || id.y >= view.size.w) { return; }
    let pixel = y * view.size.x + id.x;
    let away = depths[pixel];
    let share = texture_share(1.0 - shots[pixel].w);
    if (share <= 0.0 || away > 1e30) { return; }
    let apart = max(1u, u32(view.lens.x / (view.scale.x * away) + 0.5));
    let slope_x = slope_of(pixel, 1u, min(apart, id.x), min(apart, view.size.x - 1u - id.x));
    let slope_y = slope_of(pixel, view.size.x, min(apart, y), min(apart, view.size.y - 1u - y));
    let slope = sqrt(slope_x * slope_x + slope_y * slope_y);
    var across = away / view.lens.x;
    let length = sqrt(slope * slope + across * across);
    across = max(across, view.filtered.x);
    var part = 0.0;
    var probes = 1.0;
    if (length > across) {
        let longer = min(length / across, view.filtered.y);
        part = view.filtered.z * sqrt(longer * longer - 1.0) * across / (length * slope);
        probes = ceil(longer);
    }
    let towards = turned(from_camera(f32(id.x), f32(y)));
    let sideways = turned(vec3<f32>(slope_x / view.lens.x, slope_y / view.lens.y, 0.0));
    let place = (eye_place() + away * towards) * view.scale.xyz + view.offset.xyz;
    let along = part * (slope * slope * towards + away * sideways) * view.scale.xyz;
    let chart = chart_of(place);
    var sum = vec3<f32>(0.0);
    for (var probe = 0.0; probe < probes; probe += 1.0) {
        sum += look_up(chart, place + ((probe + 0.5) / probes - 0.5) * along);
    }
    let shot = shots[pixel];
    shots[pixel] = vec4<f32>(max(shot.xyz + share / probes * sum, vec3<f32>(0.0)), shot.w);
}

fn mirrored(place: f32, size: f32) -> f32 {
    let last = size - 1.0;
    let folded = place - 2.0 * last * floor(place / (2.0 * last));
    return select(folded, 2.0 * last - folded, folded > last);
}

@compute @workgroup_size(8, 8)
fn bytes(@builtin(global_invocation_id) id: vec3<u32>) {
    let y = id.y + view.size.z;
    if (id.x >= view.size.x || id.y >= view.size.w) { return; }
    let pixel = y * view.size.x + id.x;
    let shot = shots[pixel];
    var behind = view.behind.xyz;
    if (view.behind.w > 0.5) {
        let ray = view.ground[3].xyz + f32(id.x) * view.ground[1].xyz
                  + f32(y) * view.ground[2].xyz;
        let eye = view.ground[0].xyz;
        let reach = eye.z / max(-ray.z, 1e-3 * eye.z);
        let size = vec2<f32>(textureDimensions(ground));
        let place = eye.xy + reach * ray.xy;
        let at = vec2<f32>(mirrored(place.x, size.x), mirrored(place.y, size.y));
        behind = textureSampleLevel(ground, linear, (at + 0.5) / size, 0.0).xyz;
    }
    let value = clamp(shot.xyz + (1.0 - shot.w) * behind, vec3<f32>(0.0), vec3<f32>(1.0));
    let level = vec3<u32>(value * 255.0 + 0.5);
    picture[pixel] = level.x | level.y << 8u | level.z << 16u | 255u << 24u;
}
