"""View factors between surfaces as a sparse matrix, for heat transfer and for the daylight of cities."""
