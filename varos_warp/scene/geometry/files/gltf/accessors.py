"""Accessors of glTF as arrays: strided, sparse, normalised (section 3.6.2), and those that Draco has compressed."""

from typing import Any

import numpy as np

from varos_warp.errors import InputError, optional, refused_as
from varos_warp.scene.geometry.files.gltf.document import Document
from varos_warp.scene.geometry.files.pieces import damaged

TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4", 5130: "<f8"}
"""Types of components by their codes; 5130 is that of KHR_accessor_float64."""
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
MOST_ROWS = 2**31
MOST_ZEROS = 2**24
"""Most numbers of an accessor without bytes, which no size of a file bounds."""


def read_accessor(document: Document, index: Any) -> np.ndarray:
    """An accessor as it is stored, [count] of scalars, [count, width] of vectors; matrices are columns of rows.

    Raises:
        InputError: It reaches past its bytes, or is of a kind that glTF does not have.
    """
    block, key = document.get("accessors", index), f"accessors.{index}"
    kind, width = TYPES.get(block.get("componentType")), WIDTHS.get(block.get("type"))
    count = block.get("count")
    if kind is None or width is None or not isinstance(count, int) or not 0 <= count < MOST_ROWS:
        raise damaged("has a componentType, type or count that glTF does not have", key)
    if block.get("bufferView") is None:
        rows = _zeros(count, width, kind, key)
    else:
        rows = _rows(document, block["bufferView"], block.get("byteOffset", 0), count, width, kind, key)
    if block.get("sparse") is not None:
        rows = _with_sparse(document, block["sparse"], rows, kind, key)
    return rows[:, 0] if width == 1 else rows


def read_numbers(document: Document, index: Any) -> np.ndarray:
    """An accessor as real numbers, float64: integers that are ``normalized`` become 0..1, or -1..1."""
    values = read_accessor(document, index)
    normalized = document.get("accessors", index).get("normalized", False)
    return as_numbers(values, normalized)


def as_numbers(values: np.ndarray, normalized: bool) -> np.ndarray:
    """Stored values as float64 (section 3.6.2.2)."""
    if not normalized or values.dtype.kind == "f":
        return values.astype(np.float64)
    top = np.iinfo(values.dtype).max
    return np.maximum(values.astype(np.float64) / top, -1.0)


def _zeros(count, width, kind, key):
    """Zeros, which sparse values replace; there is no file whose size bounds their number."""
    if count * width > MOST_ZEROS:
        raise InputError(
            f"has {count} elements without bytes of their own, more than a file may ask for",
            key=key,
            remedy="Export it without sparse accessors.",
        )
    return np.zeros((count, width), kind)


def _rows(document, view, offset, count, width, kind, key):
    """Rows [count, width] of a buffer view from a byte on."""
    data, dtype = document.view(view), np.dtype(kind)
    stride = document.get("bufferViews", view).get("byteStride") or width * dtype.itemsize
    if not all(isinstance(n, int) and n >= 0 for n in (offset, stride)):
        raise damaged("has a byteOffset or byteStride that is no number of bytes", key)
    if count and offset + (count - 1) * stride + width * dtype.itemsize > len(data):
        raise damaged(f"ends after its buffer view of {len(data)} bytes", key)
    return np.ndarray((count, width), dtype, data if count else b"", offset if count else 0, (stride, dtype.itemsize))


def _with_sparse(document, sparse, rows, kind, key):
    """A copy of the rows, in which those that ``sparse`` names are replaced."""
    count, where, values = sparse["count"], sparse["indices"], sparse["values"]
    if not isinstance(count, int) or not 0 <= count <= len(rows):
        raise damaged("has more sparse values than elements", key)
    at = _rows(document, where["bufferView"], where.get("byteOffset", 0), count, 1, TYPES[where["componentType"]], key)
    new = _rows(document, values["bufferView"], values.get("byteOffset", 0), count, rows.shape[1], kind, key)
    if count and at.max() >= len(rows):
        raise damaged(f"has a sparse value for element {at.max()} of {len(rows)}", key)
    rows = rows.copy()
    rows[at[:, 0]] = new
    return rows


# --------------------------------------------------------------------------------------------------------------- Draco


class DracoPrimitive:
    """The mesh that Draco has compressed for one primitive (KHR_draco_mesh_compression).

    Raises:
        InputError: DracoPy is not installed, or cannot decode it.
    """

    def __init__(self, document: Document, extension: dict):
        draco = optional(
            "DracoPy",
            "the mesh is compressed by Draco, and DracoPy, which decodes that,",
            "draco",
            ", or export it without compression",
            key="KHR_draco_mesh_compression",
        )
        name = "KHR_draco_mesh_compression"
        with refused_as(lambda error: damaged(f"Draco cannot decode it: {error}", name)):
            self.mesh = draco.decode(bytes(document.view(extension.get("bufferView"))))
        self.ids = extension.get("attributes") or {}

    @property
    def indices(self) -> np.ndarray:
        """Vertices of the triangles int64 [3 F]."""
        return np.asarray(self.mesh.faces, np.int64).ravel()

    def attribute(self, name: str) -> np.ndarray | None:
        """Stored values of an attribute, [count, width]; None if Draco has not compressed it."""
        if name not in self.ids:
            return None
        found = self.mesh.get_attribute_by_unique_id(self.ids[name])
        return None if found is None else np.asarray(found["data"])
