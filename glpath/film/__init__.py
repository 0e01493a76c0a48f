"""Films: sums of path sets, their pictures and what is told of both. Plain data, no GL."""
