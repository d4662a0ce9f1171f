// The atlas of a field's bricks: density and color of their 5 x 5 x 5 points, as one texture.
//
// A brick's workgroup has a thread a point. Colors are spherical harmonics seen from one eye: a
// point's direction to the eye is the same for every ray through it, so that they are evaluated
// once a point and not once a sample. Several eyes have layers of their own. Points may have other
// colors, too (a photo's beside its painting's): what is stored is a mixture of both.

override basis: u32 = 1u;
override width: u32 = 16u;
// Of the other colors; no coefficients: there are none.
override other_basis: u32 = 0u;
override other_width: u32 = 16u;

struct Shade {
    // Lattice coordinate = world * scale + offset.
    scale: vec4<f32>,
    offset: vec4<f32>,
    eye: vec4<f32>,
    // Bricks of this page: the first one's number, how many; bricks of the atlas along x and y.
    page: vec4<u32>,
    // Rows of this page: first, last + 1; the row that stands for empty points; first layer's z.
    rows: vec4<u32>,
    // Density that counts, workgroups along x, the other colors' share.
    least: f32,
    columns: u32,
    share: f32,
}

@group(0) @binding(0) var<uniform> shade: Shade;
@group(0) @binding(1) var<storage, read> links: array<u32>;
@group(0) @binding(2) var<storage, read> densities: array<u32>;
@group(0) @binding(3) var<storage, read> rows: array<u32>;
@group(0) @binding(4) var<storage, read> places: array<u32>;
@group(0) @binding(5) var<storage, read_write> masks: array<vec2<u32>>;
@group(0) @binding(6) var atlas: texture_storage_3d<rgba16float, write>;
@group(0) @binding(7) var<storage, read> others: array<u32>;

var<workgroup> own: array<f32, 128>;
var<workgroup> mask: array<atomic<u32>, 2>;

fn half_of(word: u32, second: bool) -> f32 {
    let pair = unpack2x16float(word);
    return select(pair.x, pair.y, second);
}

fn harmonic(j: u32, d: vec3<f32>) -> f32 {
    switch j {
        case 0u: { return 0.28209479177387814; }
        case 1u: { return -0.4886025119029199 * d.y; }
        case 2u: { return 0.4886025119029199 * d.z; }
        case 3u: { return -0.4886025119029199 * d.x; }
        case 4u: { return 1.0925484305920792 * d.x * d.y; }
        case 5u: { return -1.0925484305920792 * d.y * d.z; }
        case 6u: { return 0.31539156525252005 * (2.0 * d.z * d.z - d.x * d.x - d.y * d.y); }
        case 7u: { return -1.0925484305920792 * d.x * d.z; }
        default: { return 0.5462742152960396 * (d.x * d.x - d.y * d.y); }
    }
}

fn coefficient(row: u32, number: u32) -> f32 {
    let at = (row - shade.rows.x) * width + number;
    return half_of(rows[at >> 1u], (at & 1u) == 1u);
}

fn other_coefficient(row: u32, number: u32) -> f32 {
    let at = (row - shade.rows.x) * other_width + number;
    return half_of(others[at >> 1u], (at & 1u) == 1u);
}

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) slot: u32) {
    let number = group.y * shade.columns + group.x;
    let inside = number < shade.page.y;
    let brick = shade.page.x + number;
    if (slot < 2u) { atomicStore(&mask[slot], 0u); }
    var sigma = 0.0;
    if (inside && slot < 125u) {
        let at = number * 128u + slot;
        sigma = half_of(densities[at >> 1u], (at & 1u) == 1u);
    }
    own[slot] = sigma;
    workgroupBarrier();
    if (slot < 64u) {
        let low = (slot >> 4u) * 25u + ((slot >> 2u) & 3u) * 5u + (slot & 3u);
        var most = 0.0;
        for (var corner = 0u; corner < 8u; corner++) {
            most = max(most, own[low + (corner >> 2u) * 25u + ((corner >> 1u) & 1u) * 5u
                                 + (corner & 1u)]);
        }
        if (most > shade.least) { atomicOr(&mask[slot >> 5u], 1u << (slot & 31u)); }
    }
    workgroupBarrier();
    if (!inside) { return; }
    if (slot == 0u) {
        masks[brick] = vec2<u32>(atomicLoad(&mask[0]), atomicLoad(&mask[1]));
    }
    if (slot >= 125u) { return; }
    let row = links[number * 128u + slot];
    let empty = row == shade.rows.z;
    // Rows come in pages; empty points are written with the first one.
    if (!(empty && shade.rows.x == 0u) && (row < shade.rows.x || row >= shade.rows.y)) { return; }
    let inner = vec3<u32>(slot % 5u, (slot / 5u) % 5u, slot / 25u);
    var color = vec3<f32>(0.0);
    if (!empty) {
        let place = places[brick];
        let corner = 4u * vec3<u32>(place & 1023u, (place >> 10u) & 1023u, place >> 20u) + inner;
        let world = (vec3<f32>(corner) - shade.offset.xyz) / shade.scale.xyz;
        let direction = normalize(world - shade.eye.xyz);
        for (var j = 0u; j < basis; j++) {
            let share = harmonic(j, direction);
            color += share * vec3<f32>(coefficient(row, j), coefficient(row, basis + j),
                                       coefficient(row, 2u * basis + j));
        }
        if (other_basis > 0u && shade.share > 0.0) {
            var other = vec3<f32>(0.0);
            for (var j = 0u; j < other_basis; j++) {
                other += harmonic(j, direction)
                         * vec3<f32>(other_coefficient(row, j),
                                     other_coefficient(row, other_basis + j),
                                     other_coefficient(row, 2u * other_basis + j));
            }
            color = mix(color, other, shade.share);
        }
    }
    let side = shade.page.z;
    let spot = vec3<u32>(brick % side, (brick / side) % shade.page.w,
                         brick / (side * shade.page.w)) * 5u + inner;
    textureStore(atlas, spot + vec3<u32>(0u, 0u, shade.rows.w), vec4<f32>(color, sigma));
}
