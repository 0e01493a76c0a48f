"""Sample points of path sets, from counters."""
