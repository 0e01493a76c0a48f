"""Films: sums of path sets, their images and metadata. Plain data, no OpenGL."""
