"""All lights of a scene asked in one way: samples, densities, what each sends."""
