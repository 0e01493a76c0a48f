"""Form factors between patches and elements, by rays, and how they are kept."""
