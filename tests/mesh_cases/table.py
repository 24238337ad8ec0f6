"""Registering cases, what to look for in a mesh, and how a file of each format is written."""

import warnings

import numpy as np
import pytest
import trimesh
from made_meshes import (
    BOARD,
    L_SHAPE,
    QUARTERS,
    UV,
    VERTEX,
    colour_at,
    dae,
    dae_places,
    picture,
    ply,
    rows,
)

from varos_warp.scene.geometry.mesh_files import load_mesh

FORMATS = {"glTF": "glb", "OBJ": "obj", "PLY": "ply", "DAE": "dae", "STL": "stl", "OFF": "off"}
CASES: dict[tuple[str, str], list] = {}


def case(feature, *formats, says=None):
    """Register the function that makes the file of a cell, or of several: it is given the format then."""

    def register(make):
        for kind in formats:
            CASES.setdefault((feature, kind), []).append((make, says))
        return make

    return register


# --------------------------------------------------------------------------------------------------------- what to see


def loaded(path, up=None):
    """A mesh, and what is told of it, without the beginning that all notes have."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        mesh = load_mesh(path, "objects.0.file", up)
    return mesh, [str(warning.message).removeprefix(f"objects.0.file: {path.name}: ") for warning in told]


def area(mesh) -> float:
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).area


def has_area(expected, size=None):
    """A look at the area [m2], and at the extent [m]."""

    def look(mesh):
        assert area(mesh) == pytest.approx(expected, rel=1e-6)
        if size is not None:
            np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), size, rtol=1e-6)

    return look


def is_quarters(mesh):
    """QUARTERS fills the board, upright."""
    for x, y, expected in (
        (-0.5, 0.5, QUARTERS[0, 0]),
        (0.5, 0.5, QUARTERS[0, 1]),
        (-0.5, -0.5, QUARTERS[1, 0]),
        (0.5, -0.5, QUARTERS[1, 1]),
    ):
        np.testing.assert_allclose(colour_at(mesh, x, y), expected / 255.0, atol=1e-6)


def is_colour(expected, x=0.3, y=0.1):
    return lambda mesh: np.testing.assert_allclose(colour_at(mesh, x, y), expected, atol=1e-6)


def is_grey(mesh):
    assert mesh.skin is None or np.allclose(colour_at(mesh, 0.3, 0.1), 0.5)


def repeats_twice(mesh):
    """Coordinates of 0..2 on the board: each quarter of it shows the whole picture."""
    for x, y in ((-0.75, 0.75), (0.25, 0.75), (-0.75, -0.25), (0.25, -0.25)):
        np.testing.assert_allclose(colour_at(mesh, x, y), [1.0, 0.0, 0.0], atol=1e-6)


# -------------------------------------------------------------------------------------------------------- OBJ, OFF ...


def obj(folder, text, mtl=None, image=True, name="q.png"):
    """An OBJ; with ``mtl``, beside m.mtl and a picture."""
    if mtl is not None:
        (folder / "m.mtl").write_text(mtl)
        text = f"mtllib m.mtl\n{text}"
    if image:
        (folder / name).write_bytes(picture())
    path = folder / "m.obj"
    path.write_text(text)
    return path


V = "".join(f"v {x} {y} {z}\n" for x, y, z in BOARD)
VT = "".join(f"vt {u} {v}\n" for u, v in UV)
QUAD = "f 1/1 2/2 3/3 4/4\n"


def off(folder, places, faces, head="OFF", vertex_tail="", face_tail=""):
    path = folder / "m.off"
    body = "\n".join(" ".join(map(repr, map(float, p))) + vertex_tail for p in places) + "\n"
    body += "\n".join(f"{len(f)} {' '.join(map(str, f))}{face_tail}" for f in faces)
    path.write_text(f"{head}\n{len(places)} {len(faces)} 0\n{body}\n")
    return path


def dae_file(folder, text):
    path = folder / "m.dae"
    path.write_text(text)
    (folder / "q.png").write_bytes(picture())
    return path


def ply_file(folder, text):
    path = folder / "m.ply"
    path.write_text(text)
    return path


XYZ = "double x,double y,double z"
RING = "list uchar int vertex_indices"
FLAT = np.column_stack([L_SHAPE, np.zeros(6)])
BOWTIE = np.array([[0.0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 1.0, 0]])


def polygon(folder, kind, places):
    """One polygon in a format that has them."""
    ring = list(range(len(places)))
    if kind == "OBJ":
        lines = "".join(f"v {' '.join(map(repr, map(float, p)))}\n" for p in places)
        return obj(folder, lines + "f " + " ".join(str(i + 1) for i in ring) + "\n", image=False)
    if kind == "PLY":
        return ply_file(folder, ply(XYZ, rows(places), RING, f"{len(ring)} " + " ".join(map(str, ring))))
    if kind == "DAE":
        return dae_file(
            folder,
            dae(
                dae_places(places) + f'<polylist count="1">{VERTEX}<vcount>{len(ring)}</vcount>'
                f"<p>{' '.join(map(str, ring))}</p></polylist>"
            ),
        )
    return off(folder, places, [ring])
