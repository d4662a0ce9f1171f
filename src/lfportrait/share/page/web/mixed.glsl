// Between two pictures of the same view: the ends of a slider.

uniform sampler2D firstEnd;
uniform sampler2D secondEnd;
uniform vec2 size;             // of what is drawn into, in pixels

out vec4 result;

void main() {
  vec2 at = gl_FragCoord.xy / size;
  result = mix(texture(firstEnd, at), texture(secondEnd, at), blend);
}
