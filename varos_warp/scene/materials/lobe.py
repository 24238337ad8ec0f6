"""What the lobe of a white metal reflects when microfacets reflect once: the table that kernels/world/bsdf.py reads."""

from functools import cache

import numpy as np

from varos_warp.cache import cached, code_hash
from varos_warp.scene.description.world import Material, Metal, Rust

SIZE = 32
"""Rows and columns: roughness and root of the cosine of the viewer, both evenly over 0..1."""
SAMPLES = 96
"""Nodes of the quadrature along each of the two random numbers of sample_lobe."""


def has_lobe(material: Material) -> bool:
    """Return whether a material shows bare metal."""
    return isinstance(material, Metal) or (isinstance(material, Rust) and material.roughness is not None)


@cache
def lobe_albedo_table() -> np.ndarray:
    """Directional albedo E(roughness, cosine) of a GGX lobe with Fresnel term 1, float32 [SIZE, SIZE].

    The mean of G2/G1 over visible normals (Heitz 2018, equation (19)) where the mirrored direction is above the
    surface, by the midpoint rule. Between its entries a bilinear E is off by at most 0.005, 0.0006 in root mean square.
    """
    return cached("lobe", {"code": code_hash(__name__, (__name__,))}, lambda: {"albedo": _table()})["albedo"]


def _table():
    r, angle = np.meshgrid(
        np.sqrt((np.arange(SAMPLES) + 0.5) / SAMPLES), 2 * np.pi * (np.arange(SAMPLES) + 0.5) / SAMPLES, indexing="ij"
    )
    disk = r * np.cos(angle), r * np.sin(angle)
    steps = np.linspace(0.0, 1.0, SIZE)
    rows = [[_albedo(max(roughness**2, 0.01), max(root**2, 1e-3), *disk) for root in steps] for roughness in steps]
    return np.array(rows, np.float32)


def _albedo(alpha: float, cosine: float, p1: np.ndarray, p2: np.ndarray) -> float:
    """One entry; v lies in the xz plane, p1 and p2 are points of the unit disk."""
    v = np.array([np.sqrt(1.0 - cosine**2), 0.0, cosine])
    stretched = np.array([alpha * v[0], 0.0, v[2]])
    stretched /= np.linalg.norm(stretched)
    t1, half = np.array([0.0, 1.0, 0.0]), 0.5 * (1.0 + stretched[2])
    t2 = np.cross(stretched, t1)
    p2 = (1.0 - half) * np.sqrt(1.0 - p1**2) + half * p2
    up = np.sqrt(np.maximum(1.0 - p1**2 - p2**2, 0.0))
    m = p1[..., None] * t1 + p2[..., None] * t2 + up[..., None] * stretched
    h = m * [alpha, alpha, 1.0]
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    cos_l = 2.0 * (h @ v) * h[..., 2] - cosine
    weight = (1.0 + _lambda(cosine, alpha)) / (1.0 + _lambda(cosine, alpha) + _lambda(np.maximum(cos_l, 1e-9), alpha))
    return float(np.where(cos_l > 0.0, weight, 0.0).mean())


def _lambda(cosine, alpha):
    """Smith's function for GGX (Heitz 2014, equation (72))."""
    return 0.5 * (np.sqrt(1.0 + alpha**2 * (1.0 - cosine**2) / cosine**2) - 1.0)
