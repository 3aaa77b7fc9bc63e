// States of bodies, which follow the table; needs scene_textures.glsl and shader_table.glsl.

// Lit lamps of a body, and whether cameras see no more of it than its shadow.
vec2 bodyState(uint body) {
  int texel = int(body);
  return texelFetch(samplerTable, ivec2(texel % COLUMNS, BODIES_ROW + texel / COLUMNS), 0).xy;
}
