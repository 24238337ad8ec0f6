"""Cases of damaged files."""

import numpy as np
from made_meshes import (
    BOARD,
    UV,
    VERTEX,
    Gltf,
    dae,
    dae_places,
    ply,
    rows,
)

from mesh_cases.colours import textured
from mesh_cases.geometry import triangles
from mesh_cases.table import RING, XYZ, V, case, dae_file, obj, off, ply_file

# -------------------------------------------------------------------------------------------------------------- damage


@case("a face that names a vertex that is not there", "glTF", "OBJ", "PLY", "DAE", "OFF", says=r"vertex \d+ of 4")
def beyond(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(faces=[[0, 1, 4]])
        return gltf.save(folder / "m.glb")
    if kind == "OBJ":
        return obj(folder, V + "f 1 2 5\n", image=False)
    if kind == "PLY":
        return ply_file(folder, ply(XYZ, rows(BOARD), RING, "3 0 1 4"))
    if kind == "DAE":
        return dae_file(folder, dae(dae_places() + f'<triangles count="1">{VERTEX}<p>0 1 4</p></triangles>'))
    return off(folder, BOARD, [[0, 1, 4]])


@case("a face that names a vertex that is not there", "OBJ", says=r"vertex -\d of 4")
def before_the_first(folder):
    return obj(folder, V + "f -1 -2 -9\n", image=False)


@case(
    "coordinates of a texture that are not finite", "glTF", "OBJ", "PLY", "DAE", says="coordinates that are not finite"
)
def not_finite(folder, kind):
    uv = UV.copy()
    uv[2, 0] = np.nan
    return textured(folder, kind, uv=uv)


@case("a file that breaks off", "glTF", "PLY", "DAE", "STL", "OFF")
def broken_off(folder, kind):
    path, _ = triangles(folder, kind)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    return path
