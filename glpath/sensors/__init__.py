"""Start points of paths: the pixels of a camera, or points with normals."""
