"""How finely to simulate: steps, meshes, and the check against a tight solver."""
