// One ray through the field: the renderer's march (field/kernels/march.py) on the GPU.
//
// Positions are in lattice units: lattice point i lies at coordinate i. The lattice is cut into
// bricks of 4x4x4 cells. `bricks` holds an entry for each: place of the brick in the atlas, and its
// distance to the nearest occupied brick, 0 where it is occupied itself. An occupied brick has its
// 5x5x5 points in the atlas, so that the texture unit can interpolate without its neighbours.
// Samples lie on the comb t = start + (k + jitter) step, whatever is skipped.

precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler3D;
precision highp usampler3D;

uniform usampler3D bricks;
uniform sampler3D matter;      // density per world unit
uniform sampler3D first;       // colors: two sets, of which `blend` tells the second one's share
uniform sampler3D second;      // bands of harmonics lie one behind the other
uniform float blend;
uniform vec2 firstTone[BANDS];   // value of a stored 0, and what a stored 1 has more
uniform vec2 secondTone[BANDS];
uniform ivec3 points;          // lattice points along x, y, z
uniform vec3 texel;            // one over the atlas' size
uniform float stepSize;        // distance between samples in voxels
uniform float stop;            // transmittance at which a ray ends

const float THRESHOLD = 1e-2;  // densities up to this are skipped
const int MOST = 4096;

float basis[BANDS];
float fetches = 0.0;           // texture fetches of this pixel, for measuring
float surface;                 // where the last ray's transmittance passed one half

void prepare(vec3 direction) {
  basis[0] = 1.0;              // the first band is stored as a color
#if BANDS > 1
  basis[1] = -0.4886025119029199 * direction.y;
  basis[2] = 0.4886025119029199 * direction.z;
  basis[3] = -0.4886025119029199 * direction.x;
#endif
#if BANDS > 4
  basis[4] = 1.0925484305920792 * direction.x * direction.y;
  basis[5] = -1.0925484305920792 * direction.y * direction.z;
  basis[6] = 0.31539156525252005 * (2.0 * direction.z * direction.z
    - direction.x * direction.x - direction.y * direction.y);
  basis[7] = -1.0925484305920792 * direction.x * direction.z;
  basis[8] = 0.5462742152960396 * (direction.x * direction.x - direction.y * direction.y);
#endif
}

vec3 summed(sampler3D colors, vec2 tone[BANDS], vec3 place) {
  vec3 color = vec3(0.0);
  for (int band = 0; band < BANDS; band++) {
    vec3 stored = texture(colors, vec3(place.xy, (place.z + float(band)) / float(BANDS))).rgb;
    color += basis[band] * (tone[band].x + tone[band].y * stored);
  }
  fetches += float(BANDS);
  return color;
}

vec3 shade(vec3 place) {
  if (blend <= 0.0) return max(summed(first, firstTone, place), 0.0);
  if (blend >= 1.0) return max(summed(second, secondTone, place), 0.0);
  vec3 from = summed(first, firstTone, place);
  return max(mix(from, summed(second, secondTone, place), blend), 0.0);
}

// Color and opacity of a ray from `origin` along the unit vector `direction`; `delta` is a step in
// world units.
vec4 march(vec3 origin, vec3 direction, float delta, float jitter) {
  vec3 safe = mix(direction, vec3(1e-9), lessThan(abs(direction), vec3(1e-9)));
  vec3 inverse = 1.0 / safe;
  vec3 near = -origin * inverse;
  vec3 far = (vec3(points - 1) - origin) * inverse;
  vec3 low = min(near, far), high = max(near, far);
  float start = max(max(low.x, low.y), max(low.z, 0.0));
  float end = min(min(high.x, high.y), high.z);

  vec3 color = vec3(0.0);
  float through = 1.0;
  float k = jitter, t = start + k * stepSize, leave = -1.0;
  vec3 corner = vec3(0.0);
  for (int i = 0; i < MOST; i++) {
    if (t >= end || through <= stop) break;
    vec3 here = origin + t * direction;
    if (t >= leave) {
      ivec3 brick = clamp(ivec3(here), ivec3(0), points - 2) >> 2;
      uvec4 entry = texelFetch(bricks, brick, 0);
      fetches += 1.0;
      bool vacant = entry.a > 0u;
      float reach = vacant ? 4.0 * float(entry.a) - 4.0 : 0.0;
      vec3 bottom = vec3(brick << 2) - reach;
      vec3 side = mix(bottom, bottom + 2.0 * reach + 4.0, greaterThan(direction, vec3(0.0)));
      vec3 ways = (side - here) * inverse;
      float way = max(min(min(ways.x, ways.y), ways.z), 0.0);
      if (vacant) {
        k += floor(way / stepSize) + 1.0;
        t = start + k * stepSize;
        continue;
      }
      corner = vec3(entry.rgb) * 5.0 + 0.5 - bottom;
      leave = t + way;
    }
    vec3 place = (corner + here) * texel;
    float sigma = texture(matter, place).r;
    fetches += 1.0;
    if (sigma > THRESHOLD) {
      float fade = exp(-sigma * delta);
      color += through * (1.0 - fade) * shade(place);
      float after = through * fade;
      if (through >= 0.5 && after < 0.5) {
        // To first order the half is reached in proportion.
        surface = t + ((through - 0.5) / max(through - after, 1e-12) - 0.5) * stepSize;
      }
      through = after;
    }
    k += 1.0;
    t = start + k * stepSize;
  }
  return vec4(color, 1.0 - through);
}

// A number in [0, 1) for each pixel without visible pattern (interleaved gradient noise).
float noise(vec2 pixel) {
  return fract(52.9829189 * fract(dot(pixel, vec2(0.06711056, 0.00583715))));
}
