"""Headless global illumination on OpenGL 4.3, with or without a GPU.

    import glpath
    film = glpath.render("cornell-box", spp=64)
    film.save("cornell-box.png")

`import glpath` loads no other module; each name imports its modules when it is first used.
"""

from __future__ import annotations

TYPE_CHECKING = False  # without an import of typing, because Ctrl-C during it would end with a traceback
if TYPE_CHECKING:
    from typing import Any

    from glpath.apps.daylight.coefficients import DaylightCoefficients
    from glpath.apps.daylight.compute import daylight_coefficients
    from glpath.apps.daylight.texels import Texels, texels
    from glpath.apps.daylight.year import DaylightYear, daylight_year
    from glpath.apps.lightmap.lightmap import Lightmap, lightmap
    from glpath.apps.probes import Probes, probes
    from glpath.apps.terrain.height_field import HeightField
    from glpath.apps.terrain.horizon import Horizon, horizon
    from glpath.apps.terrain.reading import load_height_field, load_point_cloud
    from glpath.apps.view_factors.compute import ViewFactorProgress, view_factors
    from glpath.apps.view_factors.result import ViewFactors
    from glpath.compare import relative_mse
    from glpath.errors import (
        ContextError,
        GlpathError,
        ImageError,
        SceneError,
        SceneWarning,
        ShaderError,
        StrictError,
        TimeLimitError,
        UsageError,
    )
    from glpath.film.film import Film, read_image
    from glpath.io import load_scene
    from glpath.io.export import export
    from glpath.radiosity.solution import RadiositySolution
    from glpath.radiosity.solvers.solve import RadiosityInterrupted, RadiosityProgress, solve_radiosity
    from glpath.rendering import ElementError, RenderInterrupted, element_error, render, render_frames
    from glpath.rendering.points import Irradiance, irradiance
    from glpath.rendering.progress import Progress
    from glpath.rendering.views import Views, render_views
    from glpath.scene import Scene
    from glpath.scene.camera_matrices import camera

    __version__: str

# Module of each public name. `render` is in `rendering`, because a module `glpath.render` would replace the
# function in this package as soon as it is imported.
_HOME = {
    "ContextError": "errors",
    "DaylightCoefficients": "apps.daylight.coefficients",
    "DaylightYear": "apps.daylight.year",
    "ElementError": "rendering",
    "Film": "film.film",
    "GlpathError": "errors",
    "HeightField": "apps.terrain.height_field",
    "Horizon": "apps.terrain.horizon",
    "ImageError": "errors",
    "Irradiance": "rendering.points",
    "Lightmap": "apps.lightmap.lightmap",
    "Probes": "apps.probes",
    "Progress": "rendering.progress",
    "RadiosityInterrupted": "radiosity.solvers.solve",
    "RadiosityProgress": "radiosity.solvers.solve",
    "RadiositySolution": "radiosity.solution",
    "RenderInterrupted": "rendering",
    "Scene": "scene",
    "SceneError": "errors",
    "SceneWarning": "errors",
    "ShaderError": "errors",
    "StrictError": "errors",
    "Texels": "apps.daylight.texels",
    "TimeLimitError": "errors",
    "UsageError": "errors",
    "ViewFactorProgress": "apps.view_factors.compute",
    "ViewFactors": "apps.view_factors.result",
    "Views": "rendering.views",
    "camera": "scene.camera_matrices",
    "daylight_coefficients": "apps.daylight.compute",
    "daylight_year": "apps.daylight.year",
    "element_error": "rendering",
    "export": "io.export",
    "horizon": "apps.terrain.horizon",
    "irradiance": "rendering.points",
    "lightmap": "apps.lightmap.lightmap",
    "load_height_field": "apps.terrain.reading",
    "load_point_cloud": "apps.terrain.reading",
    "load_scene": "io",
    "probes": "apps.probes",
    "read_image": "film.film",
    "relative_mse": "compare",
    "render": "rendering",
    "render_frames": "rendering",
    "render_views": "rendering.views",
    "solve_radiosity": "radiosity.solvers.solve",
    "texels": "apps.daylight.texels",
    "view_factors": "apps.view_factors.compute",
}

__all__ = [
    "ContextError",
    "DaylightCoefficients",
    "DaylightYear",
    "ElementError",
    "Film",
    "GlpathError",
    "HeightField",
    "Horizon",
    "ImageError",
    "Irradiance",
    "Lightmap",
    "Probes",
    "Progress",
    "RadiosityInterrupted",
    "RadiosityProgress",
    "RadiositySolution",
    "RenderInterrupted",
    "Scene",
    "SceneError",
    "SceneWarning",
    "ShaderError",
    "StrictError",
    "Texels",
    "TimeLimitError",
    "UsageError",
    "ViewFactorProgress",
    "ViewFactors",
    "Views",
    "__version__",
    "camera",
    "daylight_coefficients",
    "daylight_year",
    "element_error",
    "export",
    "horizon",
    "irradiance",
    "lightmap",
    "load_height_field",
    "load_point_cloud",
    "load_scene",
    "probes",
    "read_image",
    "relative_mse",
    "render",
    "render_frames",
    "render_views",
    "solve_radiosity",
    "texels",
    "view_factors",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        value: Any = _version()
    elif name in _HOME:
        from importlib import import_module

        value = getattr(import_module(f"glpath.{_HOME[name]}"), name)
    else:
        raise AttributeError(f"module 'glpath' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("glpath")
    except PackageNotFoundError:
        return "0+unknown"  # run from a checkout without installation
