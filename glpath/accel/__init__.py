"""Bounding volume hierarchies, built on the CPU."""
