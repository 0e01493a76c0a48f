"""Where the passes are put in order: one module per integrator, each with its frame in one function."""
