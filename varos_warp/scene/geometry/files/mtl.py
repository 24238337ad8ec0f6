"""Material libraries of OBJ files (Wavefront MTL), as far as they are modelled: Kd, map_Kd and map_d."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError
from varos_warp.files import is_file
from varos_warp.scene.geometry.files.pieces import FileMaterial, MeshFile, Texture

FLAGS = {"-blendu", "-blendv", "-cc", "-clamp", "-imfchan", "-type", "-texres", "-bm", "-boost"}
"""Options of maps with one value."""
VECTORS = {"-o", "-s", "-t"}
"""Options with one to three numbers."""
IGNORED = {"map_bump": "bump maps", "bump": "bump maps", "norm": "normal maps", "disp": "displacement maps",
           "map_ke": "emission", "map_ks": "gloss maps", "refl": "reflection maps", "decal": "decals"}
UDIM = re.compile(r"<UDIM>|<udim>")
TILES = 10
"""Tiles of a UDIM texture in a row."""


@dataclass
class MtlMaterial:
    """One `newmtl`."""

    kd: tuple[float, float, float] | None = None
    texture: Texture | None = None
    """Its name may hold <UDIM>."""
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    opaque: float = 1.0
    alpha_map: Path | None = None
    ignored: list[str] = field(default_factory=list)

    @property
    def says_colour(self) -> bool:
        """Whether it has a colour at all."""
        return self.kd is not None or self.texture is not None

    def uv(self, stored: np.ndarray) -> np.ndarray:
        """Coordinates [..., 2] after the map's -s and -o."""
        return stored * self.scale + self.offset

    def material(self, tile: int | None = None) -> FileMaterial | None:
        """What a mesh with it has; of a UDIM texture, with the picture of a tile."""
        if not self.says_colour:
            return None
        base = (1.0, 1.0, 1.0) if self.kd is None else self.kd
        if self.texture is None:
            return FileMaterial(base)
        if base == (0.0, 0.0, 0.0):
            base = (1.0, 1.0, 1.0)
        texture = replace(self.texture, mask=self.alpha_map)
        if tile is not None and isinstance(texture.source, Path):
            name = UDIM.sub(str(tile), texture.source.name)
            texture = replace(texture, source=texture.source.with_name(name), name=name)
        return FileMaterial(base, 1.0, texture, None if self.alpha_map is None else 0.5)

    @property
    def has_tiles(self) -> bool:
        """Whether its texture has a picture for each unit square of the coordinates."""
        return self.texture is not None and isinstance(self.texture.source, Path) and bool(
            UDIM.search(self.texture.source.name))


def tiles_of(uv: np.ndarray) -> np.ndarray:
    """Numbers [F] of the UDIM tiles, from 1001 on, in which the middles of triangles [F, 3, 2] lie."""
    u, v = np.moveaxis(np.floor(uv.mean(axis=1)).astype(int), 1, 0)
    return 1001 + np.clip(u, 0, TILES - 1) + TILES * np.clip(v, 0, 899)


def read_mtl(path: Path, file: MeshFile) -> dict[str, MtlMaterial]:
    """Materials by name; what is not modelled of them is noted in ``file``."""
    if not is_file(path):
        file.note(f"it names {path.name}, which is not there: what it colours is grey")
        return {}
    materials: dict[str, MtlMaterial] = {}
    current = MtlMaterial()
    for number, (keyword, rest) in enumerate(_lines(path), 1):
        try:
            if keyword == "newmtl":
                current = materials.setdefault(rest, MtlMaterial())
            else:
                _set(current, keyword.lower(), rest, path, file)
        except (ValueError, IndexError):
            raise InputError(f"cannot be read: {keyword} {rest[:60]}", file=path, line=number,
                             remedy="Correct the line, or export the model anew.") from None
    _note(materials, path, file)
    return materials


def _lines(path: Path) -> Iterator[tuple[str, str]]:
    """Keyword and the rest of each line, which a backslash continues in the next; empty for blank ones."""
    text = path.read_bytes().decode("utf-8-sig", "replace").replace("\\\r\n", " ").replace("\\\n", " ")
    for line in text.splitlines():
        line = line.strip() if line.lstrip().startswith("map_") else line.split("#", 1)[0].strip()
        keyword, *rest = line.split(None, 1)[:2] or [""]
        yield keyword, rest[0] if rest else ""


def _set(current, keyword, rest, path, file):
    """Take over one line of a material."""
    if keyword == "kd":
        current.kd = _colour(rest, path, file)
    elif keyword == "map_kd":
        _set_map(current, rest, path)
    elif keyword in ("map_d", "map_tr"):
        current.alpha_map = path.parent / _name(_options(rest)[1])
    elif keyword == "d":
        current.opaque = float(rest.split()[-1])
    elif keyword == "tr":
        current.opaque = 1.0 - float(rest.split()[-1])
    elif keyword in IGNORED:
        current.ignored.append(IGNORED[keyword])


def _colour(rest, path, file):
    """Linear RGB of Kd; ``xyz`` is converted, ``spectral`` refused."""
    words = rest.split()
    if words[0] == "spectral":
        raise InputError("Kd spectral is not read", file=path, key="Kd", remedy="Give Kd as three numbers.")
    values = [float(word) for word in words[words[0] == "xyz":][:3]]
    values = values * 3 if len(values) == 1 else values
    if words[0] == "xyz":
        values = (np.array([[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560],
                            [0.0556434, -0.2040259, 1.0572252]]) @ values).tolist()
    if len(values) != 3 or not all(np.isfinite(values)):
        raise ValueError(rest)
    if not all(0.0 <= value <= 1.0 for value in values):
        file.note(f"Kd of {path.name} is not within 0..1, and is cut to that")
    return tuple(min(max(value, 0.0), 1.0) for value in values)


def _set_map(current, rest, path):
    """map_Kd with its options: -s and -o of the coordinates, -clamp; others that would change colours are noted."""
    options, name = _options(rest)
    scale, offset = (options.get(key, []) for key in ("-s", "-o"))
    current.scale = tuple((scale + [1.0, 1.0])[:2]) if len(scale) != 1 else (scale[0], 1.0)
    current.offset = tuple((offset + [0.0, 0.0])[:2]) if len(offset) != 1 else (offset[0], 0.0)
    wrap = "clamp" if options.get("-clamp") == "on" else "repeat"
    current.texture = Texture(path.parent / _name(name), f"map_Kd {name}", (wrap, wrap))
    if options.get("-mm", [0.0, 1.0]) != [0.0, 1.0]:
        current.ignored.append("-mm of map_Kd")
    if any(options.get("-t", ())):
        current.ignored.append("-t of map_Kd")
    if options.get("-cc") == "on":
        current.ignored.append("-cc of map_Kd")


def _options(rest):
    """Options of a map and its file name, which may hold blanks."""
    words, found, at = re.findall(r"\S+\s*", rest), {}, 0
    while at < len(words) and words[at].startswith("-"):
        name, at = words[at].strip(), at + 1
        if name in FLAGS:
            found[name], at = words[at].strip(), at + 1
        elif name in VECTORS or name == "-mm":
            values = []
            while at < len(words) - 1 and len(values) < 3 - (name == "-mm") and _is_number(words[at].strip()):
                values.append(float(words[at]))
                at += 1
            found[name] = values
        else:
            at -= 1
            break
    if at >= len(words):
        raise ValueError(rest)
    return found, "".join(words[at:]).strip().strip('"')


def _is_number(word):
    try:
        float(word)
    except ValueError:
        return False
    return True


def _name(name):
    """A file name with the separators of every system."""
    return name.replace("\\", "/")


def _note(materials, path, file):
    """One sentence each about what is not modelled."""
    ignored = dict.fromkeys(words for material in materials.values() for words in material.ignored)
    if ignored:
        file.note(f"not modelled of {path.name}: {', '.join(ignored)}")
    if any(material.opaque < 1.0 for material in materials.values()):
        file.note(f"{path.name} has transparent materials (d or Tr), which are opaque here")
    if any(material.alpha_map is not None and material.texture is not None for material in materials.values()):
        file.note(f"map_d of {path.name} is read as a mask: holes where it is below 0.5")
    dimmed = [name for name, m in materials.items() if m.texture is not None and m.kd not in (None, (1.0, 1.0, 1.0))]
    black = [name for name in dimmed if materials[name].kd == (0.0, 0.0, 0.0)]
    if black:
        file.note(f"Kd 0 0 0 of {black[0]} beside its map_Kd would make it black, and is left out")
    if len(dimmed) > len(black):
        name = next(name for name in dimmed if name not in black)
        file.note(f"Kd of {name} multiplies its map_Kd, as MTL has it (some programs leave it out; so does Kd 1 1 1)")
