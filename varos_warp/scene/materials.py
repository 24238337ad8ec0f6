"""Materials of a scene file as the device's Material records."""

import zlib

import numpy as np
import warp as wp

from varos_warp.kernels import texture
from varos_warp.scene.description import Dirt, Rust, SlopeBlend
from varos_warp.scene.geometry import Part

_GROUND = {"sand": texture.SAND, "rock": texture.ROCK}


def position_seed(seed: int, position) -> int:
    """Seed of a procedural pattern: no two places look alike (paper 3.1.2)."""
    return zlib.crc32(np.asarray(position, np.float64).tobytes(), seed)


def device_material(part: Part, seed: int, local_origin: np.ndarray) -> texture.Material:
    """Record of a part's material; ``seed`` is the scene's, ``local_origin`` [3] that of the device's world."""
    record = texture.Material()
    record.offset = wp.vec3(*(local_origin - part.vertices.min(axis=0)))
    material = part.material
    if isinstance(material, SlopeBlend):
        extent = float(np.ptp(part.vertices[:, :2], axis=0).max())
        record.kind = int(texture.SLOPE_BLEND)
        record.seed = wp.uint32(position_seed(seed, part.origin))
        record.flat, record.steep = int(_GROUND[material.flat.texture]), int(_GROUND[material.steep.texture])
        record.flat_size = max(extent / material.flat.tiles, 1e-6)
        record.steep_size = max(extent / material.steep.tiles, 1e-6)
    elif isinstance(material, Rust):
        record.kind = int(texture.RUST)
        record.seed = wp.uint32(position_seed(seed, part.origin))
        record.base, record.amount = wp.vec3(*material.base), material.amount
    elif isinstance(material, Dirt):  # the mean of its pattern
        record.kind = int(texture.DIFFUSE)
        mean = (1.0 - material.amount) * np.array(material.base) + material.amount * np.array(material.silt)
        record.base = wp.vec3(*mean)
    else:
        record.kind = int(texture.DIFFUSE)
        record.base = wp.vec3(*material.reflectance)
    return record
