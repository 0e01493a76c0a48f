"""Meshes of patches and elements: lattices, sides of elements, and vertex values made from element values."""
