VARYING vec4 paint;

// Light from above and behind the camera's first place, and a bluish one from the other side; directions are the scene's, y up.
void MAIN()
{
    vec3 light = vec3(1.0);
    if (lit > 0.0) {
        vec3 normal = normalize(NORMAL_MATRIX * NORMAL);
        float key = max(0.0, dot(normal, vec3(0.238, 0.719, 0.653)));
        float fill = max(0.0, dot(normal, vec3(-0.937, 0.242, -0.251)));
        light = vec3(0.14, 0.15, 0.17) + 0.80 * key + vec3(0.19, 0.23, 0.32) * fill;
    }
    vec3 linear = COLOR.rgb * tint.rgb * light + glow * tint.rgb;
    paint = vec4(pow(linear, vec3(1.0 / 2.2)), COLOR.a * tint.a);
    POSITION = MODELVIEWPROJECTION_MATRIX * vec4(VERTEX, 1.0);
    POINT_SIZE = max(1.5, point / POSITION.w);
}
