// What a sub-pixel's ray meets, cast through the atlas of bricks; colors are those of the nearest eye
// that they were evaluated for.

fn met(origin: vec3<f32>, direction: vec3<f32>, norm: f32, eye: f32, row: u32) -> Shown {
    var bounds = enter(origin, direction);
    if (bounds.x >= bounds.y) { return Shown(vec3<f32>(0.0), 1.0, NOWHERE); }
    var comb = vec2<f32>(bounds.x, panel.comb.y);
    let axis = u32(panel.comb.x);
    if (axis > 0u) {
        let planes = planes_of(origin, direction, bounds, axis, panel.comb.y);
        comb = planes.comb;
        bounds = planes.bounds;
    }
    let layers = panel.comb.w;
    let between = (eye - panel.eyes.x) / max(panel.eyes.y - panel.eyes.x, 1e-9);
    let layer = clamp(floor(between * layers), 0.0, layers - 1.0) / layers;
    return march(origin, direction, comb, bounds, comb.y / (norm * panel.shape.w),
                 layer / field.atlas.z);
}
