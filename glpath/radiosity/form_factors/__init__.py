"""Form factors between patches and elements, computed by rays, and their storage."""
