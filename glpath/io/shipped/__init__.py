"""Shipped scenes that functions make from parameters; the others are files in `scenes`."""
