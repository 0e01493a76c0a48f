"""Integrators: one module for each, which calls the passes of a frame in order, in one function."""
