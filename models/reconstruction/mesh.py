"""Depth to a mesh by ball pivoting: Bernardini et al., "The Ball-Pivoting Algorithm for Surface Reconstruction", 1999."""

import numpy as np
import pymeshlab

RADII = (1.5, 3.0, 6.0)  # of the balls, in spacings of the points: small ones first, larger ones close what is left open


def pivoted(points, normals):
    """Triangles, (F, 3) indices into `points` (N, 3) metres with unit `normals` (N, 3); holes stay where no ball rests."""
    # the points are a picture's, row by row: most neighbours in the list are neighbours on a surface
    spacing = float(np.median(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points.astype(np.float64), v_normals_matrix=normals.astype(np.float64)))
    for radius in RADII:
        meshes.generate_surface_reconstruction_ball_pivoting(ballradius=pymeshlab.PureValue(radius * spacing))
    return np.asarray(meshes.current_mesh().face_matrix(), np.int64)
