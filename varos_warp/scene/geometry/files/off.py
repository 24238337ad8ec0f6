"""OFF (Geomview): polygons, with colours of vertices or faces."""

from pathlib import Path

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.geometry.files.pieces import MeshFile, Piece, damaged
from varos_warp.scene.images import srgb_to_linear


def read_off(path: Path, with_colours: bool) -> MeshFile:
    """Read an OFF file; it does not say which way is up, nor its unit."""
    file = MeshFile(path)
    prefix, points, polygons = _rows(path)
    vertices = np.array([row[:3] for row in points], float).reshape(-1, 3)
    counts = [int(row[0]) for row in polygons]
    if any(len(row) <= count or count < 0 for row, count in zip(polygons, counts, strict=True)):
        raise damaged("has a face with fewer vertices than it says")
    corners = np.array([word for row, n in zip(polygons, counts, strict=True) for word in row[1 : n + 1]], np.int64)
    chosen, polygon = file.triangulated(vertices, corners, np.concatenate([[0], np.cumsum(counts)]).astype(int))
    faces, colours = corners[chosen], None
    if with_colours and "C" in prefix and len(points):
        colours = _vertex_colours(points, 3 + 3 * ("N" in prefix), file)[faces]
    elif with_colours:
        if any(len(row) > 3 + 3 * ("N" in prefix) + 2 * ("T" in prefix) for row in points):
            file.note(f"numbers behind its vertices are left out: colours need a C in the header ({prefix}OFF)")
        colours = _face_colours(polygons, counts, polygon, file)
    file.add(Piece(vertices, faces, None, None, colours))
    return file


def _rows(path):
    """What stands before OFF in the header, and the words of the vertices' and of the faces' lines."""
    text = path.read_bytes().removeprefix(b"\xef\xbb\xbf").decode("utf-8", "replace")
    lines = [words for line in text.splitlines() if (words := line.split("#", 1)[0].split())]
    header = lines.pop(0) if lines and lines[0][0].upper().endswith("OFF") else ["OFF"]
    if len(header) > 1:
        lines.insert(0, header[1:])
    prefix = header[0].upper().removesuffix("OFF")
    if set(prefix) - set("STCN") or lines[:1] == [["BINARY"]]:
        raise InputError(
            f"is a file of kind {' '.join([header[0], *lines[0][:1]])}, which is not read",
            remedy="Export it as plain OFF, or as PLY.",
        )
    points, polygons = (int(word) for word in lines[0][:2])
    if points < 0 or polygons < 0 or len(lines) - 1 < points + polygons:
        raise InputError(
            f"ends within its {points} vertices and {polygons} faces",
            remedy="Copy or export it again; the transfer may have broken off.",
        )
    return prefix, lines[1 : 1 + points], lines[1 + points : 1 + points + polygons]


def _vertex_colours(rows, first, file):
    """Linear colours float32 [V, 3] of the words behind the coordinates."""
    words = [row[first : first + 4] for row in rows]
    if not all(len(row) >= 3 for row in words):
        raise damaged("has vertices without the colours that its header promises")
    return _linear(words, file)


def _face_colours(rows, counts, polygon, file):
    """Linear colours float32 [F, 3, 3] of the words behind the corners of faces; None without any."""
    words = [row[n + 1 : n + 5] for row, n in zip(rows, counts, strict=True)]
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
    """Colours float32 [N, 3] of rows of 3 words, or 4 with alpha: whole numbers are sRGB of 8 bits, others linear."""
    values = np.array([row[:3] for row in words], float)
    whole = np.array(["." not in word and "e" not in word.lower() for row in words for word in row[:3]]).all()
    if whole and values.max(initial=0.0) == 1.0 and all(float(alpha) <= 1.0 for row in words for alpha in row[3:]):
        file.note("its colours are whole numbers, but none is above 1: they are taken as real numbers of 0..1")
        whole = False
    top = 255.0 if whole else 1.0
    if not ((values >= 0.0) & (values <= top)).all():
        raise InputError(f"has colours that are not within 0..{top:g}", remedy="Export it with colours of 0 to 255.")
    return (srgb_to_linear(values / 255.0) if whole else values).astype(np.float32)
