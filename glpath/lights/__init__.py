"""Interface to all lights of a scene: samples, densities, and the light that they send."""
