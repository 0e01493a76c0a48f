"""List of the commands of `glpath`, with the module and the help line of each."""

from __future__ import annotations

from glpath.cli.on_demand import Part

PICTURES, LIGHT, SCENES, MACHINE = "Pictures", "Light in numbers and for other viewers", "Scenes", "This machine"

#: Commands by name, in the order of `glpath --help`.
COMMANDS = {
    "render": Part("glpath.cli.render", PICTURES, "A picture of a scene."),
    "merge": Part("glpath.cli.merge", PICTURES, "One film or picture of films that were rendered apart."),
    "diff": Part("glpath.cli.compare", PICTURES, "How far two pictures differ, and where."),
    "radiosity": Part("glpath.cli.radiosity", LIGHT, "The light between diffuse surfaces, for `render`."),
    "lightmap": Part("glpath.cli.lightmap", LIGHT, "A model with its light baked in, for three.js and others."),
    "probes": Part("glpath.cli.probes", LIGHT, "Light in a grid of points, for objects that move there."),
    "measure": Part("glpath.cli.measure", LIGHT, "Irradiance and illuminance at points, with their errors."),
    "daylight": Part("glpath.cli.daylight", LIGHT, "What sky and sun give to sensors, through the year."),
    "viewfactors": Part("glpath.cli.viewfactors", LIGHT, "The matrix of view factors between faces."),
    "horizon": Part("glpath.cli.horizon", LIGHT, "Sky view factors and sun hours of terrain."),
    "info": Part("glpath.cli.scenes", SCENES, "What is in a scene."),
    "validate": Part("glpath.cli.scenes", SCENES, "What is wrong with a scene."),
    "schema": Part("glpath.cli.scenes", SCENES, "The scene format as JSON schema, for editors."),
    "scenes": Part("glpath.cli.scenes", SCENES, "The scenes that ship with glpath."),
    "export": Part("glpath.cli.export", SCENES, "A scene for Mitsuba 3, or for whatever reads glTF."),
    "devices": Part("glpath.cli.devices", MACHINE, "What can render here, and what is taken."),
    "doctor": Part("glpath.cli.devices", MACHINE, "What is missing on this machine, and what brings it."),
}
