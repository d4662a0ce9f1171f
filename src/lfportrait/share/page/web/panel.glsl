// A light-field panel: one ray for each sub-pixel, of which its own color is shown.
//
// A sub-pixel's phase under its lens is 3 x + step + y shift + offset, modulo the pitch (Shen et al.
// 2023, Eq. 8; lightfield/display.py). Whole panels are wider than single precision tells apart, so
// the columns' and the rows' shares come as textures, each modulo the pitch. Its ray runs from its
// view's eye point through its own place on the panel.

uniform sampler2D columnPhase;
uniform sampler2D rowPhase;
uniform float subpixelStep[24]; // by row mod 4, column mod 2, sub-pixel
uniform float subpixelMoved[24]; // to the right of its usual third, in sub-pixels
uniform ivec2 panelSize;
uniform ivec2 mirrored;        // 1 where the panel shows its picture mirrored along x, y
uniform float views;
uniform float pitch;
uniform bool inverted;
uniform bool reversed;         // blue first
uniform bool continuous;       // a sub-pixel's own place between two views
uniform float eyeReach;        // x of the cone's edge; lengths in half panel heights
uniform float eyeHeight;
uniform float eyeDistance;
uniform float perUnit;         // half panel heights a world unit
uniform mat3 toLattice;        // display frame to lattice coordinates
uniform vec3 latticeShift;
uniform mat3 toWorld;
uniform int rays;              // of each sub-pixel, over the directions that its lens sends it to
uniform float gamma;
uniform vec3 ground;
#ifdef GROUNDED
uniform vec2 groundMoved;      // where the head's middle lies, in half panel heights
#endif

out vec4 result;

float seen(vec3 eye, vec3 place, int channel) {
  vec3 direction = normalize(place - eye);
  prepare(toWorld * direction);
  vec3 along = toLattice * direction;
  float norm = length(along);
  vec4 shown = seenAlong(toLattice * eye + latticeShift, along / norm,
    stepSize / (norm * perUnit), 0.0);
  vec3 behind = ground;
#ifdef GROUNDED
  // The ground stands still, and is as far behind the head as on all panels.
  vec3 seen = groundSeen((eye - vec3(groundMoved, 0.0)) / perUnit, (place - eye) / eyeDistance);
  behind = mix(behind, seen, groundShare);
#endif
  return clamp(shown[channel] + (1.0 - shown.a) * behind[channel], 0.0, 1.0);
}

void main() {
  ivec2 sent = ivec2(gl_FragCoord.x, float(panelSize.y) - gl_FragCoord.y);
  ivec2 pixel = sent + mirrored * (panelSize - 1 - 2 * sent);
  float base = texelFetch(columnPhase, ivec2(pixel.x, 0), 0).r
    + texelFetch(rowPhase, ivec2(pixel.y, 0), 0).r;
  float aspect = float(panelSize.x) / float(panelSize.y);
  float y = 1.0 - 2.0 * (float(pixel.y) + 0.5) / float(panelSize.y);
  vec3 coded = vec3(0.0);
  for (int k = 0; k < 3; k++) {
    int own = 6 * (pixel.y & 3) + 3 * (pixel.x & 1) + k;
    float phase = base + subpixelStep[own];
    phase -= pitch * floor(phase / pitch);
    if (phase >= pitch) phase = 0.0;
    if (inverted && phase > 0.0) phase = pitch - phase;
    float view = min(floor(phase * views / pitch), views - 1.0);
    if (continuous) view = clamp(phase / pitch * views - 0.5, 0.0, views - 1.0);
    float eye = eyeReach * (2.0 * (view + 0.5) / views - 1.0);
    float column = float(pixel.x) + (float(k) + 0.5 + subpixelMoved[own]) / 3.0;
    vec3 place = vec3(aspect * (2.0 * column / float(panelSize.x) - 1.0), y, 0.0);
    int channel = reversed ? 2 - k : k;
    float light = 0.0;
    for (int ray = 0; ray < rays; ray++) {
      float away = 2.0 * eyeReach / pitch * ((float(ray) + 0.5) / float(rays) - 0.5);
      float value = seen(vec3(eye + away, eyeHeight, eyeDistance), place, channel);
      light += rays > 1 ? pow(value, gamma) : value;
    }
    coded[channel] = rays > 1 ? pow(light / float(rays), 1.0 / gamma) : light;
  }
  result = vec4(coded, 1.0);
}
