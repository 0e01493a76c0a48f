"""Surfaces in patches and elements: lattices, sides, and values at vertices from those of elements."""
