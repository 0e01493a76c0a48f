"""Light for surfaces: atlases of texels, the light at each of them, and files that show it."""
