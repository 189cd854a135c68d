"""The reconstruction row: a mesh of the depth map with the inferred materials, path-traced."""
