"""STL, text or binary, through trimesh, which reads what is closed and leaves out the rest without a word."""

import io
import re
from pathlib import Path

import numpy as np
import trimesh

from varos_warp.errors import InputError, counted
from varos_warp.scene.geometry.files.pieces import MeshFile, Piece, damaged
from varos_warp.scene.geometry.files.wavefront import text_of

HEADER, TRIANGLE = 84, 50
"""Bytes of a binary file's beginning, the last four of which count its triangles, and of each of them."""
SOLID = re.compile(rb"^[ \t]*(end[ \t]?)?solid\b[^\n]*", re.M)
AGAIN = "Copy or export it again; the transfer may have broken off."


def read_stl(path: Path, with_colours: bool) -> MeshFile:
    """Read an STL file, text or binary; it does not say which way is up, nor its unit, and has no colours."""
    file = MeshFile(path)
    data = path.read_bytes()
    if _is_text(data):
        data = SOLID.sub(lambda match: b"endsolid" if match[1] else b"solid", text_of(data).lower())  # without names
        count = _count_facets(data)
    else:
        count = _count_triangles(data, file)
        data = data[: HEADER + TRIANGLE * count]
    loaded = trimesh.load_scene(io.BytesIO(data), file_type="stl", process=False)
    for node in loaded.graph.nodes_geometry:
        matrix, name = loaded.graph[node]
        mesh = loaded.geometry[name]
        if isinstance(mesh, trimesh.Trimesh):
            file.add(Piece(np.asarray(mesh.vertices, float), np.asarray(mesh.faces)).moved(matrix))
            if with_colours and np.any(mesh.face_attributes.get("stl", 0)):
                file.note("the colours of binary STL files, which differ between programs, are not read: it is grey")
    if file.triangles != count:
        raise damaged(f"has {counted(count, 'triangle')}, of which {file.triangles} can be read")
    return file


def _is_text(data):
    """Return whether it is text: binary files may begin with ``solid`` too, but hold NUL or are as long as they say."""
    is_named = data.removeprefix(b"\xef\xbb\xbf").lstrip()[:5].lower() == b"solid"
    count = _stated(data)
    return is_named and b"\0" not in data[:1024] and (count is None or len(data) != HEADER + TRIANGLE * count)


def _stated(data):
    """How many triangles the beginning of a binary file says that it has; None of one that ends before that."""
    return int.from_bytes(data[HEADER - 4 : HEADER], "little") if len(data) >= HEADER else None


def _count_triangles(data, file):
    """Triangles of a binary file, which are there."""
    count, found = _stated(data), (len(data) - HEADER) // TRIANGLE
    if count is None:
        raise InputError("begins neither with 'solid' nor with the 84 bytes of a binary STL", remedy=AGAIN)
    if found < count:
        raise InputError(f"says that it has {count} triangles, of which {found} are there", remedy=AGAIN)
    rest = len(data) - HEADER - TRIANGLE * count
    if rest and not count:
        raise InputError(f"says that it has 0 triangles, but {rest} bytes follow", remedy=AGAIN)
    if rest:
        file.note(f"{rest} bytes behind its {count} triangles are left out")
    return count


def _count_facets(text):
    """Facets of a text in small letters and without names, in which all that begins also ends."""
    ends = [bool(match[1]) for match in SOLID.finditer(text)]
    bare = SOLID.sub(b"", text)
    facets, ended, loops, closed = (
        len(re.findall(rb"\b" + word + rb"\b", bare)) for word in (b"facet", b"endfacet", b"loop", b"endloop")
    )
    for what, begun, over in (
        ("solid", ends.count(False), ends.count(True)),
        ("facet", facets, ended),
        ("loop", loops, closed),
    ):
        if begun != over:
            raise InputError(f"begins {counted(begun, what)} and ends {over}", remedy=AGAIN)
    outside, *corners = (part.count(b"vertex") for part in re.split(rb"\bfacet\b", bare))
    if odd := [count for count in corners if count != 3]:
        raise InputError(f"has a facet whose count of vertices is {odd[0]}, not 3", remedy=AGAIN)
    if outside:
        raise InputError("has a vertex before its first facet", remedy=AGAIN)
    return facets
