"""PLY: ASCII and binary, polygons and strips, colours of vertices and faces, textures as MeshLab writes them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.geometry.files.pieces import FileMaterial, MeshFile, Piece, Texture
from varos_warp.scene.geometry.files.polygons import strip
from varos_warp.scene.images import srgb_to_linear

KINDS = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4",
    "float64": "f8",
}
INDICES = ("vertex_indices", "vertex_index")
COLOURS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
COORDINATES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
LONGEST_HEADER = 1 << 20


@dataclass
class Property:
    """A number, or a list of numbers, of each row of an element."""

    name: str
    kind: str
    count_kind: str | None = None
    """Of a list: the type of its length."""


@dataclass
class Element:
    """Rows of one kind: vertices, faces ..."""

    name: str
    count: int
    properties: list[Property]


class Lists:
    """Rows of different length: all values one after another, and where each row begins."""

    def __init__(self, values: np.ndarray, starts: np.ndarray):
        self.values, self.starts = values, starts


def read_ply(path: Path, with_colours: bool) -> MeshFile:
    """Read a PLY file; it does not say which way is up, nor its unit."""
    file = MeshFile(path)
    data = path.read_bytes()
    form, elements, textures, start = read_header(data, path)
    columns = _read_body(data, start, form, elements, path)
    vertex, face = columns.get("vertex", {}), columns.get("face", {})
    if not all(axis in vertex for axis in "xyz"):
        raise InputError("has no vertices with x, y, z", file=path, remedy="Export a surface as PLY.")
    vertices = np.stack([vertex[axis] for axis in "xyz"], axis=1).astype(float)
    rings = next((face[name] for name in INDICES if isinstance(face.get(name), Lists)), None)
    if rings is not None:
        _add_polygons(file, vertices, vertex, face, rings, textures, with_colours)
    if isinstance(strips := columns.get("tristrips", {}).get("vertex_indices"), Lists):
        faces = _strip_faces(strips)
        file.check(faces, len(vertices), "vertex")
        painted = _colours(vertex, path) if with_colours else None
        file.add(Piece(vertices, faces, None, None, None if painted is None else painted[faces]))
    if any(element.name == "edge" and element.count for element in elements):
        file.note("its points and lines are left out: only surfaces are rendered")
    return file


def _add_polygons(file, vertices, vertex, face, rings, textures, with_colours):
    """Polygons become pieces: one, or one for each texture."""
    corners = rings.values.astype(np.int64)
    chosen, polygon = file.triangulated(vertices, corners, rings.starts)
    faces = corners[chosen]
    if not with_colours:
        file.add(Piece(vertices, faces))
        return
    colours, uv = _painted(vertex, face, faces, polygon, file), _coordinates(vertex, face, faces, chosen, rings, file)
    if textures and uv is not None:
        number = np.asarray(face.get("texnumber", np.zeros(len(rings.starts) - 1))).astype(int)[polygon]
        _add_textured(file, vertices, faces, uv, colours, number, textures)
        return
    if textures:
        file.note("it names a texture but has no coordinates for it")
    elif uv is not None and colours is None:
        file.note("it has texture coordinates but names no texture (comment TextureFile): it is grey")
    file.add(Piece(vertices, faces, None, None, colours))


def _add_textured(file, vertices, faces, uv, colours, number, textures):
    """One piece for each texture, whose ``number`` [F] the faces have."""
    for k in np.unique(number):
        mine = number == k
        if not 0 <= k < len(textures):
            raise InputError(f"a face has texture {k} of {len(textures)}", file=file.path, key="texnumber",
                             remedy="The file is damaged; export it again.")
        texture = Texture(file.path.parent / textures[k], f"TextureFile {textures[k]}")
        file.add(Piece(vertices, faces[mine], FileMaterial(texture=texture), uv[mine],
                       None if colours is None else colours[mine]))


def _painted(vertex, face, faces, polygon, file):
    """Colours [F, 3, 3] of the corners: of faces, else of vertices; None without any."""
    if (of_faces := _colours(face, file.path)) is not None:
        return np.repeat(of_faces[polygon][:, None], 3, axis=1)
    of_vertices = _colours(vertex, file.path)
    return None if of_vertices is None else of_vertices[faces]


def _colours(columns, path) -> np.ndarray | None:
    """Linear reflectances float32 [N, 3] of rows: integers are sRGB of their whole range, floats are linear."""
    names = next((names for names in COLOURS if all(name in columns for name in names)), None)
    if names is None:
        return None
    values = np.stack([columns[name] for name in names], axis=1)
    if values.dtype.kind in "iu":
        return srgb_to_linear(np.maximum(values / float(np.iinfo(values.dtype).max), 0.0)).astype(np.float32)
    if not (np.isfinite(values).all() and values.min(initial=0.0) >= 0.0 and values.max(initial=0.0) <= 1.0):
        raise InputError("has colours in real numbers that are not within 0..1", file=path, key=names[0],
                         remedy="Export colours of 8 bits.")
    return values.astype(np.float32)


def _coordinates(vertex, face, faces, chosen, rings, file) -> np.ndarray | None:
    """Texture coordinates [F, 3, 2] of the corners: of faces, else of vertices."""
    of_corners = face.get("texcoord")
    if isinstance(of_corners, Lists):
        if (np.diff(of_corners.starts) == 2 * np.diff(rings.starts)).all():
            return of_corners.values.astype(float).reshape(-1, 2)[chosen]
        file.note("its faces have texture coordinates (texcoord) for some of their corners only: they are left out")
        return None
    names = next((names for names in COORDINATES if all(name in vertex for name in names)), None)
    return None if names is None else np.stack([vertex[name] for name in names], axis=1).astype(float)[faces]


def _strip_faces(strips) -> np.ndarray:
    """Faces [F, 3] of strips, which -1 ends."""
    found, values = [np.zeros((0, 3), np.int64)], strips.values.astype(np.int64)
    for first, last in zip(strips.starts[:-1], strips.starts[1:], strict=True):
        row = values[first:last]
        found += [strip(part[part != -1]) for part in np.split(row, np.flatnonzero(row == -1))]
    return np.concatenate(found)


# -------------------------------------------------------------------------------------------------------------- header


def read_header(data, path):
    """Byte order (ascii, <, >), elements, names of textures, and where the body begins."""
    end = data.find(b"end_header", 0, LONGEST_HEADER)
    if not data.startswith(b"ply") or end < 0:
        raise InputError("has no PLY header", file=path, remedy="Export it anew from the program that made it.")
    start = data.find(b"\n", end) + 1 or len(data)
    if data[end + 10:end + 11] == b"\r" and data[end + 11:end + 12] != b"\n":
        start = end + 11  # lines end as on old Macs
    form, elements, textures = None, [], []
    for line in data[:end].decode("utf-8", "replace").splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            form = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}.get(words[1])
        elif words[:2] == ["comment", "TextureFile"]:
            textures.append(line.split(None, 2)[2].strip().strip('"').replace("\\", "/"))
        elif words[:1] == ["element"]:
            elements.append(Element(words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1].properties.append(_property(words, path))
    if form is None:
        raise InputError("is of a format that PLY does not have", file=path, key="format",
                         remedy="Export it as binary_little_endian.")
    if any(element.count < 0 for element in elements):
        raise InputError("has an element of less than no rows", file=path, key="element",
                         remedy="The file is damaged; export it again.")
    return form, elements, textures, start


def _property(words, path) -> Property:
    kinds = words[2:4] if words[1] == "list" else [words[1]]
    if not all(kind in KINDS for kind in kinds):
        raise InputError(f"has a type that PLY does not have: {' '.join(words)}", file=path, key="property",
                         remedy="Export it anew from the program that made it.")
    if len(kinds) == 2:
        return Property(words[4], KINDS[kinds[1]], KINDS[kinds[0]])
    return Property(words[2], KINDS[kinds[0]])


# ---------------------------------------------------------------------------------------------------------------- body


def _read_body(data, start, form, elements, path) -> dict[str, dict]:
    """Columns of all elements by name: arrays, or `Lists`."""
    found, at = {}, start
    words = _AsciiBody(data[start:], path) if form == "ascii" else None
    for element in elements:
        if words is not None:
            found[element.name] = words.read(element)
        else:
            found[element.name], at = _read_binary(data, at, form, element, path)
    return found


def _cut_off(path, element):
    return InputError(f"ends within its {element.count} rows of '{element.name}'", file=path,
                      remedy="Copy or export it again; the transfer may have broken off.")


def _read_binary(data, at, order, element, path):
    """Columns of one element, and where the next begins."""
    if not any(p.count_kind for p in element.properties):
        row = np.dtype([(f"{i}", order + p.kind) for i, p in enumerate(element.properties)])
        if at + row.itemsize * element.count > len(data):
            raise _cut_off(path, element)
        table = np.frombuffer(data, row, element.count, at)
        return {p.name: table[f"{i}"] for i, p in enumerate(element.properties)}, at + row.itemsize * element.count
    even = _read_even(data, at, order, element)
    if even is not None:
        return even
    return _read_uneven(data, at, order, element, path)


def _read_even(data, at, order, element):
    """As `_read_binary` where all lists are as long as in the first row; None where they are not."""
    fields, place = [], at
    for i, p in enumerate(element.properties):
        if p.count_kind is None:
            fields.append((f"{i}", order + p.kind))
            place += np.dtype(p.kind).itemsize
            continue
        head = np.dtype(order + p.count_kind)
        if not element.count or place + head.itemsize > len(data):
            return None
        length = int(np.frombuffer(data, head, 1, place)[0])
        if not 0 <= length <= 1024:
            return None
        fields += [(f"n{i}", head), (f"{i}", order + p.kind, (length,))]
        place += head.itemsize + length * np.dtype(p.kind).itemsize
    row = np.dtype(fields)
    if at + row.itemsize * element.count > len(data):
        return None
    table, columns = np.frombuffer(data, row, element.count, at), {}
    for i, p in enumerate(element.properties):
        values = table[f"{i}"]
        if p.count_kind is not None:
            if (table[f"n{i}"] != values.shape[1]).any():
                return None
            values = Lists(values.reshape(-1), np.arange(element.count + 1) * values.shape[1])
        columns[p.name] = values
    return columns, at + row.itemsize * element.count


def _read_uneven(data, at, order, element, path):
    """As `_read_binary`, row by row."""
    kinds = [(np.dtype(order + p.kind), None if p.count_kind is None else np.dtype(order + p.count_kind))
             for p in element.properties]
    pieces, lengths = [[] for _ in kinds], [[] for _ in kinds]
    for _ in range(element.count):
        for k, (kind, head) in enumerate(kinds):
            length = 1
            if head is not None:
                if at + head.itemsize > len(data):
                    raise _cut_off(path, element)
                length = int(np.frombuffer(data, head, 1, at)[0])
                at += head.itemsize
            end = at + length * kind.itemsize
            if length < 0 or end > len(data):
                raise _cut_off(path, element)
            pieces[k].append(data[at:end])
            lengths[k].append(length)
            at = end
    columns = {}
    for p, (kind, head), chunks, counts in zip(element.properties, kinds, pieces, lengths, strict=True):
        values = np.frombuffer(b"".join(chunks), kind)
        starts = np.concatenate([[0], np.cumsum(counts)]).astype(int)
        columns[p.name] = values if head is None else Lists(values, starts)
    return columns, at


class _AsciiBody:
    """The words of an ASCII body, element by element."""

    def __init__(self, text: bytes, path: Path):
        self.words, self.path, self.at = text.split(), path, 0

    def read(self, element: Element) -> dict:
        """Columns of the next element."""
        if not any(p.count_kind for p in element.properties):
            width = len(element.properties)
            table = self._take(element.count * width, element)
            columns = {p.name: self._numbers(table[i::width], p) for i, p in enumerate(element.properties)}
            return columns
        values, lengths = [[] for _ in element.properties], [[] for _ in element.properties]
        for _ in range(element.count):
            for k, p in enumerate(element.properties):
                length = 1
                if p.count_kind is not None:
                    length = self._length(self._take(1, element)[0], element)
                values[k] += self._take(length, element)
                lengths[k].append(length)
        columns = {}
        for p, words, counts in zip(element.properties, values, lengths, strict=True):
            numbers = self._numbers(words, p)
            starts = np.concatenate([[0], np.cumsum(counts)]).astype(int)
            columns[p.name] = numbers if p.count_kind is None else Lists(numbers, starts)
        return columns

    def _take(self, count, element):
        if self.at + count > len(self.words):
            raise _cut_off(self.path, element)
        self.at += count
        return self.words[self.at - count:self.at]

    def _length(self, word, element):
        try:
            length = int(word)
        except ValueError:
            length = -1
        if length < 0:
            raise InputError(f"has a row of '{element.name}' whose length is {word[:20]!r}", file=self.path,
                             remedy="The file is damaged; export it again.")
        return length

    def _numbers(self, words, p):
        """Words as the type that the header names, but places in double precision, which the text may have."""
        try:
            numbers = np.array(words, dtype=np.float64) if words else np.zeros(0)
        except ValueError:
            raise InputError(f"has a '{p.name}' that is no number", file=self.path,
                             remedy="The file is damaged; export it again.") from None
        if p.kind[0] == "f":
            return numbers
        low, high = np.iinfo(p.kind).min, np.iinfo(p.kind).max
        if not ((numbers >= low) & (numbers <= high)).all():
            raise InputError(f"has a '{p.name}' that its type does not hold", file=self.path,
                             remedy="The file is damaged; export it again.")
        return numbers.astype(p.kind)
