// Whole numbers below 2^22 as integers. The last bit of a float of this size is worth 1; LLVM converts by
// int() one pixel after another, at the price of a texel.

int wholeNumber(float x) { return floatBitsToInt(x + 12582912.0) - 0x4b400000; }
ivec2 wholeNumber(vec2 x) { return floatBitsToInt(x + 12582912.0) - 0x4b400000; }
ivec3 wholeNumber(vec3 x) { return floatBitsToInt(x + 12582912.0) - 0x4b400000; }
ivec4 wholeNumber(vec4 x) { return floatBitsToInt(x + 12582912.0) - 0x4b400000; }
