"""PLY: ASCII and binary, polygons and strips, colours of vertices and faces, textures as MeshLab writes them."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError, counted
from varos_warp.scene.geometry.files.pieces import FileMaterial, MeshFile, Piece, Texture, damaged, in_words
from varos_warp.scene.geometry.files.polygons import strip
from varos_warp.scene.geometry.files.wavefront import shown, text_of
from varos_warp.scene.images import srgb_to_linear

NAMES = "char uchar short ushort int uint float double".split()
SIZED = "int8 uint8 int16 uint16 int32 uint32 float32 float64".split()
KINDS = {name: np.dtype(sized).str[1:] for names in (NAMES, SIZED) for name, sized in zip(names, SIZED, strict=True)}
"""NumPy's types of a number by PLY's names of them, the older and the newer ones."""
INDICES = ("vertex_indices", "vertex_index")
COLOURS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
COORDINATES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
COLOUR_LIKE = re.compile(r"(^|_)(red|green|blue|rgba?|colou?rs?|gr[ae]y|luminance|dc)(_|\d|$)")
LONGEST_HEADER = 1 << 20
END = re.compile(rb"[\r\n]end_header(?=[ \t]*[\r\n]|\Z)")


@dataclass
class Property:
    """A number, or a list of numbers, of each row of an element."""

    name: str
    kind: str
    count_kind: str | None = None
    """Type of the length of a list; None if it is a single number."""


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
    form, elements, textures, start = read_header(data)
    columns = _read_body(data, start, form, elements, file)
    vertex, face, strips = (_by_small_letters(columns, name) for name in ("vertex", "face", "tristrips"))
    if not all(axis in vertex for axis in "xyz"):
        raise InputError("has no vertices with x, y, z", remedy="Export a surface as PLY.")
    vertices = np.stack([vertex[axis] for axis in "xyz"], axis=1).astype(float)
    if (rings := _rings(face)) is not None:
        _add_polygons(file, vertices, vertex, face, rings, textures, with_colours)
    if (rings := _rings(strips)) is not None:
        faces = _strip_faces(rings)
        triangles = Lists(faces.reshape(-1), 3 * np.arange(len(faces) + 1))
        _add_polygons(file, vertices, vertex, {}, triangles, textures, with_colours)
    if with_colours:
        _note_unread_colours(vertex, face, file)
    if any(element.name == "edge" and element.count for element in elements):
        file.note("its points and lines are left out: only surfaces are rendered")
    return file


def _by_small_letters(columns, element):
    """Columns of an element, whatever letters the file writes names in; one whose name is just so goes first."""
    found = {name.lower(): column for name, column in columns.items()} | columns
    rows = found.get(element, {})
    return {name.lower(): column for name, column in rows.items()} | rows


def _rings(rows):
    """Corners of the polygons or strips of an element; None without any."""
    return next((rows[name] for name in INDICES if isinstance(rows.get(name), Lists)), None)


def _note_unread_colours(vertex, face, file):
    """Tell of properties whose names are those of colours, and which are not read."""
    of_face, of_vertex = _colour_names(face) or (), _colour_names(vertex) or ()
    if of_face and of_vertex:
        file.note("the colours of its faces go before those of its vertices")
    unread = {
        f"{element} {name.lower()}": None
        for element, rows, read in (("vertex", vertex, of_vertex), ("face", face, of_face))
        for name in rows
        if name.lower() not in read and COLOUR_LIKE.search(name.lower())
    }
    if unread:
        file.note(f"properties with names of colours are not read: {shown(in_words(unread))}")


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
        if k == -1:  # so MeshLab says that a face has none
            file.add(Piece(vertices, faces[mine], None, None, None if colours is None else colours[mine]))
            continue
        if not 0 <= k < len(textures):
            raise damaged(f"a face has texture {k} of {len(textures)}", key="texnumber")
        texture = Texture(file.path.parent / textures[k], f"TextureFile {shown(textures[k])}")
        file.add(
            Piece(
                vertices,
                faces[mine],
                FileMaterial(texture=texture),
                uv[mine],
                None if colours is None else colours[mine],
            )
        )


def _painted(vertex, face, faces, polygon, file):
    """Colours [F, 3, 3] of the corners: of faces, else of vertices; None without any."""
    if (of_faces := _colours(face, file)) is not None:
        return np.repeat(of_faces[polygon][:, None], 3, axis=1)
    of_vertices = _colours(vertex, file)
    return None if of_vertices is None else of_vertices[faces]


def _colour_names(columns):
    """Names of the properties that are colours; None without any."""
    return next((names for names in COLOURS if all(isinstance(columns.get(name), np.ndarray) for name in names)), None)


def _colours(columns, file) -> np.ndarray | None:
    """Linear reflectances float32 [N, 3] of rows: integers are sRGB of their whole range, floats are linear."""
    names = _colour_names(columns)
    if names is None:
        return None
    values = np.stack([columns[name] for name in names], axis=1)
    if values.dtype.kind in "iu":
        top, largest = float(np.iinfo(values.dtype).max), values.max(initial=0)
        for bits, white in ((8, 255.0), (16, 65535.0)):
            if 0 < largest <= white < top:
                file.note(
                    f"its colours are stored in {8 * values.dtype.itemsize} bits, but none is above {white:.0f}: "
                    f"they are taken as such of {bits} bits"
                )
                top = white
        return srgb_to_linear(np.maximum(values / top, 0.0)).astype(np.float32)
    if not (np.isfinite(values).all() and values.min(initial=0.0) >= 0.0 and values.max(initial=0.0) <= 1.0):
        raise InputError(
            "has colours in real numbers that are not within 0..1",
            key=names[0],
            remedy="Export colours of 8 bits.",
        )
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


def read_header(data):
    """Byte order (ascii, <, >), elements, names of textures, and where the body begins."""
    found = END.search(data, 0, LONGEST_HEADER)
    if not data.startswith(b"ply") or found is None:
        raise InputError("has no PLY header", remedy="Export it anew from the program that made it.")
    end = found.start() + 1
    start = data.find(b"\n", end) + 1 or len(data)
    if data[end + 10 : end + 11] == b"\r" and data[end + 11 : end + 12] != b"\n":
        start = end + 11  # lines end as on old Macs
    form, elements, textures = None, [], []
    for line in text_of(data[:end]).decode("utf-8", "surrogateescape").split("\n"):
        words = line.split()
        if words[:1] == ["format"]:
            form = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}.get(words[1])
        elif words[:2] == ["comment", "TextureFile"] and len(words) > 2:
            textures.append(line.split(None, 2)[2].strip().strip('"').replace("\\", "/"))
        elif words[:1] == ["element"]:
            elements.append(Element(words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1].properties.append(_property(words))
    if form is None:
        raise InputError(
            "is of a format that PLY does not have",
            key="format",
            remedy="Export it as binary_little_endian.",
        )
    if any(element.count < 0 for element in elements):
        raise damaged("has an element of less than no rows", key="element")
    return form, elements, textures, start


def _property(words) -> Property:
    kinds = words[2:4] if words[1] == "list" else [words[1]]
    if not all(kind in KINDS for kind in kinds):
        raise InputError(
            f"has a type that PLY does not have: {' '.join(words)}",
            key="property",
            remedy="Export it anew from the program that made it.",
        )
    if len(kinds) == 2:
        return Property(words[4], KINDS[kinds[1]], KINDS[kinds[0]])
    return Property(words[2], KINDS[kinds[0]])


# ---------------------------------------------------------------------------------------------------------------- body


def _read_body(data, start, form, elements, file) -> dict[str, dict]:
    """Columns of all elements by name: arrays, or `Lists`; what stands behind them is noted."""
    found, at = {}, start
    words = _AsciiBody(data[start:]) if form == "ascii" else None
    for element in elements:
        if words is not None:
            found[element.name] = words.read(element)
        else:
            found[element.name], at = _read_binary(data, at, form, element)
    rest = len(data[at:] if data[at:].strip() else b"") if words is None else len(words.words) - words.at
    if rest:
        file.note(
            f"{counted(rest, 'byte' if words is None else 'word')} behind the rows that its header counts are left out"
        )
    return found


def _cut_off(element):
    return InputError(
        f"ends within its {element.count} rows of '{element.name}'",
        remedy="Copy or export it again; the transfer may have broken off.",
    )


def _read_binary(data, at, order, element):
    """Columns of one element, and where the next begins."""
    if not any(p.count_kind for p in element.properties):
        row = np.dtype([(f"{i}", order + p.kind) for i, p in enumerate(element.properties)])
        if at + row.itemsize * element.count > len(data):
            raise _cut_off(element)
        table = np.frombuffer(data, row, element.count, at)
        return {p.name: table[f"{i}"] for i, p in enumerate(element.properties)}, at + row.itemsize * element.count
    even = _read_even(data, at, order, element)
    if even is not None:
        return even
    return _read_uneven(data, at, order, element)


def _read_even(data, at, order, element):
    """Return what `_read_binary` does, if all lists are as long as in the first row; None if they are not."""
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


def _read_uneven(data, at, order, element):
    """Return what `_read_binary` does, reading row by row."""
    kinds = [
        (np.dtype(order + p.kind), None if p.count_kind is None else np.dtype(order + p.count_kind))
        for p in element.properties
    ]
    pieces, lengths = [[] for _ in kinds], [[] for _ in kinds]
    for _ in range(element.count):
        for k, (kind, head) in enumerate(kinds):
            length = 1
            if head is not None:
                if at + head.itemsize > len(data):
                    raise _cut_off(element)
                length = int(np.frombuffer(data, head, 1, at)[0])
                at += head.itemsize
            end = at + length * kind.itemsize
            if length < 0 or end > len(data):
                raise _cut_off(element)
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

    def __init__(self, text: bytes):
        self.words, self.at = text.split(), 0

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
            raise _cut_off(element)
        self.at += count
        return self.words[self.at - count : self.at]

    def _length(self, word, element):
        try:
            length = int(word)
        except ValueError:
            length = -1
        if length < 0:
            raise damaged(f"has a row of '{element.name}' whose length is {word[:20]!r}")
        return length

    def _numbers(self, words, p):
        """Words as the type that the header names, but places in double precision, which the text may have."""
        try:
            numbers = np.array(words, dtype=np.float64) if words else np.zeros(0)
        except ValueError:
            raise damaged(f"has a '{p.name}' that is no number") from None
        if p.kind[0] == "f":
            return numbers
        low, high = np.iinfo(p.kind).min, np.iinfo(p.kind).max
        if not ((numbers >= low) & (numbers <= high)).all():
            raise damaged(f"has a '{p.name}' that its type does not hold")
        return numbers.astype(p.kind)
