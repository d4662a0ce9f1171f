// A pinhole view: one ray for each pixel, colors premultiplied by opacity.

uniform mat3 turn;             // camera to world; the camera looks along +z, y down
uniform vec3 eye;              // in the world
uniform vec4 lens;             // focal lengths and principal point in pixels, from the top left
uniform vec2 size;             // of the picture in pixels
uniform vec3 scale;            // lattice coordinate = world * scale + shift
uniform vec3 shift;
uniform vec2 nudge;            // where in the pixel the ray goes through, from its middle
uniform vec2 jitter;           // share of a step by which samples move: the same for all, and noise

out vec4 result;

void main() {
  vec2 pixel = vec2(gl_FragCoord.x, size.y - gl_FragCoord.y) + nudge;
  vec3 ray = turn * vec3((pixel - lens.zw) / lens.xy, 1.0);
  vec3 direction = normalize(ray);
  prepare(direction);
  vec3 along = direction * scale;
  float norm = length(along);
  float moved = fract(jitter.x + jitter.y * noise(gl_FragCoord.xy));
  result = seenAlong(eye * scale + shift, along / norm, stepSize / norm, moved);
#ifdef GROUNDED
  result += (1.0 - result.a) * groundShare * vec4(groundSeen(eye, ray), 1.0);
#endif
#ifdef COUNT
  result = vec4(mod(fetches, 256.0) / 255.0, floor(fetches / 256.0) / 255.0, result.a, 1.0);
#endif
}
