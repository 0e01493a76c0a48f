"""Films: sums of path sets, their pictures and metadata. Plain data, no GL."""
