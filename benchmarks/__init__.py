"""Benchmarks of glpath, and the figures of the papers made again. They run from a checkout, not an installation."""
