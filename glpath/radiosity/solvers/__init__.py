"""From form factors or particles to a solution: progressive refinement, full matrix, Monte Carlo."""
