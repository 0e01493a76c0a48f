"""From what people bring, files, dicts and trimesh, to the model: each form is read here, and nowhere else."""
