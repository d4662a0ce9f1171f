// Casting a ray through the atlas of a field's bricks (Shen et al. 2023, Eq. 1).
//
// Positions are in lattice units. Samples lie on the comb t = comb.x + k comb.y, whatever is
// skipped, so that skipping changes nothing: empty space by the bricks' distances to the nearest
// occupied one, empty cells of a brick by its mask of 64 bits. Density and color are one look-up.

struct March {
    // Lattice points along x, y, z; density that counts.
    size: vec4<f32>,
    // Bricks of the table along x, y, z; bricks of the atlas along x.
    table: vec4<u32>,
    // One over the atlas' size in texels; its bricks along y.
    atlas: vec4<f32>,
    // Transmittance to stop at; 1: what lies behind the stop has the same color; the texture's
    // strength, 0 if there is none.
    stop: f32,
    whole: f32,
    textured: f32,
    pad: f32,
}

struct Shown {
    color: vec3<f32>,
    through: f32,
    // Lattice distance at which half the light is gone, or beyond everything.
    depth: f32,
}

const NOWHERE = 3.0e38;

@group(0) @binding(0) var<uniform> field: March;
@group(0) @binding(1) var<storage, read> table: array<i32>;
@group(0) @binding(2) var<storage, read> masks: array<vec2<u32>>;
@group(0) @binding(3) var atlas: texture_3d<f32>;
@group(0) @binding(4) var linear: sampler;
@group(0) @binding(5) var<storage, read> cells: array<u32>;
@group(0) @binding(6) var<storage, read> charts: array<vec4<f32>>;
@group(0) @binding(7) var texels: texture_2d<f32>;

fn entry_of(brick: vec3<i32>) -> i32 {
    let size = vec3<i32>(field.table.xyz);
    return table[(brick.z * size.y + brick.y) * size.x + brick.x];
}

fn cell_of(p: vec3<f32>) -> vec3<i32> {
    return min(vec3<i32>(max(p, vec3<f32>(0.0))), vec3<i32>(field.size.xyz) - vec3<i32>(2));
}

// Where a ray enters and leaves the lattice; x > y: it never does.
fn enter(origin: vec3<f32>, direction: vec3<f32>) -> vec2<f32> {
    let last = field.size.xyz - 1.0;
    let flat = abs(direction) < vec3<f32>(1e-9);
    let inverse = 1.0 / select(direction, vec3<f32>(1.0), flat);
    let a = -origin * inverse;
    let b = (last - origin) * inverse;
    let outside = flat & ((origin < vec3<f32>(0.0)) | (origin > last));
    let near = select(min(a, b), vec3<f32>(0.0), flat);
    let far = select(select(max(a, b), vec3<f32>(1e30), flat), vec3<f32>(-1.0), outside);
    return vec2<f32>(max(max(near.x, near.y), max(near.z, 0.0)), min(far.x, min(far.y, far.z)));
}

// Samples where a ray crosses the planes of an axis (1, 2, 3), some planes apart: comb, and bounds
// that take in what lies on the lattice's border, as row slices do.
struct Planes {
    comb: vec2<f32>,
    bounds: vec2<f32>,
}

fn planes_of(origin: vec3<f32>, direction: vec3<f32>, bounds: vec2<f32>, axis: u32,
             apart: f32) -> Planes {
    let across = direction[axis - 1u];
    let first = select(0.0, field.size[axis - 1u] - 1.0, across < 0.0);
    let comb = vec2<f32>((first - origin[axis - 1u]) / across, apart / max(abs(across), 1e-6));
    return Planes(comb, bounds + vec2<f32>(-1e-3, 1e-3) * comb.y);
}

fn march(origin: vec3<f32>, direction: vec3<f32>, comb: vec2<f32>, bounds: vec2<f32>, delta: f32,
         layer: f32) -> Shown {
    var out = Shown(vec3<f32>(0.0), 1.0, NOWHERE);
    let tiny = vec3<f32>(1e-9);
    let inverse = 1.0 / select(direction, tiny, abs(direction) < tiny);
    let ahead = direction > vec3<f32>(0.0);
    let side = field.table.w;
    let down = u32(field.atlas.w);
    var k = max(ceil((bounds.x - comb.x) / comb.y), 0.0);
    var t = comb.x + k * comb.y;
    var seen = vec3<i32>(-1);
    var entry = -1;
    var mask = vec2<u32>(0u);
    var spot = vec3<f32>(0.0);
    while (t < bounds.y && out.through > field.stop) {
        let p = origin + t * direction;
        let cell = cell_of(p);
        let brick = cell >> vec3<u32>(2u);
        if (any(brick != seen)) {
            seen = brick;
            entry = entry_of(brick);
            if (entry >= 0) {
                let number = u32(entry);
                mask = masks[number];
                spot = vec3<f32>(vec3<u32>(number % side, (number / side) % down,
                                           number / (side * down))) * 5.0
                       + vec3<f32>(0.5, 0.5, 0.5 + layer) - vec3<f32>(4 * brick);
            }
        }
        if (entry < 0) {
            let reach = f32(-entry - 1) * 4.0;
            let low = vec3<f32>(4 * brick) - reach;
            let wall = select(low, low + (2.0 * reach + 4.0), ahead);
            let leave = (wall - p) * inverse;
            let far = max(min(leave.x, min(leave.y, leave.z)), 0.0);
            k += min(floor(far / comb.y) + 1.0, 1e6);
            t = comb.x + k * comb.y;
            continue;
        }
        let inner = vec3<u32>(cell) & vec3<u32>(3u);
        let bit = (inner.z & 1u) * 16u + inner.y * 4u + inner.x;
        if (((select(mask.x, mask.y, inner.z > 1u) >> bit) & 1u) == 1u) {
            let value = textureSampleLevel(atlas, linear, (p + spot) * field.atlas.xyz, 0.0);
            if (value.w > field.size.w) {
                let fade = exp(-(value.w * delta));
                let after = out.through * fade;
                out.color += (out.through - after) * max(value.xyz + 0.5, vec3<f32>(0.0));
                if (out.through >= 0.5 && after < 0.5) {
                    let part = (out.through - 0.5) / max(out.through - after, 1e-12);
                    out.depth = t + (part - 0.5) * comb.y;
                }
                out.through = after;
            }
        }
        k += 1.0;
        t = comb.x + k * comb.y;
    }
    if (field.whole > 0.5 && out.through <= field.stop) {
        out.color /= 1.0 - out.through;
        out.through = 0.0;
    }
    return out;
}

// The texture's share of a ray's color: all of it where the ray is nearly opaque.
fn texture_share(through: f32) -> f32 {
    return min(2.0 - 4.0 * through, 1.0);
}

// The chart that shows a place, or -1.
fn chart_of(p: vec3<f32>) -> i32 {
    let cell = cell_of(p);
    let entry = entry_of(cell >> vec3<u32>(2u));
    if (entry < 0) { return -1; }
    let inner = vec3<u32>(cell) & vec3<u32>(3u);
    let at = u32(entry) * 128u + inner.z * 25u + inner.y * 5u + inner.x;
    let chart = (cells[at >> 2u] >> (8u * (at & 3u))) & 255u;
    return select(i32(chart), -1, chart == 255u);
}

// The texture's difference at a place that a chart shows.
fn look_up(chart: i32, p: vec3<f32>) -> vec3<f32> {
    if (chart < 0) { return vec3<f32>(0.0); }
    let first = 3 * chart;
    let q = vec4<f32>(p, 1.0);
    let over = 1.0 / dot(charts[first + 2], q);
    let uv = vec2<f32>(dot(charts[first], q), dot(charts[first + 1], q)) * over;
    let size = vec2<f32>(textureDimensions(texels));
    let inside = all(uv >= vec2<f32>(0.5)) && all(uv < size - 0.5);
    let value = textureSampleLevel(texels, linear, uv / size, 0.0).xyz * (127.0 / 254.0);
    return select(vec3<f32>(0.0), value, inside);
}

// The texture where a ray ends, by its share.
fn detail(origin: vec3<f32>, direction: vec3<f32>, shown: Shown) -> vec3<f32> {
    let share = texture_share(shown.through);
    if (field.textured <= 0.0 || share <= 0.0 || shown.depth > 1e30) { return vec3<f32>(0.0); }
    let p = origin + shown.depth * direction;
    return field.textured * share * look_up(chart_of(p), p);
}
