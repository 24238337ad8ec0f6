"""The JSON of a glTF file, with its chunks, extensions and the files beside it."""

import base64
import binascii
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from varos_warp.errors import InputError
from varos_warp.files import is_file
from varos_warp.scene.geometry.files.pieces import damaged, in_words

READ = {
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_draco_mesh_compression",
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_materials_unlit",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_node_visibility",
}
"""Extensions that are read."""
NO_EFFECT = {
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_emissive_strength",
    "KHR_materials_anisotropy",
    "KHR_materials_dispersion",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_interactivity",
    "KHR_animation_pointer",
    "KHR_accessor_float64",
    "EXT_mesh_manifold",
    "FB_ngon_encoding",
}
"""Extensions that change nothing of what is modelled: shape, and Lambertian colour without light of its own."""
IGNORED = {
    "EXT_meshopt_compression": "the file's own uncompressed copy is read",
    "KHR_meshopt_compression": "the file's own uncompressed copy is read",
    "KHR_texture_basisu": "the picture that stands in for it is read",
    "EXT_texture_avif": "the picture that stands in for it is read",
    "MSFT_texture_dds": "the picture that stands in for it is read",
    "KHR_lights_punctual": "the lights of the file do not shine",
    "EXT_lights_image_based": "the lights of the file do not shine",
    "KHR_materials_variants": "the first look of the surfaces is read",
    "KHR_materials_transmission": "what should let light through is opaque",
    "KHR_materials_diffuse_transmission": "what should let light through is opaque",
    "KHR_materials_volume": "what should let light through is opaque",
    "KHR_materials_clearcoat": "surfaces have no clear coat",
    "KHR_materials_sheen": "surfaces have no sheen",
    "KHR_materials_iridescence": "surfaces do not iridesce",
    "MSFT_lod": "the finest level is read",
}
"""Extensions that a file may use but not require, and what leaving them out does."""
REMEDIES = {
    "EXT_meshopt_compression": "Write it uncompressed: `gltf-transform copy in.glb out.glb`, or export it anew.",
    "KHR_meshopt_compression": "Write it uncompressed: `gltf-transform copy in.glb out.glb`, or export it anew.",
    "KHR_texture_basisu": "Write PNG or JPEG textures: `gltf-transform ktxdecompress in.glb out.glb`.",
    "EXT_texture_avif": "Write PNG or JPEG textures.",
    "MSFT_texture_dds": "Write PNG or JPEG textures.",
}
ANEW = "Export it without this extension."


class Document:
    """A glTF file.

    Raises:
        InputError: It is no glTF 2.0, or requires an extension that is not read.
    """

    def __init__(self, path: Path):
        self.path = path
        data = path.read_bytes()
        self.chunk: bytes | None = None
        if data[:4] == b"glTF":
            data, self.chunk = self._chunks(data)
        self.json = json.loads(data.decode("utf-8-sig"))
        if not isinstance(self.json, dict):
            raise damaged("is no glTF: its JSON is not an object")
        version = str(self.json.get("asset", {}).get("version", ""))
        if version.split(".", maxsplit=1)[0] != "2":
            raise InputError(
                f"is glTF {version or 'of no version'}; version 2 is read",
                key="asset.version",
                remedy="Export it as glTF 2.0.",
            )
        self._buffers: dict[int, bytes | np.memmap] = {}
        self._check_extensions()

    def _chunks(self, data: bytes) -> tuple[bytes, bytes | None]:
        """JSON and binary chunk of a GLB container."""
        if len(data) < 20:
            raise damaged("is a GLB that ends in its header")
        version, length = struct.unpack_from("<II", data, 4)
        if version != 2:
            raise InputError(f"is a GLB of version {version}; version 2 is read", remedy="Export it as glTF 2.0.")
        if length > len(data):
            raise damaged(f"is a GLB of {length} bytes, of which {len(data)} are there")
        chunks, at = {}, 12
        while at + 8 <= length:
            size, kind = struct.unpack_from("<I4s", data, at)
            if at + 8 + size > length:
                raise damaged("is a GLB with a chunk that ends after the file")
            chunks.setdefault(kind, data[at + 8 : at + 8 + size])
            at += 8 + size
        if b"JSON" not in chunks:
            raise damaged("is a GLB without JSON")
        return chunks[b"JSON"], chunks.get(b"BIN\0")

    def _check_extensions(self) -> None:
        required = self.json.get("extensionsRequired", [])
        for name in required:
            if name not in READ | NO_EFFECT:
                raise InputError(
                    "the file requires this extension, which is not read",
                    key="extensionsRequired",
                    value=name,
                    remedy=REMEDIES.get(name, ANEW),
                )

    def notes(self) -> list[str]:
        """What leaving out the extensions does that the file uses but does not require."""
        used = [name for name in self.json.get("extensionsUsed", []) if name not in READ | NO_EFFECT]
        found = [f"it uses {name}, which is not read: {IGNORED[name]}" for name in used if name in IGNORED]
        unknown = [name for name in used if name not in IGNORED]
        if unknown:
            found.append(f"it uses {in_words(unknown)}, which is not known here: it is read without")
        if self.json.get("animations"):
            found.append("its animations are not read: it stands as its nodes place it")
        return found

    def all(self, kind: str) -> list:
        """The list of one kind of objects: nodes, meshes, accessors ..."""
        found = self.json.get(kind, [])
        if not isinstance(found, list):
            raise damaged("is no list", kind)
        return found

    def get(self, kind: str, index: Any) -> dict:
        """One object of a kind by its number."""
        entries = self.all(kind)
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(entries):
            raise damaged(f"is named, but there are {len(entries)}", f"{kind}.{index}")
        if not isinstance(entries[index], dict):
            raise damaged("is no object", f"{kind}.{index}")
        return entries[index]

    def extension(self, block: dict, name: str) -> dict | None:
        """What an extension says of an object; None where it says nothing."""
        found = (block.get("extensions") or {}).get(name)
        if found is not None and not isinstance(found, dict):
            raise damaged("is no object", f"extensions.{name}")
        return found

    # ----------------------------------------------------------------------------------------------------- bytes

    def view(self, index: int) -> memoryview:
        """The bytes of a buffer view."""
        block = self.get("bufferViews", index)
        data = self._buffer(block.get("buffer"))
        start, length = int(block.get("byteOffset", 0)), int(block.get("byteLength", -1))
        if start < 0 or length < 0 or start + length > len(data):
            raise damaged(f"ends at byte {start + length} of a buffer of {len(data)}", f"bufferViews.{index}")
        return memoryview(data)[start : start + length]

    def _buffer(self, index: Any):
        if index not in self._buffers:
            uri = self.get("buffers", index).get("uri")
            if uri is None and self.chunk is None:
                raise damaged("has no bytes in this file", f"buffers.{index}")
            self._buffers[index] = self.chunk if uri is None else self.bytes_of(uri, f"buffers.{index}.uri")
        return self._buffers[index]

    def beside(self, uri: str) -> Path | None:
        """Path of a file that a URI names; None of data that the URI holds itself."""
        return None if uri.startswith("data:") else self.path.parent / unquote(uri)

    def bytes_of(self, uri: Any, key: str) -> bytes:
        """The bytes that a URI names or holds."""
        if not isinstance(uri, str):
            raise damaged("is no text", key)
        path = self.beside(uri)
        if path is not None:
            if not is_file(path):
                raise InputError(
                    f"there is no such file beside {self.path.name}: {path.name}",
                    key=key,
                    remedy="Copy it there too, or export everything into one GLB.",
                )
            return path.read_bytes()
        try:
            head, _, data = uri.partition(",")
            return base64.b64decode(data, validate=True) if head.endswith(";base64") else unquote(data).encode("latin1")
        except (binascii.Error, UnicodeEncodeError):
            raise damaged("holds data that cannot be decoded", key) from None
