"""Material libraries of OBJ files (Wavefront MTL), as far as they are modelled: Kd, map_Kd, map_d and map_Tr."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError
from varos_warp.files import is_file
from varos_warp.scene.geometry.files.pieces import FileMaterial, Mask, MeshFile, Texture, in_words
from varos_warp.scene.geometry.files.wavefront import (
    STATEMENTS,
    joined,
    name_of,
    shown,
    text_of,
    without_comment,
)
from varos_warp.scene.headers import is_number

FLAGS = {"-blendu", "-blendv", "-cc", "-clamp", "-imfchan", "-type", "-texres", "-bm", "-boost"}
"""Options of maps with one value."""
VECTORS = {"-o", "-s", "-t"}
"""Options with one to three numbers."""
IGNORED = {
    "map_bump": "bump maps",
    "bump": "bump maps",
    "norm": "normal maps",
    "disp": "displacement maps",
    "map_disp": "displacement maps",
    "map_ke": "emission",
    "map_ks": "gloss maps",
    "map_ns": "gloss maps",
    "refl": "reflection maps",
    "decal": "decals",
    "map_pm": "metal",
    "map_pr": "roughness",
    "map_ps": "sheen",
}
IDLE = ("map_ka", "map_aat")
"""Maps that change nothing of a Lambertian surface."""
FACTORS = {"ke": "emission", "pm": "metal", "pr": "roughness", "ps": "sheen", "pc": "clear coat"}
"""What is not modelled, where the numbers are not 0."""
NAMES = ("newmtl", "map_", *IGNORED)
"""Beginnings of the keywords whose lines end in a name, in which # is a letter like others."""
MASK_CHANNELS = ("r", "g", "b", "m", "l")
UDIM = re.compile(r"<UDIM>|<udim>")
TILES = 10
"""Tiles of a UDIM texture in a row."""
ROWS = 900
"""Rows of tiles, whose numbers have four digits."""


@dataclass(frozen=True)
class Map:
    """A picture that a material names, with the options that are read."""

    path: Path
    """Path of the picture, whose name may hold <UDIM>."""
    name: str
    """Keyword and name of the picture, for messages."""
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    wrap: str = "repeat"
    channel: str = ""
    """Channel of a mask (-imfchan); empty if it names none."""
    inverted: bool = False
    """True if a mask is a map_Tr, which has transparency instead of opacity."""

    @property
    def placing(self) -> tuple:
        """The options that place it on a surface."""
        return self.scale, self.offset, self.wrap

    @property
    def has_tiles(self) -> bool:
        """True if there is a picture for each unit square of the coordinates."""
        return UDIM.search(self.path.name) is not None

    def of_tile(self, tile: int | None) -> Path:
        """The picture of a tile; of all, if it has no tiles."""
        return self.path if tile is None else self.path.with_name(UDIM.sub(str(tile), self.path.name))


@dataclass
class MtlMaterial:
    """A material, which begins with `newmtl`."""

    kd: tuple[float, float, float] | None = None
    colour: Map | None = None
    """Map of the colour, map_Kd."""
    mask: Map | None = None
    """Map of the mask, map_d or map_Tr."""
    opaque: float = 1.0
    ignored: list[str] = field(default_factory=list)

    @property
    def says_colour(self) -> bool:
        """True if it has a colour at all."""
        return self.kd is not None or self.picture is not None

    @property
    def picture(self) -> Map | None:
        """The map whose options place colour and mask on the surface; None without any."""
        return self.colour or self.mask

    def uv(self, stored: np.ndarray) -> np.ndarray:
        """Coordinates [..., 2] after the map's -s and -o."""
        return stored if self.picture is None else stored * self.picture.scale + self.picture.offset

    def material(self, tile: int | None = None) -> FileMaterial | None:
        """What a mesh with it has; of a UDIM texture, with the picture of a tile."""
        shown_map = self.picture
        if not self.says_colour:
            return None
        base = self.kd or ((0.5,) * 3 if self.colour is None else (1.0,) * 3)
        if shown_map is None:
            return FileMaterial(base)
        if self.colour is not None and base == (0.0, 0.0, 0.0):
            base = (1.0, 1.0, 1.0)
        source = None if self.colour is None else self.colour.of_tile(tile)
        mask = None if self.mask is None else Mask(self.mask.of_tile(tile), self.mask.channel, self.mask.inverted)
        name = shown_map.name if tile is None else shown(shown_map.of_tile(tile).name)
        texture = Texture(source, name, (shown_map.wrap,) * 2, mask)
        return FileMaterial(base, 1.0, texture, None if mask is None else 0.5)

    @property
    def has_tiles(self) -> bool:
        """True if a map of it has a picture for each unit square of the coordinates."""
        return any(each is not None and each.has_tiles for each in (self.colour, self.mask))


def tiles_of(uv: np.ndarray) -> np.ndarray:
    """Numbers [F] of the UDIM tiles, from 1001 on, in which the middles of triangles [F, 3, 2] lie, or the nearest."""
    u, v = np.clip(np.nan_to_num(np.floor(uv.mean(axis=1))), 0, (TILES - 1, ROWS - 1)).astype(int).T
    return 1001 + u + TILES * v


def outside_tiles(uv: np.ndarray) -> np.ndarray:
    """Which of the triangles [F, 3, 2] have their middles in no tile, bool [F]."""
    middle = uv.mean(axis=1)
    return ((middle < 0.0) | (middle >= (TILES, ROWS))).any(axis=1)


def files_of(path: Path) -> list[Path]:
    """The pictures of a name that are there: the file itself, or all tiles of a name with <UDIM>."""
    if not UDIM.search(path.name):
        return [path] if is_file(path) else []
    tiles = re.compile(r"\d{4}".join(map(re.escape, UDIM.split(path.name))))
    return sorted(p for p in path.parent.iterdir() if tiles.fullmatch(p.name)) if path.parent.is_dir() else []


def read_mtl(path: Path, file: MeshFile) -> dict[str, MtlMaterial]:
    """Materials by name; what is not modelled of them is noted in ``file``."""
    if not is_file(path):
        file.note(f"it names {shown(path.name)}, which is not there: what it colours is grey")
        return {}
    materials: dict[str, MtlMaterial] = {}
    current = MtlMaterial()
    for number, (keyword, rest) in enumerate(_lines(path), 1):
        try:
            if keyword == "newmtl":
                current = materials.setdefault(rest, MtlMaterial())
            elif keyword.startswith("map_") and not rest:
                file.note(f"{keyword} of {shown(path.name)} names no file, and is left out")
            else:
                _set(current, keyword, rest, path, file)
        except (ValueError, IndexError):
            raise InputError(
                f"cannot be read: {keyword} {shown(rest[:60])}",
                file=path,
                line=number,
                remedy="Correct the line, or export the model anew.",
            ) from None
    _note(materials, path, file)
    return materials


def _lines(path: Path) -> Iterator[tuple[str, str]]:
    """Keyword, in small letters, and the rest of each line, which a backslash continues in the next."""
    for line in joined(text_of(path.read_bytes()), STATEMENTS).split(b"\n"):
        word, *rest = name_of(line).split(None, 1) or [""]
        keyword = word.lower()
        if keyword.startswith("#"):
            keyword, rest = "", []
        elif rest and not keyword.startswith(NAMES):
            rest = [rest[0].split("#", 1)[0].strip()]
        yield keyword, rest[0] if rest else ""


def _set(current, keyword, rest, path, file):
    """Take over one line of a material."""
    if keyword == "kd":
        current.kd = _colour(rest, path, file)
    elif keyword == "map_kd":
        current.colour = _map("map_Kd", rest, path, current.ignored)
    elif keyword in ("map_d", "map_tr"):
        mask = _map("map_d" if keyword == "map_d" else "map_Tr", rest, path, current.ignored)
        if current.mask and current.mask.inverted != mask.inverted:
            current.ignored.append(f"{current.mask.name.split()[0]} beside {mask.name.split()[0]}")
        current.mask = mask
    elif keyword == "d":
        current.opaque = float(rest.split()[-1])
    elif keyword == "tr":
        current.opaque = 1.0 - float(rest.split()[-1])
    elif keyword in IGNORED:
        current.ignored.append(IGNORED[keyword])
    elif keyword in FACTORS and any(float(word) != 0.0 for word in rest.split() if is_number(word)):
        current.ignored.append(FACTORS[keyword])
    elif keyword.startswith("map_") and keyword not in IDLE:
        current.ignored.append(keyword)


def _colour(rest, path, file):
    """Linear RGB of Kd; ``xyz`` is converted, ``spectral`` refused."""
    words = rest.split()
    if words[0] == "spectral":
        raise InputError("Kd spectral is not read", file=path, key="Kd", remedy="Give Kd as three numbers.")
    values = [float(word) for word in words[words[0] == "xyz" :][:3]]
    values = values * 3 if len(values) == 1 else values
    if words[0] == "xyz":
        values = (
            np.array(
                [
                    [3.2404542, -1.5371385, -0.4985314],
                    [-0.9692660, 1.8760108, 0.0415560],
                    [0.0556434, -0.2040259, 1.0572252],
                ]
            )
            @ values
        ).tolist()
    if len(values) != 3 or not all(np.isfinite(values)):
        raise ValueError(rest)
    if not all(0.0 <= value <= 1.0 for value in values):
        file.note(f"Kd of {path.name} is not within 0..1, and is cut to that")
    return tuple(min(max(value, 0.0), 1.0) for value in values)


def _map(keyword, rest, path, ignored) -> Map:
    """A map with its options -s, -o, -clamp, and -imfchan of a mask; others that change it are added to ``ignored``."""
    options, name = _options(rest)
    name = _name_of_picture(path.parent, name)
    scale, offset = (options.get(key, []) for key in ("-s", "-o"))
    for key, idle in (("-mm", [0.0, 1.0]), ("-t", [0.0, 0.0, 0.0]), ("-cc", "off")):
        given = options.get(key, idle)
        if given != idle and (key != "-t" or any(given)):
            ignored.append(f"{key} of {keyword}")
    channel = options.get("-imfchan", "") if keyword != "map_Kd" else ""
    if channel and channel not in MASK_CHANNELS:
        ignored.append(f"-imfchan {channel} of {keyword}")
        channel = ""
    return Map(
        _beside(path.parent, name),
        f"{keyword} {shown(name)}",
        (*scale, 1.0, 1.0)[:2] if len(scale) != 1 else (scale[0], 1.0),
        (*offset, 0.0, 0.0)[:2] if len(offset) != 1 else (offset[0], 0.0),
        "clamp" if options.get("-clamp") == "on" else "repeat",
        channel,
        keyword == "map_Tr",
    )


def _name_of_picture(folder, name):
    """A name; behind a blank, # begins a comment if there is a picture of the name before it, but none of the whole."""
    bare = without_comment(name).strip('"')
    return bare if not files_of(_beside(folder, name)) and files_of(_beside(folder, bare)) else name


def _beside(folder, name):
    return folder / name.replace("\\", "/")


def _options(rest):
    """Options of a map and its file name, which may hold blanks."""
    words, found, at = re.findall(r"\S+\s*", rest), {}, 0
    while at < len(words) and words[at].startswith("-"):
        name, at = words[at].strip(), at + 1
        if name in FLAGS:
            found[name], at = words[at].strip(), at + 1
        elif name in VECTORS or name == "-mm":
            values = []
            while at < len(words) - 1 and len(values) < 3 - (name == "-mm") and is_number(words[at].strip()):
                values.append(float(words[at]))
                at += 1
            found[name] = values
        else:
            at -= 1
            break
    if at >= len(words):
        raise ValueError(rest)
    return found, "".join(words[at:]).strip().strip('"')


def _note(materials, path, file):
    """One sentence each about what is not modelled, or not as it may be meant."""
    library, looks = shown(path.name), {shown(name): material for name, material in materials.items()}
    if ignored := dict.fromkeys(words for material in looks.values() for words in material.ignored):
        file.note(f"not modelled of {library}: {', '.join(ignored)}")
    if any(material.opaque < 1.0 for material in looks.values()):
        file.note(f"{library} has transparent materials (d or Tr), which are opaque here")
    masked = {name: m for name, m in looks.items() if m.mask is not None}
    for keyword, inverted, where in (("map_d", False, "below 0.5"), ("map_Tr", True, "above 0.5, for Tr is 1 - d")):
        if any(m.mask.inverted == inverted for m in masked.values()):
            file.note(
                f"{keyword} of {library} is read as a mask: holes where it (its alpha, or else its brightness, "
                f"if no -imfchan says otherwise) is {where}"
            )
    if other := [name for name, m in masked.items() if m.colour is not None and m.colour.placing != m.mask.placing]:
        file.note(
            f"the options -s, -o, -clamp of map_d and map_Kd of {in_words(other)} differ: those of map_Kd are "
            "taken for both"
        )
    dimmed = [name for name, m in looks.items() if m.colour is not None and m.kd not in (None, (1.0, 1.0, 1.0))]
    black = [name for name in dimmed if looks[name].kd == (0.0, 0.0, 0.0)]
    if black:
        file.note(f"Kd 0 0 0 of {black[0]} beside its map_Kd would make it black, and is left out")
    if len(dimmed) > len(black):
        name = next(name for name in dimmed if name not in black)
        file.note(f"Kd of {name} multiplies its map_Kd, as MTL has it (some programs leave it out; so does Kd 1 1 1)")
