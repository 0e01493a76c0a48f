"""Files, locks, the machine, the terminal, compiled kernels: what is no light and no scene."""
