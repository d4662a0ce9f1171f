// Coding a panel: one ray a sub-pixel, sub-pixels in the order of their views inside a tile.
//
// A workgroup codes 16 x 16 pixels. Its 768 sub-pixels are sorted by view, so that neighbouring
// threads cast next to parallel rays; the views follow from the panel's numbers, no mask is read.
// A phase is a fraction of the lens in 32 bits that wrap around, exact on every panel.

struct Panel {
    // From the deep display frame to the lattice, row by row.
    matrix: array<vec4<f32>, 3>,
    // Half width over half height, height of the eyes, their distance, half heights a world unit.
    shape: vec4<f32>,
    // Sub-pixels of a row, rows of the panel, first row, rows from one to the next.
    rows: vec4<f32>,
    // First and last eye, number of views, 1: views between eyes.
    eyes: vec4<f32>,
    // Rays a sub-pixel, how far their eyes lie apart, gamma.
    rays: vec4<f32>,
    // 0: samples on planes of axis x, y, z (1, 2, 3) or 0: at fixed steps; distance of samples;
    // grey level behind the field; layers of color.
    comb: vec4<f32>,
    // Ground: how far behind over the distance of the eyes, left, top, 1 if any.
    ground: vec4<f32>,
    // Width and height of its texels; height of the eyes in its frame; 1: colors from right to left.
    texel: vec4<f32>,
    // Phase of a pixel, of a row, of the first pixel; 1: inverted.
    phase: vec4<u32>,
    // Width of the picture, first row of the band, rows of the band, words of a row.
    size: vec4<u32>,
    // For row mod 4, column mod 2 and sub-pixel: its phase in its pixel, and how far it is moved.
    steps: array<vec4<u32>, 6>,
    moved: array<vec4<f32>, 6>,
}

@group(0) @binding(8) var<uniform> panel: Panel;
@group(0) @binding(9) var ground: texture_2d<f32>;
@group(0) @binding(10) var<storage, read_write> picture: array<u32>;

override sorted: bool = true;

const WIDE = 16u;
const MANY = 768u;

var<workgroup> tally: array<atomic<u32>, 64>;
var<workgroup> order: array<u32, 768>;
var<workgroup> values: array<u32, 768>;

fn phase_of(x: u32, y: u32, k: u32) -> u32 {
    let number = 6u * (y & 3u) + 3u * (x & 1u) + k;
    let raw = x * panel.phase.x + y * panel.phase.y + panel.phase.z
              + panel.steps[number >> 2u][number & 3u];
    return select(raw, 0u - raw, panel.phase.w == 1u);
}

// X of the eye of a sub-pixel.
fn eye_of(phase: u32) -> f32 {
    let many = panel.eyes.z;
    let place = f32(phase) * 2.3283064365386963e-10 * many;
    let last = many - 1.0;
    let between = clamp(place - 0.5, 0.0, last);
    let view = select(min(floor(place), last), between, panel.eyes.w > 0.5);
    return panel.eyes.x + (panel.eyes.y - panel.eyes.x) * view / max(last, 1.0);
}

// What an eye sees of the ground at a place of the panel.
fn ground_at(px: f32, py: f32, eye: f32, channel: u32) -> f32 {
    let share = panel.ground.x;
    let x = ((1.0 + share) * px - share * eye - panel.ground.y) / panel.texel.x;
    let y = (panel.ground.z - ((1.0 + share) * py - share * panel.texel.z)) / panel.texel.y;
    let size = vec2<f32>(textureDimensions(ground));
    return textureSampleLevel(ground, linear, (vec2<f32>(x, y) + 0.5) / size, 0.0)[channel];
}

// One channel of what one eye sees at a place of the panel, in a row of the band.
// What its ray meets of the field, `met`, is in direct.wgsl or slices.wgsl.
fn seen_by(px: f32, py: f32, eye: f32, channel: u32, row: u32) -> f32 {
    let distance = panel.shape.z;
    let way = normalize(vec3<f32>(px - eye, py - panel.shape.y, -distance));
    let from_eye = vec4<f32>(eye, panel.shape.y, distance, 1.0);
    let origin = vec3<f32>(dot(panel.matrix[0], from_eye), dot(panel.matrix[1], from_eye),
                           dot(panel.matrix[2], from_eye));
    let turned = vec3<f32>(dot(panel.matrix[0].xyz, way), dot(panel.matrix[1].xyz, way),
                           dot(panel.matrix[2].xyz, way));
    let norm = length(turned);
    let direction = turned / norm;
    let shown = met(origin, direction, norm, eye, row);
    var value = shown.color[channel] + detail(origin, direction, shown)[channel];
    if (shown.through > 0.0) {
        var behind = panel.comb.z;
        if (panel.ground.w > 0.5) { behind = ground_at(px, py, eye, channel); }
        value += shown.through * behind;
    }
    return clamp(value, 0.0, 1.0);
}

fn code(x: u32, row: u32, k: u32) -> u32 {
    let line = u32(panel.rows.z) + row * u32(panel.rows.w);
    let number = 6u * (line & 3u) + 3u * (x & 1u) + k;
    let moved = panel.moved[number >> 2u][number & 3u];
    let px = panel.shape.x * (2.0 * (f32(3u * x + k) + 0.5 + moved) / panel.rows.x - 1.0);
    let py = 1.0 - 2.0 * (f32(line) + 0.5) / panel.rows.y;
    let eye = eye_of(phase_of(x, line, k));
    let channel = select(k, 2u - k, panel.texel.w > 0.5);
    let rays = u32(panel.rays.x);
    if (rays == 1u) { return u32(seen_by(px, py, eye, channel, row - panel.size.y) * 255.0 + 0.5); }
    var light = 0.0;
    for (var ray = 0u; ray < rays; ray++) {
        let away = ((f32(ray) + 0.5) / f32(rays) - 0.5) * panel.rays.y;
        light += pow(seen_by(px, py, eye + away, channel, row - panel.size.y), panel.rays.z);
    }
    return u32(pow(light / f32(rays), 1.0 / panel.rays.z) * 255.0 + 0.5);
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let left = group.x * WIDE;
    let top = panel.size.y + group.y * 16u;
    if (thread < 64u) { atomicStore(&tally[thread], 0u); }
    workgroupBarrier();
    var keys: array<u32, 3>;
    for (var turn = 0u; turn < 3u; turn++) {
        let entry = thread + 256u * turn;
        if (sorted) {
            // A third of the entries for each color, rows of 16 pixels.
            let place = entry & 255u;
            let line = u32(panel.rows.z) + (top + (place >> 4u)) * u32(panel.rows.w);
            keys[turn] = phase_of(left + (place & 15u), line, entry >> 8u) >> 26u;
            atomicAdd(&tally[keys[turn]], 1u);
        } else {
            order[entry] = entry;
        }
    }
    workgroupBarrier();
    if (sorted) {
        if (thread == 0u) {
            var sum = 0u;
            for (var i = 0u; i < 64u; i++) {
                let many = atomicLoad(&tally[i]);
                atomicStore(&tally[i], sum);
                sum += many;
            }
        }
        workgroupBarrier();
        for (var turn = 0u; turn < 3u; turn++) {
            order[atomicAdd(&tally[keys[turn]], 1u)] = thread + 256u * turn;
        }
    }
    workgroupBarrier();
    for (var turn = 0u; turn < 3u; turn++) {
        let entry = order[thread + 256u * turn];
        let place = entry & 255u;
        let x = left + (place & 15u);
        let row = top + (place >> 4u);
        let k = entry >> 8u;
        var value = 0u;
        if (x < panel.size.x && row < panel.size.y + panel.size.z) { value = code(x, row, k); }
        let channel = select(k, 2u - k, panel.texel.w > 0.5);
        values[3u * place + channel] = value;
    }
    workgroupBarrier();
    if (thread < 192u) {
        let row = group.y * 16u + thread / 12u;
        if (row < panel.size.z) {
            let at = 4u * thread;
            picture[row * panel.size.w + group.x * 12u + thread % 12u] =
                values[at] | values[at + 1u] << 8u | values[at + 2u] << 16u | values[at + 3u] << 24u;
        }
    }
}
