// light_tree.glsl: chooses a light for a position, by a BVH over lights with a position; `glpath.lights.tree` is the same on
// the CPU, and describes the nodes.
// Needs:  <LIGHT_DRAWS>, from light_draw.glsl; constants.glsl
// Frame:  world.

// Returns the cosine of the angle a - b, or 1, the cosine of 0, if b is larger than a; sine: sine of the same
// angle.
float cosine_less(float cos_a, float sin_a, float cos_b, float sin_b, out float sine)
{
    bool less = cos_a >= cos_b;
    sine = less ? 0.0 : sin_a * cos_b - cos_a * sin_b;
    return less ? 1.0 : cos_a * cos_b + sin_a * sin_b;
}

// Upper bound of the irradiance at a position from the lights of a child of a tree node; ball, cone: bounds of
// these lights.
float light_importance(uvec4 ball, uvec4 cone, vec3 position, vec3 normal)
{
    vec3 away = position - uintBitsToFloat(ball.xyz);
    float radius = uintBitsToFloat(ball.w);
    vec2 octahedral = unpackSnorm2x16(cone.x), cosines = unpackSnorm2x16(cone.y);
    vec3 axis = vec3(octahedral, 1.0 - abs(octahedral.x) - abs(octahedral.y));
    float fold = max(-axis.z, 0.0);
    axis.x += axis.x >= 0.0 ? -fold : fold;
    axis.y += axis.y >= 0.0 ? -fold : fold;
    float r2 = radius * radius, d2 = max(dot(away, away), 1e-30), over = inversesqrt(d2);
    // Half the angle that the ball subtends; a position inside the ball sees it in all directions.
    float sin2_ball = min(r2 / d2, 1.0), sin_ball = sqrt(sin2_ball);
    float cos_ball = sin2_ball < 1.0 ? sqrt(1.0 - sin2_ball) : -1.0;
    float cos_axis = dot(axis, away) * over * inversesqrt(dot(axis, axis));
    float sin_axis = sqrt(max(1.0 - cos_axis * cos_axis, 0.0));
    float sin_inner = sqrt(max(1.0 - cosines.x * cosines.x, 0.0)), sin_turned, unused;
    float cos_turned = cosine_less(cos_axis, sin_axis, cosines.x, sin_inner, sin_turned);
    cos_turned = cosine_less(cos_turned, sin_turned, cos_ball, sin_ball, unused);
    float cos_surface = -dot(away, normal) * over, sin_surface = sqrt(max(1.0 - cos_surface * cos_surface, 0.0));
    cos_surface = cosine_less(cos_surface, sin_surface, cos_ball, sin_ball, unused);
    float bound = max(cos_turned, 0.0) * max(cos_surface, 0.0) * (uintBitsToFloat(cone.z) / max(d2, r2));
    return cos_turned > cosines.y ? bound : 0.0;
}

vec2 light_importances(int node, vec3 position, vec3 normal, out ivec2 children)
{
    uvec4 left = light_node_texel(node, LIGHT_NODE_LEFT_CONE), right = light_node_texel(node, LIGHT_NODE_RIGHT_CONE);
    children = ivec2(left.w, right.w);
    return vec2(light_importance(light_node_texel(node, LIGHT_NODE_LEFT_BALL), left, position, normal),
                light_importance(light_node_texel(node, LIGHT_NODE_RIGHT_BALL), right, position, normal));
}

// Number of tree levels for which the bits of one random number suffice. After these levels a new number is drawn.
const int LEVELS_OF_A_NUMBER = 12;

// The loops below test the condition of their start again inside. After a lane has left a loop, llvmpipe (22.3)
// would otherwise continue to change the lane's values until the other lanes have left the loop.

// Returns the light that a random number selects; chance: its probability, 0 if no light reaches the position.
int light_of_tree(vec3 position, vec3 normal, uint number, out float chance)
{
    float u = fraction(number);
    int node = 0, level = 0;
    chance = 1.0;
    do {
        if (chance > 0.0) {
            ivec2 children;
            vec2 each = light_importances(node, position, normal, children);
            float sum = each.x + each.y, left = each.x / max(sum, 1e-37);
            bool right = u >= left;
            float part = right ? each.y / max(sum, 1e-37) : left;
            u = min((right ? u - left : u) / max(part, 1e-37), 0.99999994);
            chance *= part;
            node = right ? children.y : children.x;
            level += 1;
            if (level == LEVELS_OF_A_NUMBER) u = fraction(pcg(number));
        }
    } while (node >= 0 && chance > 0.0);
    return node < 0 ? -1 - node : 0;
}

// Probability with which `light_of_tree` selects the light at the end of a trail: one bit for each level, 1 for the
// right child.
float light_chance(uint trail, vec3 position, vec3 normal)
{
    float chance = 1.0;
    int node = 0;
    do {
        if (chance > 0.0) {
            ivec2 children;
            vec2 each = light_importances(node, position, normal, children);
            bool right = (trail & 1u) != 0u;
            chance *= (right ? each.y : each.x) / max(each.x + each.y, 1e-37);
            node = right ? children.y : children.x;
            trail >>= 1u;
        }
    } while (node >= 0 && chance > 0.0);
    return chance;
}

// Density per area of the light samples that are drawn for a position on one side of an emitting triangle.
float tree_pdf_area(int shape, int triangle, bool front, vec3 position, vec3 normal)
{
    uvec4 of = light_shape_texel(shape, LIGHT_SHAPE_FIRST);
    int piece = int(front ? of.y : of.z) + triangle - int(of.x);
    uvec4 choice = light_piece_texel(piece, LIGHT_PIECE_CHOICE);
    return light_chance(choice.x, position, normal) * uintBitsToFloat(choice.z);
}
