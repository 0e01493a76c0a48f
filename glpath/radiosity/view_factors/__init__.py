"""View factors: the matrix of how surfaces see each other, for heat transfer and for the light of cities."""
