// The painted ground: a plane behind the head, whose picture is mirrored beyond its borders.

#ifdef GROUNDED
uniform sampler2D groundPicture;
uniform vec4 groundPlace;      // left, top, width and height of the picture
uniform float groundDepth;     // of the plane behind the world's middle
uniform mat3 groundTurn;       // world to the ground's own frame, where the plane is z = -depth
uniform float groundShare;     // how much of it is shown
uniform float groundLevel;     // of the picture's pyramid; below 0: by how far rays are apart

// What a ray sees of it; the ray is as long as one unit of the camera's axis.
vec3 groundSeen(vec3 eye, vec3 ray) {
  vec3 from = groundTurn * eye, along = groundTurn * ray;
  float height = from.z + groundDepth;
  // Rays that never get there see it as it is far away.
  vec2 at = from.xy + height / max(-along.z, 1e-3 * height) * along.xy;
  vec2 place = vec2(at.x - groundPlace.x, groundPlace.y - at.y) / groundPlace.zw;
  if (groundLevel >= 0.0) return textureLod(groundPicture, place, groundLevel).rgb;
  return texture(groundPicture, place).rgb;
}
#endif
