// portals.glsl: light samples of the sky through portals, rectangles around openings, by solid angle; see
// `glpath.scene.portal`.
// Needs:  PORTALS: number of portals; light_sample.glsl with HAS_SKY
// Frame:  world. Units: densities per solid angle.
#include "sampling/rectangle.glsl"

// Fraction of the sky's light samples that are drawn through portals, if any portal faces the position. The others
// are drawn by the sky's radiance. They find small suns and light from outside the portals, and make the mean
// unbiased.
const float PORTAL_SHARE = 0.75;

uniform vec3 portals[3 * PORTALS];  // a corner and two edges of each portal; the edges' cross product points inwards
uniform float sky_chance;           // probability that a light sample is of the sky

SeenRectangle seen_portal(int k, vec3 from)
{
    return seen_rectangle(portals[3 * k], portals[3 * k + 1], portals[3 * k + 2], from);
}

// Density per solid angle, in a direction, of the sky's light samples that are drawn for a position.
float sky_pdf(vec3 from, vec3 direction)
{
    float through = 0.0, all_around = 0.0;
    for (int k = 0; k < PORTALS; ++k)
    {
        SeenRectangle r = seen_portal(k, from);
        all_around += r.solid_angle;
        through += r.solid_angle * rectangle_pdf(r, direction);
    }
    float whole = sky_pdf(direction);
    return all_around > 0.0 ? mix(whole, sky_chance * through / all_around, PORTAL_SHARE) : whole;
}

// Draws a direction through one of the portals, chosen by solid angle; number: uniform. Returns false if the
// position is behind all portals.
bool portal_drawn(vec3 from, float number, vec2 u, out vec3 wi)
{
    float all_around = 0.0;
    SeenRectangle chosen;
    for (int k = 0; k < PORTALS; ++k)
    {
        SeenRectangle r = seen_portal(k, from);
        all_around += r.solid_angle;
        float chance = r.solid_angle / max(all_around, 1e-30);
        bool taken = number < chance;
        number = min((taken ? number : number - chance) / max(taken ? chance : 1.0 - chance, 1e-30), 0.99999994);
        if (taken || k == 0) chosen = r;
    }
    wi = towards_rectangle(chosen, u);
    return all_around > 0.0;
}

// Draws a light sample of the sky: a direction whose density is `sky_pdf` divided by `weight`.
vec3 sky_drawn(vec3 from, vec3 u, out float weight)
{
    vec3 wi;
    bool through = u.x < PORTAL_SHARE;
    if (portal_drawn(from, min(u.x / PORTAL_SHARE, 0.99999994), u.yz, wi)) {
        u.x = clamp((u.x - PORTAL_SHARE) / (1.0 - PORTAL_SHARE), 0.0, 0.99999994);
    } else {
        through = false;
    }
    vec3 anywhere = sky_drawn(u, weight);
    if (!through) return anywhere;
    weight = 1.0;
    return wi;
}
