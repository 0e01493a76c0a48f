"""Where paths begin: the pixels of a camera, points with normals."""
