"""Wavefront OBJ: vertices in double precision, polygons, several material libraries, colours of vertices."""

import itertools
import re
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError
from varos_warp.files import is_file
from varos_warp.scene.geometry.files.mtl import MtlMaterial, outside_tiles, read_mtl, tiles_of
from varos_warp.scene.geometry.files.pieces import MeshFile, Piece, damaged, in_words
from varos_warp.scene.geometry.files.wavefront import (
    GEOMETRY,
    joined,
    name_of,
    shown,
    text_of,
    without_comment,
    without_comments,
)
from varos_warp.scene.images import srgb_to_linear

FREE_FORM = {b"curv", b"curv2", b"surf", b"cstype", b"trim", b"deg"}
KEYWORDS = re.compile(rb"^[ \t]*(v|vt|f|fo|usemtl|mtllib|l|p|curv2?|surf|cstype|deg|trim)[ \t]([^\n]*)", re.M)
ROUNDING = 1e-3
"""Largest rounding error of a colour that was meant as 1, or as 0, in a text of few digits."""
CAPITALS = re.compile(rb"^[ \t]*(V|VT|Vt|F|FO|USEMTL|MTLLIB)[ \t]", re.M)


def read_obj(path: Path, with_colours: bool) -> MeshFile:
    """Read an OBJ file; it does not say which way is up, nor its unit."""
    file = MeshFile(path)
    text = _Text(path, file)
    vertices, colours = text.vertices(with_colours)
    coordinates = text.coordinates()
    corners, starts, material = text.faces()
    place = corners[:, 0] - 1
    triangles, polygon = file.triangulated(vertices, place, starts)
    looks = text.materials("grey" if colours is None else "as its vertices are") if with_colours else {}
    if with_colours and colours is None and len(coordinates) and not text.names_materials:
        file.note("it has texture coordinates but names no material library (mtllib): it is grey")
    for name in dict.fromkeys(material.tolist()):
        chosen = triangles[material[polygon] == name]
        look = looks.get(text.names[name])
        for piece in _pieces(vertices, colours, coordinates, corners, chosen, look, file):
            file.add(piece)
    return file


def _pieces(vertices, colours, coordinates, corners, chosen, look, file):
    """Pieces of the triangles [F, 3] of one material: those with coordinates and without, and one for each tile."""
    faces = corners[chosen, 0] - 1
    painted = None if colours is None else colours[faces]
    if painted is not None:
        plain = np.isnan(painted).all(axis=(1, 2))
        if look is not None and look.says_colour and plain.any():
            return [
                piece
                for mine, own in ((~plain, colours), (plain, None))
                if mine.any()
                for piece in _pieces(vertices, own, coordinates, corners, chosen[mine], look, file)
            ]
        painted = np.nan_to_num(painted, nan=0.5)
    if look is None or look.picture is None:
        return [Piece(vertices, faces, None if look is None else look.material(), None, painted)]
    has_uv = (corners[chosen, 1] != 0).all(axis=1)
    found = []
    if not has_uv.all():
        file.note(f"some faces have {look.picture.name} but no coordinates (vt): they have its Kd alone")
        bare = MtlMaterial(look.kd or (0.5, 0.5, 0.5)).material()
        found.append(Piece(vertices, faces[~has_uv], bare, None, None if painted is None else painted[~has_uv]))
    if has_uv.any():
        at = corners[chosen[has_uv], 1] - 1
        file.check(at, len(coordinates), "texture coordinate")
        uv = look.uv(coordinates[at])
        tile = tiles_of(uv) if look.has_tiles else np.zeros(len(uv), int)
        if look.has_tiles and outside_tiles(uv).any():
            file.note(
                f"some faces with {look.picture.name} lie outside of the tiles (u of 0..10, v of 0..900): they "
                "have the nearest"
            )
        for number in np.unique(tile):
            mine = tile == number
            found.append(
                Piece(
                    vertices,
                    faces[has_uv][mine],
                    look.material(number if look.has_tiles else None),
                    uv[mine],
                    None if painted is None else painted[has_uv][mine],
                )
            )
    return found


class _Text:
    """The lines of an OBJ file by keyword, in their order."""

    def __init__(self, path: Path, file: MeshFile):
        self.path, self.file = path, file
        data = text_of(path.read_bytes())
        if b"\0" in data[:4096]:
            raise InputError("is not a text file", remedy="Binary OBJ files are not read; export text.")
        data = without_comments(joined(data, GEOMETRY), GEOMETRY)
        self.names: list[str] = [""]
        """Names of the materials, in the order of their first use; the first, empty, is that of faces without any."""
        self._libraries: list[str] = []
        self._rows: dict[bytes, list[bytes]] = {b"v": [], b"vt": [], b"f": []}
        self._counted: dict[bytes, np.ndarray] = {}
        self._events: list[tuple[int, int, int, int]] = []
        """Runs of faces with one material: the first face, the material, and how many v and vt came before, of each."""
        self._sort(data)
        if (capital := CAPITALS.search(data)) is not None:
            self._note_capitals(capital[1].decode())

    def _sort(self, data):
        """Share the lines out; only faces need their order among the others, for relative numbers and materials."""
        rows, known, current = self._rows, {"": 0}, 0
        v, vt, f = rows[b"v"], rows[b"vt"], rows[b"f"]
        ignored = set()
        last = (-1, -1, -1)
        for match in KEYWORDS.finditer(data):
            keyword, rest = match.groups()
            if keyword == b"v":
                v.append(rest)
            elif keyword == b"vt":
                vt.append(rest)
            elif keyword in (b"f", b"fo"):
                if (current, len(v), len(vt)) != last:
                    last = (current, len(v), len(vt))
                    self._events.append((len(f), *last))
                f.append(rest)
            elif keyword == b"usemtl":
                current = known.setdefault(name_of(rest), len(known))
            elif keyword == b"mtllib":
                self._libraries.append(name_of(rest))
            else:
                ignored.add(keyword)
        self.names = list(known)
        if ignored & FREE_FORM:
            self.file.note("its free-form curves and surfaces are left out: export them as polygons")
        if ignored - FREE_FORM:
            self.file.note("its points and lines are left out: only surfaces are rendered")

    def _note_capitals(self, keyword):
        """Keywords in capitals are not those of OBJ: told, and refused where nothing else makes a surface."""
        if not self._rows[b"f"]:
            raise InputError(
                "its keywords are in capitals, those of OBJ are small letters",
                value=keyword,
                remedy="Write v, vt, f, usemtl and mtllib, or export it anew.",
            )
        self.file.note(f"its lines that begin with {keyword} are left out: keywords of OBJ are small letters")

    def vertices(self, with_colours: bool) -> tuple[np.ndarray, np.ndarray | None]:
        """Places float64 [V, 3], and linear colours float32 [V, 3], of some perhaps NaN; None if no vertex has one."""
        widths = self._widths_of(b"v")
        if (widths > 3).any():
            self._note_widths(widths)
        if not (with_colours and (widths >= 6).any()):
            return self.numbers(b"v", 3), None
        values = self.numbers(b"v", 6)
        places, colours = values[:, :3].copy(), values[:, 3:]
        has = (widths >= 6) & np.isfinite(colours).all(axis=1)
        painted = np.full(colours.shape, np.nan, np.float32)
        painted[has] = srgb_to_linear(np.clip(colours[has] / self._white(colours[has]), 0.0, 1.0))
        if not has.all():
            self.file.note("some of its vertices have no colour: they are grey, or as their material is")
        return places, painted

    def _white(self, colours):
        """The number that is white in colours [N, 3]: 1, or 255 if all are whole and one is above 1."""
        low, high = colours.min(initial=0.0), colours.max(initial=0.0)
        if low >= -ROUNDING and high <= 1.0 + ROUNDING:
            return 1.0
        if low >= 0.0 and high <= 255.0 and (colours == np.floor(colours)).all():
            return 255.0
        raise InputError(
            f"has colours of vertices from {low:g} to {high:g}, which are neither within 0..1 nor whole "
            "numbers of 0..255",
            key="v",
            remedy="Export it with colours of 0 to 1, or give it a material of the scene.",
        )

    def _note_widths(self, widths):
        """What of the numbers behind x, y, z is left out: weights that count, alpha, what OBJ does not have."""
        if (widths == 4).any() and (self.numbers(b"v", 4)[widths == 4, 3] != 1.0).any():
            self.file.note(
                "the fourth numbers of its vertices are weights, which count only in rational curves and "
                "surfaces: x, y, z are taken as they stand"
            )
        if (widths == 7).any():
            self.file.note("its vertices of 7 numbers are taken as x y z r g b a, without the alpha")
        if odd := sorted(width for width in {*widths.tolist()} if width == 5 or width > 7):
            self.file.note(
                f"it has vertices of {odd[0]} numbers, of which the first "
                f"{'3 (x y z)' if odd[0] == 5 else '6 (x y z r g b)'} are taken"
            )

    def coordinates(self) -> np.ndarray:
        """Coordinates of textures, float64 [N, 2]; v may be missing and is 0, a third number counts in solids alone."""
        if (most := self._widths_of(b"vt").max(initial=0)) > 3:
            self.file.note(f"it has texture coordinates (vt) of {most} numbers, of which the first 2 (u v) are taken")
        return self.numbers(b"vt", 2)

    def numbers(self, keyword: bytes, width: int) -> np.ndarray:
        """The first ``width`` numbers of each line, float64 [N, width]; those that a line does not have are 0.

        Raises:
            InputError: A vertex has less than 3 numbers, a texture coordinate none, or words are no numbers.
        """
        rows, widths = self._rows[keyword], self._widths_of(keyword)
        least, what = (3, "vertex") if keyword == b"v" else (1, "texture coordinate")
        if (short := np.flatnonzero(widths < least)).size:
            raise damaged(
                f"has a {what} of {widths[short[0]]} numbers: {rows[short[0]][:60].decode('utf-8', 'replace')}",
                key=keyword.decode(),
            )
        values, starts, out = _flat(rows), np.cumsum(widths) - widths, np.zeros((len(rows), width))
        if values is not None:
            for k in range(width):
                has = widths > k
                out[has, k] = values[starts[has] + k]
            return out
        for i, row in enumerate(rows):  # one word, perhaps behind what is read, is no number
            words = row.split()[:width]
            try:
                out[i, : len(words)] = [float(word) for word in words]
            except ValueError:
                raise damaged(f"has a line that is no numbers: {row[:60].decode('utf-8', 'replace')}") from None
        return out

    def _widths_of(self, keyword: bytes) -> np.ndarray:
        """How many words each line of a keyword has, int64 [N]; counted once, for there may be millions."""
        if keyword not in self._counted:
            self._counted[keyword] = _widths(self._rows[keyword])
        return self._counted[keyword]

    def faces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Corners of all faces, where these start, and their materials.

        Returns:
            Numbers from 1 of vertex and coordinates (0: none) of the corners int64 [C, 2], the first corner of each
            face and the number of corners int64 [F + 1], and the material of each face int64 [F].
        """
        rows = self._rows[b"f"]
        corners, counts = _corners(rows)
        starts = np.concatenate([[0], np.cumsum(counts)])
        runs = np.array(self._events, np.int64).reshape(-1, 4)
        lengths = np.diff(np.append(runs[:, 0], len(rows)))
        material = np.repeat(runs[:, 1], lengths)
        if (corners < 0).any():
            before = np.repeat(np.repeat(runs[:, 2:], lengths, axis=0), counts, axis=0)
            corners = np.where(corners < 0, before + corners + 1, corners)
            corners[:, 0] = np.where(corners[:, 0] < 1, -1, corners[:, 0])
        return corners, starts, material

    @property
    def names_materials(self) -> bool:
        """True if it names materials, or libraries of them."""
        return bool(self._libraries or self.names[1:])

    def materials(self, otherwise: str) -> dict[str, MtlMaterial]:
        """The materials that the file uses, of all libraries the first of each name.

        Args:
            otherwise: How a surface without one looks, for the notes.
        """
        found: dict[str, MtlMaterial] = {}
        paths = [path for line in self._libraries for path in library_paths(self.path.parent, line)]
        for path in paths:
            for name, material in read_mtl(path, self.file).items():
                found.setdefault(name, material)
        looks = {name: look for name in self.names[1:] if (look := _look(found, name)) is not None}
        unknown = [shown(name) for name in self.names[1:] if name not in looks]
        if unknown and not paths:
            self.file.note(
                f"it names no material library (mtllib) for {in_words(unknown)}: what they colour is {otherwise}"
            )
        elif unknown and any(map(is_file, paths)):
            self.file.note(f"no library has the material {in_words(unknown)}: what it colours is {otherwise}")
        bare = [shown(name) for name, look in looks.items() if not look.says_colour]
        if bare and otherwise == "grey":
            self.file.note(f"no Kd or map_Kd of {in_words(bare)}: what it colours is grey")
        return looks


def _look(found, name):
    """A material by its name; behind a blank, # may begin a comment where it is named, or where it is defined."""
    if name in found:
        return found[name]
    if without_comment(name) != name:
        return found.get(without_comment(name))
    meant = [look for other, look in found.items() if without_comment(other) == name]
    return meant[0] if len(meant) == 1 else None


def library_paths(folder: Path, line: str) -> list[Path]:
    """Files that a mtllib line names: one whose name holds blanks, or several."""
    for name in (line, without_comment(line)):
        whole = folder / name.strip().strip('"').replace("\\", "/")
        if is_file(whole):
            return [whole]
    names = without_comment(line).split()
    return [folder / name.replace("\\", "/") for name in names] if len(names) > 1 else [whole]


def _widths(rows):
    """How many words each line has, int64 [N]."""
    return np.fromiter(map(len, map(bytes.split, rows)), np.int64, len(rows))


def _flat(rows):
    """All numbers of some lines, float64; None if they are not only numbers."""
    try:
        return np.array(b" ".join(rows).split(), dtype=np.float64)
    except ValueError:
        return None


def _corners(rows):
    """Numbers int64 [C, 2] of the corners of faces, and how many each has int64 [F]."""
    counts = _widths(rows)
    words = b" ".join(rows).split()
    slashes = np.fromiter((word.count(b"/") for word in words), np.int64, len(words))
    try:
        if not slashes.any():
            first = np.array(words, np.int64) if words else np.zeros(0, np.int64)
            return np.stack([first, np.zeros_like(first)], axis=1), counts
        pairs = [(word.split(b"/") + [b""])[:2] for word in words]
        flat = np.array([number or b"0" for number in itertools.chain.from_iterable(pairs)], dtype=np.int64)
    except (ValueError, OverflowError):
        raise damaged("has a face that is no numbers of vertices") from None
    return flat.reshape(-1, 2), counts
