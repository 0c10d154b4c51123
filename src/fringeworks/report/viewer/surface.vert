#version 300 es
// A point of the surface: its place relative to the centre, its normal, and the value that colours it.
layout(location = 0) in vec3 a_place;
layout(location = 1) in vec4 a_normal;
layout(location = 2) in float a_value;
uniform mat4 u_view;
uniform mat3 u_turn;
uniform float u_size;
out vec3 v_place;
out vec3 v_normal;
out float v_value;
flat out float v_exact;

void main() {
  gl_Position = u_view * vec4(a_place, 1.0);
  gl_PointSize = u_size;
  v_place = a_place;
  v_normal = u_turn * a_normal.xyz;
  v_value = a_value;
  v_exact = a_value;
}
