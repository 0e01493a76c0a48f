"""Other renderers, each with its best settings on a scene of ours."""
