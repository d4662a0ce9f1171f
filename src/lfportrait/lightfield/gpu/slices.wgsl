// What a sub-pixel's ray meets, through a slice of the field for each row of the panel.
//
// All rays of a row lie in one plane (see `lightfield.kernels.slices`). `build` interpolates the
// lattice in it, plane by plane z = k, and notes from where to where there is anything, of each plane
// and of sixteen together. In a slice a ray is a straight line x(k), and a sample one look-up of two
// texels.

struct Slice {
    // Lattice row of the plane at (i, k): x + y i + z k at a height of 0, and what each unit adds.
    base: vec4<f32>,
    rise: vec4<f32>,
}

const TOGETHER = 16u;
const NONE = 0xffffu;

@group(0) @binding(11) var<uniform> slice: Slice;
@group(0) @binding(12) var slab: texture_storage_2d_array<rgba16float, write>;
@group(0) @binding(13) var<storage, read_write> filled: array<atomic<u32>>;
@group(0) @binding(14) var slabs: texture_2d_array<f32>;
@group(0) @binding(15) var<storage, read> spans: array<u32>;

fn planes() -> u32 { return u32(field.size.z); }

fn groups() -> u32 { return (planes() + TOGETHER - 1u) / TOGETHER; }

@compute @workgroup_size(64)
fn empty(@builtin(global_invocation_id) id: vec3<u32>) {
    // First column and, from the other end, last: the least of both is kept.
    if (id.x < arrayLength(&filled)) { atomicStore(&filled[id.x], NONE); }
}

@compute @workgroup_size(64)
fn build(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x;
    let k = id.y;
    let row = id.z;
    if (i >= u32(field.size.x)) { return; }
    let line = u32(panel.rows.z) + (panel.size.y + row) * u32(panel.rows.w);
    let height = 1.0 - 2.0 * (f32(line) + 0.5) / panel.rows.y;
    let at = vec3<f32>(1.0, f32(i), f32(k));
    let y = dot(slice.base.xyz + height * slice.rise.xyz, at);
    var value = vec4<f32>(0.0);
    if (y >= -1e-3 && y <= field.size.y - 1.0 + 1e-3) {
        let p = vec3<f32>(f32(i), y, f32(k));
        let brick = cell_of(p) >> vec3<u32>(2u);
        let entry = entry_of(brick);
        if (entry >= 0) {
            let number = u32(entry);
            let side = field.table.w;
            let down = u32(field.atlas.w);
            let spot = vec3<f32>(vec3<u32>(number % side, (number / side) % down,
                                           number / (side * down)) * 5u) + 0.5
                       - vec3<f32>(4 * brick);
            value = textureSampleLevel(atlas, linear, (p + spot) * field.atlas.xyz, 0.0);
        }
    }
    textureStore(slab, vec2<u32>(i, k), row, value);
    if (value.w > field.size.w) {
        let many = planes() + groups();
        for (var turn = 0u; turn < 2u; turn++) {
            let place = 2u * (row * many + select(k, planes() + k / TOGETHER, turn == 1u));
            atomicMin(&filled[place], i);
            atomicMin(&filled[place + 1u], NONE - 1u - i);
        }
    }
}

// Whether a stretch of a row reaches what a plane, or a group of planes, has.
fn reaches(place: u32, low: f32, high: f32) -> bool {
    let first = spans[place];
    let last = NONE - 1u - spans[place + 1u];
    return first != NONE && high > f32(first) - 1.0 && low < f32(last) + 1.0;
}

fn met(origin: vec3<f32>, direction: vec3<f32>, norm: f32, eye: f32, row: u32) -> Shown {
    var out = Shown(vec3<f32>(0.0), 1.0, NOWHERE);
    let across = direction.z;
    let slope = direction.x / across;
    let start = origin.x - slope * origin.z;
    let apart = u32(panel.comb.y);
    let delta = panel.comb.y / (abs(across) * norm * panel.shape.w);
    let many = planes() + groups();
    let last = f32(planes() - 1u);
    let size = field.size.xz;
    for (var group = i32(groups()) - 1; group >= 0; group--) {
        let back = u32(group) * TOGETHER;
        let front = min(back + TOGETHER, planes()) - 1u;
        let a = start + slope * f32(front);
        let b = start + slope * f32(back);
        if (!reaches(2u * (row * many + planes() + u32(group)), min(a, b), max(a, b))) { continue; }
        // Every ``apart``-th plane, from the last one on.
        let skipped = (planes() - 1u - front) % apart;
        for (var k = i32(front - min((apart - skipped) % apart, front)); k >= i32(back);
             k -= i32(apart)) {
            let x = start + slope * f32(k);
            if (!reaches(2u * (row * many + u32(k)), x, x)) { continue; }
            if (x < -1e-3 || x > size.x - 1.0 + 1e-3) { continue; }
            let value = textureSampleLevel(slabs, linear, (vec2<f32>(x, f32(k)) + 0.5) / size, row,
                                           0.0);
            if (value.w <= field.size.w) { continue; }
            let fade = exp(-(value.w * delta));
            let after = out.through * fade;
            out.color += (out.through - after) * max(value.xyz + 0.5, vec3<f32>(0.0));
            if (out.through >= 0.5 && after < 0.5) {
                let part = (out.through - 0.5) / max(out.through - after, 1e-12) - 0.5;
                out.depth = (f32(k) - part * f32(apart) - origin.z) / across;
            }
            out.through = after;
            if (after <= field.stop) {
                out.color /= 1.0 - after;
                out.through = 0.0;
                return out;
            }
        }
    }
    return out;
}
