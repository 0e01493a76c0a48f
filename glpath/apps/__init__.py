"""Applications of the renderer. None imports another, and the engine imports none."""
