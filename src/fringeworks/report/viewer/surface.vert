#version 300 es
// A point of the surface: its place relative to the centre, its normal, and the value that colours
// it. Light is computed here: there are fewer points than pixels while the view moves.
layout(location = 0) in vec3 a_place;
layout(location = 1) in vec4 a_normal;
layout(location = 2) in float a_value;
uniform mat4 u_view;
uniform mat4 u_turn;
uniform float u_size;
uniform bool u_light;
out vec3 v_place;
out float v_value;
flat out float v_exact;
// Brightness of the front, and the glint that is added.
out vec2 v_light;

const vec3 LIGHT = vec3(-0.42, 0.51, 0.75);
const vec3 HALF = vec3(-0.224, 0.273, 0.935);  // between light and viewer

void main() {
  gl_Position = u_view * vec4(a_place, 1.0);
  gl_PointSize = u_size;
  v_place = a_place;
  v_value = a_value;
  v_exact = a_value;
  vec3 normal = mat3(u_turn) * a_normal.xyz;
  float size = length(normal);
  v_light = vec2(1.0, 0.0);
  if (u_light && size > 0.1) {
    normal /= size;
    v_light = vec2(0.32 + 0.78 * max(dot(normal, LIGHT), 0.0), pow(max(dot(normal, HALF), 0.0), 40.0));
  }
}
