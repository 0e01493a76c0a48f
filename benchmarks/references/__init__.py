"""Converged pictures by other renderers: some are stored here, others are made on the machine."""
