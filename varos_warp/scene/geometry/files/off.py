"""OFF (Geomview): polygons, with colours of vertices or faces; STL through trimesh."""

from pathlib import Path

import numpy as np
import trimesh

from varos_warp.errors import InputError
from varos_warp.scene.geometry.files.pieces import MeshFile, Piece
from varos_warp.scene.images import srgb_to_linear


def read_off(path: Path, with_colours: bool) -> MeshFile:
    """Read an OFF file; it does not say which way is up, nor its unit."""
    file, lines = MeshFile(path), _lines(path)
    header = lines.pop(0) if lines and lines[0][0].upper().endswith("OFF") else ["OFF"]
    if len(header) > 1:
        lines.insert(0, header[1:])
    prefix = header[0].upper().removesuffix("OFF")
    if set(prefix) - set("STCN") or lines[:1] == [["BINARY"]]:
        raise InputError(f"is a file of kind {' '.join([header[0], *lines[0][:1]])}, which is not read", file=path,
                         remedy="Export it as plain OFF, or as PLY.")
    vertex_count, face_count = (int(word) for word in lines[0][:2])
    rows = lines[1:]
    if vertex_count < 0 or face_count < 0 or len(rows) < vertex_count + face_count:
        raise InputError(f"ends within its {vertex_count} vertices and {face_count} faces", file=path,
                         remedy="Copy or export it again; the transfer may have broken off.")
    vertices = np.array([row[:3] for row in rows[:vertex_count]], float).reshape(-1, 3)
    counts = [int(row[0]) for row in rows[vertex_count:vertex_count + face_count]]
    of_faces = rows[vertex_count:vertex_count + face_count]
    if any(len(row) <= count or count < 0 for row, count in zip(of_faces, counts, strict=True)):
        raise InputError("has a face with fewer vertices than it says", file=path,
                         remedy="The file is damaged; export it again.")
    corners = np.array([word for row, n in zip(of_faces, counts, strict=True) for word in row[1:n + 1]], np.int64)
    chosen, polygon = file.triangulated(vertices, corners, np.concatenate([[0], np.cumsum(counts)]).astype(int))
    faces = corners[chosen]
    colours = None
    if with_colours:
        first = 3 + 3 * ("N" in prefix)
        colours = _vertex_colours(rows[:vertex_count], first, file)[faces] if "C" in prefix and vertex_count else (
            _face_colours(of_faces, counts, polygon, file))
    file.add(Piece(vertices, faces, None, None, colours))
    return file


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


def _lines(path):
    """Words of the lines that say something."""
    text = path.read_bytes().removeprefix(b"\xef\xbb\xbf").decode("utf-8", "replace")
    return [words for line in text.splitlines() if (words := line.split("#", 1)[0].split())]


def _vertex_colours(rows, first, file):
    """Linear colours float32 [V, 3] of the words behind the coordinates."""
    words = [row[first:first + 3] for row in rows]
    if not all(len(row) == 3 for row in words):
        raise InputError("has vertices without the colours that its header promises", file=file.path,
                         remedy="The file is damaged; export it again.")
    return _linear(words, file)


def _face_colours(rows, counts, polygon, file):
    """Linear colours float32 [F, 3, 3] of the words behind the corners of faces; None without any."""
    words = [row[n + 1:n + 4] for row, n in zip(rows, counts, strict=True)]
    if not any(words):
        return None
    if any(len(row) in (1, 2) for row in words):
        file.note("colours by their number in a colour map are not read: it is grey")
        return None
    has = np.array([bool(row) for row in words])
    if not has.all():
        file.note("some faces have no colour: they are grey")
    colours = np.full((len(words), 3), 0.5, np.float32)
    colours[has] = _linear([row for row in words if row], file)
    return np.repeat(colours[polygon][:, None], 3, axis=1)


def _linear(words, file):
    """Colours float32 [N, 3] of rows of words: whole numbers are sRGB of 8 bits, others are linear."""
    values = np.array(words, float)
    whole = np.array(["." not in word and "e" not in word.lower() for row in words for word in row]).all()
    top = 255.0 if whole else 1.0
    if not ((values >= 0.0) & (values <= top)).all():
        raise InputError(f"has colours that are not within 0..{top:g}", file=file.path,
                         remedy="Export it with colours of 0 to 255.")
    return (srgb_to_linear(values / 255.0) if whole else values).astype(np.float32)
