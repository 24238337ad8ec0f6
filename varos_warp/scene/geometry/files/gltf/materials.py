"""Materials of glTF as far as they are modelled: base colour, its texture, and masks."""

from typing import Any

import numpy as np

from varos_warp.scene.geometry.files.gltf.document import Document
from varos_warp.scene.geometry.files.pieces import FileMaterial, Texture, damaged

WRAPPING = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
NEAREST = 9728
ROUNDING = 1e-6
"""Largest rounding error, in single precision, of a factor that was meant as 1."""


class Look:
    """A material, and how it takes texture coordinates from those of the mesh."""

    def __init__(self, material: FileMaterial, coordinates: int = 0, transform: np.ndarray | None = None):
        self.material = material
        self.coordinates = coordinates
        """Number of the set of texture coordinates."""
        self.transform = np.eye(3)[:2] if transform is None else transform
        """Transform of coordinates with v down, float64 [2, 3]."""

    def uv(self, stored: np.ndarray) -> np.ndarray:
        """Coordinates [..., 2], v up, of those that the mesh has, v down."""
        there = stored @ self.transform[:, :2].T + self.transform[:, 2]
        return np.stack([there[..., 0], 1.0 - there[..., 1]], axis=-1)


class Materials:
    """The materials of a document, each made once, with what is not read of them."""

    def __init__(self, document: Document):
        self.document = document
        self.ignored: dict[str, None] = {}
        """What the notes will name."""
        self._looks: dict[int, Look] = {}

    def look(self, index: Any) -> Look:
        """A material by its number."""
        if index not in self._looks:
            self._looks[index] = self._read(self.document.get("materials", index), f"materials.{index}")
        return self._looks[index]

    def notes(self) -> list[str]:
        """One sentence about all that is not modelled."""
        if not self.ignored:
            return []
        return [f"not modelled: {', '.join(self.ignored)}; surfaces are Lambertian and opaque"]

    def _read(self, block, key):
        document = self.document
        metallic = block.get("pbrMetallicRoughness") or {}
        older = document.extension(block, "KHR_materials_pbrSpecularGlossiness")
        factor, info = metallic.get("baseColorFactor"), metallic.get("baseColorTexture")
        if older is not None:
            factor, info = older.get("diffuseFactor"), older.get("diffuseTexture")
        elif _is_metal(metallic) and not document.extension(block, "KHR_materials_unlit"):
            self.ignored["metal"] = None
        for name, words in (
            ("normalTexture", "normal maps"),
            ("occlusionTexture", "occlusion maps"),
            ("emissiveTexture", "emission"),
        ):
            if block.get(name):
                self.ignored[words] = None
        if np.any(np.asarray(block.get("emissiveFactor") or 0.0, float) > 0.0):
            self.ignored["emission"] = None
        mode = block.get("alphaMode", "OPAQUE")
        if mode == "BLEND":
            self.ignored["transparency (alphaMode BLEND)"] = None
        elif mode not in ("OPAQUE", "MASK"):
            self.ignored[f"alphaMode {mode!r}, which glTF does not have (OPAQUE, MASK, BLEND)"] = None
        colour = self._factor(factor, key, "baseColorFactor" if older is None else "diffuseFactor")
        cutoff = float(block.get("alphaCutoff", 0.5)) if mode == "MASK" else None
        if info is None:
            return Look(FileMaterial(tuple(colour[:3]), float(colour[3]), None, cutoff))
        texture = self._texture(info.get("index"), f"{key}.baseColorTexture")
        coordinates, transform = self._transform(info)
        return Look(FileMaterial(tuple(colour[:3]), float(colour[3]), texture, cutoff), coordinates, transform)

    def _factor(self, factor, key, name):
        """Factors of red, green, blue and alpha, which rounding may leave just above 1."""
        colour = np.asarray([1.0, 1.0, 1.0, 1.0] if factor is None else factor, float)
        if colour.shape != (4,):
            raise damaged(f"has a {name} that is not 4 numbers (red, green, blue, alpha)", key)
        if not ((colour >= 0.0) & (colour <= 1.0 + ROUNDING)).all():
            raise damaged(f"{name} is not within 0..1", key)
        return np.minimum(colour, 1.0)

    def _transform(self, info):
        """Set of coordinates, and matrix [2, 3] (KHR_texture_transform: scaled, turned, moved; v is down)."""
        coordinates = info.get("texCoord", 0)
        given = self.document.extension(info, "KHR_texture_transform")
        if given is None:
            return coordinates, None
        angle = float(given.get("rotation", 0.0))
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        scale = np.asarray(given.get("scale", (1.0, 1.0)), float).reshape(2)
        offset = np.asarray(given.get("offset", (0.0, 0.0)), float).reshape(2)
        return given.get("texCoord", coordinates), np.column_stack([turn * scale, offset])

    def _texture(self, index, key):
        """A texture by its number; None if no picture of it can be read, which is noted."""
        document = self.document
        block = document.get("textures", index)
        webp = document.extension(block, "EXT_texture_webp")
        source = block.get("source") if webp is None else webp.get("source")
        if source is None:
            self.ignored[f"the texture of {key}, which is of an extension"] = None
            return None
        sampler = {} if block.get("sampler") is None else document.get("samplers", block["sampler"])
        wrap = tuple(WRAPPING.get(sampler.get(name, 10497), "repeat") for name in ("wrapS", "wrapT"))
        if sampler.get("magFilter") == NEAREST:
            self.ignored["sharp texels (magFilter NEAREST), which are blended"] = None
        image = document.get("images", source)
        name = f"images.{source}" + (f" ({image['name']})" if image.get("name") else "")
        if image.get("bufferView") is not None:
            return Texture(bytes(document.view(image["bufferView"])), name, wrap)
        uri = image.get("uri")
        path = document.beside(uri) if isinstance(uri, str) else None
        return Texture(path or document.bytes_of(uri, f"images.{source}.uri"), name, wrap)


def _is_metal(block):
    """Return whether a material is mostly metal; the factor's default is 1, and careless files leave it out."""
    stated = "metallicFactor" in block or block.get("metallicRoughnessTexture") is not None
    return stated and float(block.get("metallicFactor", 1.0)) > 0.5
