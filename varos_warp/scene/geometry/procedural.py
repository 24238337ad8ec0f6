"""Sea floors and relief from a seed: fractal height fields, and a bottom of sand flats with rocky outcrops."""

import numpy as np
from scipy import fft
from scipy.ndimage import map_coordinates

from varos_warp.device.devices import usable_cores
from varos_warp.scene.geometry.topology import compact

ROUGHNESS = 2.2
"""Spectral slope: the amplitude of a feature of wavenumber k falls as k to the power of minus this."""


def fractal_field(resolution: int, seed: int, cycles: float = 2.0, roughness: float = ROUGHNESS) -> np.ndarray:
    """Periodic fractal noise, float64 [resolution, resolution], zero mean and unit variance.

    Spectral synthesis (Saupe, in "The Science of Fractal Images", 1988): random phases under a power law.

    Args:
        cycles: Wavenumber, in cycles over the side, below which the spectrum stays level.
        roughness: Exponent of the power law.
    """
    rng = np.random.default_rng(seed)
    rows, cols = (frequencies(resolution) * resolution for frequencies in (fft.fftfreq, fft.rfftfreq))
    amplitude = np.maximum(np.hypot(rows[:, None], cols), cycles) ** -roughness
    amplitude[0, 0] = 0.0
    spectrum = amplitude * fft.rfft2(rng.standard_normal((resolution, resolution)), workers=usable_cores())
    field = fft.irfft2(spectrum, s=(resolution, resolution), workers=usable_cores())
    return field / max(field.std(), 1e-300)


def grid_mesh(x: np.ndarray, y: np.ndarray, z: np.ndarray, keep: np.ndarray | None = None):
    """Vertices [N, 3] and faces [F, 3] of heights z [len(y), len(x)], normals up; only where ``keep`` is true."""
    vertices = np.column_stack([g.ravel() for g in (*np.meshgrid(x, y), z)])
    number = np.arange(z.size).reshape(z.shape)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    faces = faces.astype(np.int32)
    return (vertices, faces) if keep is None else compact(vertices, faces[keep.ravel()[faces].all(axis=1)])


def sea_floor(size_m: float, resolution: int, feature_m: float, rockiness: float, seed: int) -> np.ndarray:
    """Heights in 0..1, float64 [resolution, resolution]: sand flats, and outcrops on ``rockiness`` of the area.

    Outcrops are about half of ``feature_m`` wide and broken into blocks of a quarter of it; the sand is rippled.
    """
    seeds = np.random.SeedSequence(seed).spawn(4)
    cycles = max(size_m / feature_m, 1.0)
    swell = fractal_field(resolution, seeds[0], cycles, 3.0)
    where = fractal_field(resolution, seeds[1], 1.5 * cycles, 2.6)
    blocks = fractal_field(resolution, seeds[2], 4.0 * cycles, 2.3)
    ripples = fractal_field(resolution, seeds[3], 16.0 * cycles, 2.6)
    # Rock rises over a narrow transition: steep flanks, on which `slope_blend` shows rock.
    edge = np.quantile(where, 1.0 - rockiness) if rockiness > 0.0 else np.inf
    t = np.clip((where - edge) / 0.5, 0.0, 1.0)
    rock = t * t * (3.0 - 2.0 * t)
    height = 0.25 * swell + rock * (0.9 + 0.55 * np.abs(blocks) + 0.25 * blocks) + 0.02 * (1.0 - rock) * ripples
    height -= height.min()
    return height / max(height.max(), 1e-300)


def generate_terrain(
    size_m: float = 60.0,
    resolution: int = 257,
    relief_m: float = 2.0,
    feature_m: float = 25.0,
    rockiness: float = 0.4,
    seed: int = 1,
):
    """A square sea floor around the origin, its median height 0; same seed, same terrain.

    The arguments are those of ``scene.description.world.ProceduralTerrain``.

    Returns:
        Vertices float64 [resolution^2, 3] and faces int32 [F, 3], normals up.
    """
    height = relief_m * sea_floor(size_m, resolution, feature_m, rockiness, seed)
    axis = np.linspace(-0.5 * size_m, 0.5 * size_m, resolution)
    return grid_mesh(axis, axis, height - np.median(height))


def add_detail(vertices: np.ndarray, relief_m: float, feature_m: float, rockiness: float, seed: int) -> np.ndarray:
    """Vertices [V, 3] of a terrain with the forms of ``sea_floor`` on top, their median height 0.

    They are sampled at the vertices, so the mesh must have edges as short as what is to be seen.
    """
    low, span = vertices[:, :2].min(axis=0), np.ptp(vertices[:, :2], axis=0).max()
    resolution = 1025
    field = sea_floor(span, resolution, feature_m, rockiness, seed)
    where = (vertices[:, :2] - low) / max(span, 1e-300) * (resolution - 1)
    height = relief_m * map_coordinates(field - np.median(field), where.T[::-1], order=1, mode="nearest")
    return vertices + height[:, None] * np.array([0.0, 0.0, 1.0])
