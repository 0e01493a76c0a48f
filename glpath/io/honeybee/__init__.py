"""Models of Ladybug Tools' honeybee, read from their HBJSON.

    glpath measure room.hbjson --points room.hbjson#GRID -D overcast=10000 -o lux.csv

What is read: rooms with their faces, apertures and doors; shades and meshes of shades; Radiance's modifiers, of an
object, of its room's modifier set, or honeybee's own by the type of a face; sensor grids; the first perspective
view. Of two faces that two rooms share one is taken, and air boundaries are open, as honeybee writes them for
Radiance. Opaque modifiers, glass, translucent ones, mirrors, lights and glows are known; BSDF data are not.

Units are those of the file, and z is up.

Poor at: glass at grazing incidence, which has Schlick's formula here and Fresnel's in Radiance; the states of
dynamic groups, of which there is the first; chains of modifiers, of which the last counts.

Source: https://www.ladybug.tools/honeybee-schema, version 2.3; honeybee-radiance 1.66.
"""

from glpath.io.honeybee.grids import sensor_points
from glpath.io.honeybee.load import read_honeybee

__all__ = ["read_honeybee", "sensor_points"]
