"""Reader of Mitsuba 3 scenes in XML.

    glpath render scene.xml -D spp=16

What is read: diffuse, (rough) conductor, (rough) dielectric, thin dielectric, (rough) plastic, principled,
twosided, normalmap, bumpmap, mask and blendbsdf, and Sionna's radio materials; bitmaps, checkerboards, mesh
attributes and spectra; obj, ply, serialized, rectangle, cube, sphere, disk, cylinder and instances; area, point,
spot, directional, constant, envmap and sunsky emitters; perspective, thinlens and orthographic sensors; `<default>`
with `$name`, `<include>`, `<alias>` and references. All else raises SceneError with its name.

Depth, samples per pixel, pixel filter and integrator are not part of a scene: `glpath render` has options for them.

Surfaces are as in Mitsuba 3.9, except for its errors in blends; a warning names each approximation.

Source: https://mitsuba.readthedocs.io, version 3.9.
"""

from glpath.io.mitsuba.document import read_document
from glpath.io.mitsuba.load import read_mitsuba

__all__ = ["read_document", "read_mitsuba"]
