"""All lights of a scene asked through one interface: samples, densities, what each sends."""
