"""Height fields: horizons, sky view factors and sun hours of terrain, on the CPU."""
