// The texture of the surface (field/kernels/texture.py): what the lattice is too coarse for.
//
// A ray that has met the surface looks up its cell's chart, then the place there, and adds what it
// finds by its opacity.

#ifdef TEXTURED
uniform usampler3D cells;      // chart of each cell of the bricks in the atlas, 255 for none
uniform sampler2D charts;      // a row for each: the rows of its map from lattice points to texels
uniform sampler2D firstTexels; // differences of the two color sets, 128/255 for none
uniform sampler2D secondTexels;
uniform bvec2 textured;        // whether the sets have any
uniform float level;           // octaves of the pyramid, from the texture's own resolution on
uniform int finest;            // octave that the device's texture begins with

vec3 texels(sampler2D octaves, vec2 place, int octave) {
  vec2 size = vec2(textureSize(octaves, octave - finest));
  place = clamp(place * exp2(-float(octave)), vec2(0.5), size - 0.5) / size;
  fetches += 1.0;
  return (255.0 * textureLod(octaves, place, float(octave - finest)).rgb - 128.0) / 254.0;
}

vec3 texels(sampler2D octaves, vec2 place) {
  int octave = int(level);
  vec2 there = place * exp2(-float(octave));
  vec2 size = vec2(textureSize(octaves, octave - finest));
  if (any(lessThan(there, vec2(0.5))) || any(greaterThanEqual(there, size - 0.5))) return vec3(0.0);
  vec3 found = texels(octaves, place, octave);
  float share = fract(level);
  return share > 0.0 ? mix(found, texels(octaves, place, octave + 1), share) : found;
}

vec3 detail(vec3 here) {
  ivec3 cell = clamp(ivec3(here), ivec3(0), points - 2);
  uvec4 entry = texelFetch(bricks, cell >> 2, 0);
  if (entry.a > 0u) return vec3(0.0);
  int chart = int(texelFetch(cells, (ivec3(entry.rgb) << 2) + (cell & 3), 0).r);
  if (chart == 255) return vec3(0.0);
  vec4 from = vec4(here, 1.0);
  vec2 place = vec2(dot(texelFetch(charts, ivec2(0, chart), 0), from),
    dot(texelFetch(charts, ivec2(1, chart), 0), from));
  place /= dot(texelFetch(charts, ivec2(2, chart), 0), from);
  fetches += 5.0;
  vec3 found = vec3(0.0);
  if (textured.x && blend < 1.0) found += (1.0 - blend) * texels(firstTexels, place);
  if (textured.y && blend > 0.0) found += blend * texels(secondTexels, place);
  return found;
}
#endif

// Color and opacity of a ray, with its texture; as `march` takes it.
vec4 seenAlong(vec3 origin, vec3 direction, float delta, float jitter) {
  vec4 seen = march(origin, direction, delta, jitter);
#ifdef TEXTURED
  // All of it where the ray is nearly opaque, none where half the light passes.
  float share = min(4.0 * seen.a - 2.0, 1.0);
  if (share > 0.0) {
    seen.rgb = max(seen.rgb + share * detail(origin + surface * direction), 0.0);
  }
#endif
  return seen;
}
