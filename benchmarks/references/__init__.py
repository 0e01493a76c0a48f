"""Converged pictures by other renderers: those that are stored here, and those that are made on the machine."""
