"""COLLADA 1.4 and 1.5: geometry in double precision under its nodes, polygons with holes, diffuse colours and textures.

Read from the XML, not through pycollada: that keeps single precision, in which UTM coordinates move by half a metre,
turns NaN into 0, drops holes, and refuses sources whose stride is more than what they name.
"""

import itertools
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError
from varos_warp.scene.geometry.files.dae_materials import DaeMaterials
from varos_warp.scene.geometry.files.pieces import MeshFile, Piece, damaged, in_words
from varos_warp.scene.geometry.files.polygons import fill, strip

SURFACES = ("triangles", "polylist", "polygons", "tristrips", "trifans")
AXES = {"X_UP": "x", "Y_UP": "y", "Z_UP": "z"}


def read_dae(path: Path, with_colours: bool) -> MeshFile:
    """Read a COLLADA file."""
    try:
        root = ET.parse(path).getroot()
    except ET.ParseError as error:
        raise InputError(f"is not valid XML: {error}", remedy="Export it anew from the program that made it.") from None
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    if root.tag != "COLLADA":
        raise InputError(f"is XML, but of <{root.tag}>, not COLLADA", remedy="Export it as COLLADA.")
    return _Reader(root, path, with_colours).read()


class _Reader:
    def __init__(self, root: ET.Element, path: Path, with_colours: bool):
        self.root, self.with_colours = root, with_colours
        self.file = MeshFile(path)
        self.ids = {element.get("id"): element for element in root.iter() if element.get("id") is not None}
        self.materials = DaeMaterials(self.ids, self.file)
        self.pieces: dict[tuple, list[Piece]] = {}

    def read(self) -> MeshFile:
        axis, unit = self.root.findtext("asset/up_axis"), self.root.find("asset/unit")
        self.file.up_axis = AXES.get((axis or "Y_UP").strip().upper())
        if self.file.up_axis is None:
            self.file.note(f"asset.up_axis is {axis!r}, which COLLADA does not have: Y_UP is taken")
            self.file.up_axis = "y"
        self.file.unit_m = float(unit.get("meter", 1.0)) if unit is not None else 1.0
        if not (np.isfinite(self.file.unit_m) and self.file.unit_m > 0.0):
            raise InputError(
                "is no length",
                key="asset.unit.meter",
                value=self.file.unit_m,
                remedy="Correct it, or export the model anew.",
            )
        shown = self.root.find("scene/instance_visual_scene")
        scene = None if shown is None else self.target(shown.get("url"))
        if scene is not None:
            self._children(scene, np.eye(4), ())
        else:
            self.file.why_empty = "the document has no <scene>, or none that is in it, so it shows none of its meshes"
        if self.root.find("library_animations") is not None:
            self.file.note("its animations are not read: it stands as its nodes place it")
        return self.file

    def target(self, url: str | None) -> ET.Element | None:
        """What a reference within the file names; one to elsewhere, or to nothing, is noted."""
        found = self.ids.get((url or "").removeprefix("#")) if (url or "").startswith("#") else None
        if found is None:
            self.file.note(f"it refers to {url!r}, which is not in it: that part is left out")
        return found

    # ------------------------------------------------------------------------------------------------------ nodes

    def _children(self, parent, matrix, above) -> None:
        """What stands under a node or a scene, in the order of the file."""
        for child in parent:
            if child.tag == "node":
                self._node(child, matrix, above)
            elif child.tag == "instance_node":
                node = self.target(child.get("url"))
                if node is not None:
                    self._node(node, matrix, above)
            elif child.tag in ("instance_geometry", "instance_controller"):
                self._instance(child, matrix)

    def _node(self, node, matrix, above) -> None:
        if node in above:
            raise damaged("is below itself", key=f"node {node.get('id')}")
        self.file.count_copy()
        for child in node:
            if child.tag in ("matrix", "translate", "rotate", "scale", "lookat", "skew"):
                matrix = matrix @ _transform(child)
        self._children(node, matrix, (*above, node))

    def _instance(self, instance, matrix) -> None:
        self.file.count_copy()
        geometry = self.target(instance.get("url"))
        if geometry is not None and instance.tag == "instance_controller":
            geometry, matrix = self._of_controller(geometry, matrix)
        if geometry is None:
            return
        symbols = {bound.get("symbol"): bound for bound in instance.iter("instance_material")}
        key = (geometry.get("id"), tuple((name, bound.get("target")) for name, bound in symbols.items()))
        if key not in self.pieces:
            self.pieces[key] = list(self._geometry(geometry, symbols))
        for piece in self.pieces[key]:
            self.file.add(piece.moved(matrix))

    def _of_controller(self, controller, matrix):
        """The mesh that a skin or a morph bends, as it is bound, and its matrix."""
        self.file.note("skins and morphs are not bent: they are as they were bound")
        skin = controller.find("skin")
        inner = controller.find("morph") if skin is None else skin
        if inner is None:
            return None, matrix
        if skin is not None and (bind := skin.find("bind_shape_matrix")) is not None:
            matrix = matrix @ numbers(bind).reshape(4, 4)
        source = self.target(inner.get("source"))
        if source is not None and source.tag == "controller":
            return self._of_controller(source, matrix)
        return source, matrix

    # --------------------------------------------------------------------------------------------------- geometry

    def _geometry(self, geometry, symbols) -> Iterator[Piece]:
        mesh = geometry.find("mesh")
        if mesh is None:
            kinds = in_words(child.tag for child in geometry if child.tag not in ("asset", "extra"))
            self.file.note(f"geometry {geometry.get('id')} is a {kinds}, no mesh, and is left out")
            return
        for element in mesh:
            if element.tag in SURFACES:
                piece = self._primitive(element, symbols)
                if piece is not None:
                    yield piece
            elif element.tag in ("lines", "linestrips"):
                self.file.note("its lines are left out: only surfaces are rendered")

    def _primitive(self, element, symbols) -> Piece | None:
        inputs, stride = self._inputs(element)
        if "VERTEX" not in inputs:
            self.file.note(f"<{element.tag}> without vertices is left out")
            return None
        offset, positions, _ = inputs["VERTEX"][0]
        vertices = self.source(positions, 3)
        corners, triangles = self._triangles(element, stride, offset, vertices)
        faces = corners[triangles][..., offset]
        if not self.with_colours:
            return Piece(vertices, faces)
        look = self.materials.look(symbols.get(element.get("material")))
        uv = colours = None
        if look is not None and look.material.texture is not None:
            uv = self._corner_values(inputs, "TEXCOORD", look.coordinates, corners[triangles], 2)
            if uv is None:
                self.file.note(f"a mesh with {look.material.texture.name} has no coordinates for it: it is grey")
        if "COLOR" in inputs:
            colours = self._corner_values(inputs, "COLOR", None, corners[triangles], 3)
            colours = np.clip(colours, 0.0, 1.0).astype(np.float32)
        textured = look is not None and (look.material.texture is None or uv is not None)
        return Piece(vertices, faces, look.material if textured else None, uv, colours)

    def _corner_values(self, inputs, semantic, number, corners, width):
        """Values [F, 3, width] of a set of coordinates or colours; None without such a set."""
        sets = inputs.get(semantic, [])
        chosen = next((entry for entry in sets if number is not None and entry[2] == number), sets[0] if sets else None)
        if chosen is None:
            return None
        if semantic == "TEXCOORD" and chosen[2] != number and len(sets) > 1:
            self.file.note(
                f"a texture does not say which of the {len(sets)} sets of coordinates of its mesh it takes: "
                "the first is taken"
            )
        values, index = self.source(chosen[1], width), corners[..., chosen[0]]
        self.file.check(index, len(values), semantic)
        return values[index]

    def _inputs(self, element):
        """Offset, source and set of all inputs by semantic, those of ``vertices`` among them; and numbers a corner."""
        found, stride = {}, 1
        for entry in element.findall("input"):
            offset, number = int(entry.get("offset", 0)), entry.get("set")
            stride = max(stride, offset + 1)
            source = self.target(entry.get("source"))
            if source is None:
                continue
            if entry.get("semantic") != "VERTEX":
                found.setdefault(entry.get("semantic"), []).append((offset, source, number))
                continue
            for inner in source.findall("input"):
                semantic = "VERTEX" if inner.get("semantic") == "POSITION" else inner.get("semantic")
                values = self.target(inner.get("source"))
                if values is not None:
                    found.setdefault(semantic, []).append((offset, values, inner.get("set")))
        return found, stride

    def _triangles(self, element, stride, offset, vertices):
        """Numbers [C, stride] of all corners, and corners [T, 3] of the triangles."""
        corners, counts, holes = self._corners(element, stride)
        starts = np.concatenate([[0], np.cumsum(counts)]).astype(int)
        self.file.check(corners[:, offset], len(vertices), "vertex")
        if element.tag in ("tristrips", "trifans"):
            runs = [np.arange(*ends) for ends in itertools.pairwise(starts)]
            return corners, np.concatenate(
                [np.zeros((0, 3), int), *(strip(run) if element.tag == "tristrips" else _fan(run) for run in runs)]
            )
        places, crossed = vertices[corners[:, offset]], 0
        triangles, polygon = self.file.triangulated(vertices, corners[: starts[-1], offset], starts)
        for number, rings in holes.items():
            filled, sound = fill(places[starts[number] : starts[number + 1]], [places[ring] for ring in rings])
            ring = np.concatenate([np.arange(starts[number], starts[number + 1]), *rings])
            triangles = np.concatenate([triangles[polygon != number], ring[filled]])
            polygon = np.concatenate([polygon[polygon != number], np.full(len(filled), number)])
            crossed += not sound
        self.file.note_crossed(crossed)
        return corners, triangles

    def _corners(self, element, stride):
        """Numbers [C, stride] of the corners, how many each polygon has, and rings of corners of holes by polygon."""
        if element.tag in ("triangles", "polylist"):
            flat = numbers(element.find("p"), int)
            corners = flat[: len(flat) // stride * stride].reshape(-1, stride)
            if element.tag == "triangles":
                return corners[: len(corners) // 3 * 3], np.full(len(corners) // 3, 3), {}
            counts = numbers(element.find("vcount"), int)
            if (counts < 0).any() or counts.sum() > len(corners):
                raise damaged(f"has a polylist of {counts.sum()} corners, of which {len(corners)} are there")
            return corners, counts, {}
        outlines, inner = [], {}
        for child in element:
            if child.tag in ("p", "ph"):
                first, *cut = [child] if child.tag == "p" else [child.find("p"), *child.findall("h")]
                if cut:
                    inner[len(outlines)] = [numbers(ring, int).reshape(-1, stride) for ring in cut]
                outlines.append(numbers(first, int).reshape(-1, stride))
        counts = np.array([len(ring) for ring in outlines], int)
        at, holes, rings = int(counts.sum()), {}, []
        for polygon, cut in inner.items():
            holes[polygon] = []
            for ring in cut:
                holes[polygon].append(np.arange(at, at + len(ring)))
                rings.append(ring)
                at += len(ring)
        return np.concatenate([*outlines, *rings, np.zeros((0, stride), int)]), counts, holes

    def source(self, source: ET.Element, width: int) -> np.ndarray:
        """Values float64 [N, width] of a source, as its accessor takes them from its array."""
        accessor = source.find("technique_common/accessor")
        array = source.find("float_array")
        if accessor is not None and (accessor.get("source") or "").startswith("#"):
            named = self.ids.get(accessor.get("source")[1:])
            array = array if named is None or named.tag != "float_array" else named
        values = numbers(array)
        if accessor is None:
            return values[: len(values) // width * width].reshape(-1, width)
        stride, offset = int(accessor.get("stride", 1)), int(accessor.get("offset", 0))
        count = min(int(accessor.get("count", 0)), (len(values) - offset) // max(stride, 1))
        named = [i for i, param in enumerate(accessor.findall("param")) if param.get("name")]
        columns = (named if len(named) >= width else list(range(stride)))[:width]
        if stride < 1 or offset < 0 or count < 0 or len(columns) < width or max(columns) >= stride:
            raise damaged(f"has a source of {stride} numbers a row, {width} are needed", key=source.get("id"))
        return values[offset : offset + count * stride].reshape(count, stride)[:, columns]


def _fan(corners):
    """Triangles [T, 3] of a fan of corners [C]."""
    i = np.arange(1, max(len(corners) - 1, 1))
    return np.stack([np.broadcast_to(corners[:1], i.shape), corners[i], corners[i + 1]], axis=1)


def _transform(step) -> np.ndarray:
    """Matrix [4, 4] of one transform of a node."""
    values, T = numbers(step), np.eye(4)
    if step.tag == "matrix":
        return values.reshape(4, 4)
    if step.tag == "translate":
        T[:3, 3] = values
    elif step.tag == "scale":
        T[:3, :3] = np.diag(values)
    elif step.tag == "rotate":
        axis = values[:3] / np.linalg.norm(values[:3])
        T[:3, :3] = Rotation.from_rotvec(np.radians(values[3]) * axis).as_matrix()
    elif step.tag == "lookat":
        eye, interest, up = values.reshape(3, 3)
        back = (eye - interest) / np.linalg.norm(eye - interest)
        right = np.cross(up, back)
        right /= np.linalg.norm(right)
        T[:3, :4] = np.stack([right, np.cross(back, right), back, eye], axis=1)
    else:
        raise InputError("is not read", key="skew", remedy="Apply the transforms before export.")
    return T


def numbers(element: ET.Element | None, kind: type = float) -> np.ndarray:
    """All numbers in an element's text; none without an element."""
    return np.array((element.text or "").split() if element is not None else [], kind)
