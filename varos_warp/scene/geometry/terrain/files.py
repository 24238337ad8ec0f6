"""Terrains on disk."""

import os
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError


def write_ply(path: str | Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Write a binary PLY in double precision, aside first and then renamed (trimesh writes single precision)."""
    path = Path(path)
    header = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
              "property double x\nproperty double y\nproperty double z\n"
              f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n")
    rows = np.empty(len(faces), [("count", "u1"), ("index", "<i4", 3)])
    rows["count"], rows["index"] = 3, faces
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        aside.write_bytes(header.encode() + np.asarray(vertices, "<f8").tobytes() + rows.tobytes())
        aside.replace(path)
    except OSError as error:
        aside.unlink(missing_ok=True)
        raise InputError(f"cannot be written: {error.strerror}", file=path,
                         remedy="Choose a folder that exists, is writable and has space.") from error
