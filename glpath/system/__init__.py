"""Files, locks, the machine, the terminal and compiled kernels: everything independent of light and scenes."""
