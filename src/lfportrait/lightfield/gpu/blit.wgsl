// A coded picture onto the pixels of a window or a texture, one for one.
//
// The picture's bytes lie as the panel's kernel wrote them: red, green, blue, pixel after pixel,
// rows of whole tiles. A coarse picture has every n-th row only; each stands for n rows.

struct Blit {
    // Width and height of the panel; words of a row; rows there are.
    size: vec4<u32>,
    // 1: mirrored left to right, upside down; rows that each stands for.
    turned: vec4<u32>,
}

@group(0) @binding(0) var<uniform> blit: Blit;
@group(0) @binding(1) var<storage, read> picture: array<u32>;

@vertex
fn corner(@builtin(vertex_index) number: u32) -> @builtin(position) vec4<f32> {
    // One triangle that covers everything.
    let x = f32((number << 1u) & 2u);
    let y = f32(number & 2u);
    return vec4<f32>(2.0 * x - 1.0, 2.0 * y - 1.0, 0.0, 1.0);
}

fn byte_at(place: u32) -> f32 {
    return f32((picture[place >> 2u] >> (8u * (place & 3u))) & 255u) / 255.0;
}

@fragment
fn pixel(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let last = blit.size.xy - vec2<u32>(1u);
    let own = min(vec2<u32>(at.xy), last);
    let x = select(own.x, last.x - own.x, blit.turned.x == 1u);
    let y = select(own.y, last.y - own.y, blit.turned.y == 1u);
    let row = min(y / blit.turned.z, blit.size.w - 1u);
    let place = 4u * blit.size.z * row + 3u * x;
    return vec4<f32>(byte_at(place), byte_at(place + 1u), byte_at(place + 2u), 1.0);
}
