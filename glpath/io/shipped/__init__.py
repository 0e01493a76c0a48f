"""Shipped scenes that functions generate from parameters; the others are files in `scenes`."""
