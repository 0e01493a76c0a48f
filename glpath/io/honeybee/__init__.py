"""Reader of HBJSON models, the format of Ladybug Tools' honeybee.

    glpath measure room.hbjson --points room.hbjson#GRID -D overcast=10000 -o lux.csv

The reader takes rooms with their faces, apertures and doors; shades and meshes of shades; sensor grids; the first
perspective view. The Radiance modifier of an object is its own, otherwise that of its room's modifier set,
otherwise honeybee's default for its type. If two rooms share a face, one of its two copies is taken. Air boundaries
are open, as honeybee writes them for Radiance. Supported modifiers are opaque, glass, translucent, mirror, light
and glow; BSDF data are not supported.

Units are those of the file, and z is up.

Poor at: glass at grazing incidence, which has Schlick's formula here and Fresnel's in Radiance; dynamic groups, of
which only the first state is read; chains of modifiers, of which the last counts.

Source: https://www.ladybug.tools/honeybee-schema, version 2.3; honeybee-radiance 1.66.
"""

from glpath.io.honeybee.load import read_honeybee, sensor_points

__all__ = ["read_honeybee", "sensor_points"]
