#version 300 es
precision highp float;
in vec3 v_place;
in float v_value;
flat in float v_exact;
in vec2 v_light;
uniform sampler2D u_colours;
uniform vec2 u_range;
uniform vec3 u_low;
uniform vec3 u_high;
uniform vec3 u_plain;
// 0 plain, 1 colour scale, 2 packed red-green-blue, 3 reasons.
uniform float u_mode;
uniform bool u_hide;
out vec4 colour;

vec3 base() {
  if (u_mode == 1.0 && v_value == v_value) {
    float place = (v_value - u_range.x) / (u_range.y - u_range.x);
    if (u_hide && (place < 0.0 || place > 1.0)) discard;
    return texelFetch(u_colours, ivec2(int(clamp(place, 0.0, 1.0) * 255.0 + 0.5), 0), 0).rgb;
  }
  if (u_mode == 2.0 && v_exact == v_exact) {
    int packed = int(v_exact + 0.5);
    return vec3(packed & 255, (packed >> 8) & 255, packed >> 16) / 255.0;
  }
  if (u_mode == 3.0) return texelFetch(u_colours, ivec2(int(v_exact + 0.5), 0), 0).rgb;
  return u_plain;
}

void main() {
  if (any(lessThan(v_place, u_low)) || any(greaterThan(v_place, u_high))) discard;
  vec3 shade = base();
  // The back of a surface was not seen by the camera: it is shown dull.
  if (gl_FrontFacing) shade = shade * v_light.x + (u_mode == 0.0 ? 0.10 : 0.04) * v_light.y;
  else shade = mix(shade, vec3(0.45), 0.6) * 0.75;
  colour = vec4(shade, 1.0);
}
