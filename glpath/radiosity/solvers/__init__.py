"""Solvers of radiosity by form factors or particles: progressive refinement, full matrix, Monte Carlo."""
