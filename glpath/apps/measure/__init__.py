"""Irradiance and illuminance at points: grids, tables of points, uniformity, and files with the results."""
