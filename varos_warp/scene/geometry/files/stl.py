"""STL, text or binary, through trimesh."""

from pathlib import Path

import numpy as np
import trimesh

from varos_warp.scene.geometry.files.pieces import MeshFile, Piece


def read_stl(path: Path, with_colours: bool) -> MeshFile:
    """Read an STL file, text or binary; it does not say which way is up, nor its unit, and has no colours."""
    file = MeshFile(path)
    loaded = trimesh.load_scene(path, file_type="stl", process=False)
    for node in loaded.graph.nodes_geometry:
        matrix, name = loaded.graph[node]
        mesh = loaded.geometry[name]
        if isinstance(mesh, trimesh.Trimesh):
            file.add(Piece(np.asarray(mesh.vertices, float), np.asarray(mesh.faces)).moved(matrix))
            if with_colours and np.any(mesh.face_attributes.get("stl", 0)):
                file.note("the colours of binary STL files, which differ between programs, are not read: it is grey")
    return file
