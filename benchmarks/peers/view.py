"""One view of a scene in plain arrays, as the processes of other renderers are given it.

They import this without the package's scenes, which would take each of them more than a second.
"""

from dataclasses import dataclass

import numpy as np

HENYEY_GREENSTEIN, FOURNIER_FORAND, RAYLEIGH = "henyey_greenstein", "fournier_forand", "rayleigh"
"""Kinds of phase functions."""


def soft_edge(cosine, half_angle: float, blend: float):
    """Share of a spot's intensity at an angle to its axis: smoothstep over a share of its cone, as in Blender."""
    size = np.cos(half_angle)
    if blend == 0.0:
        return cosine >= size
    x = np.clip((cosine - size) / (blend * (1.0 - size)), 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


@dataclass(frozen=True)
class Lobe:
    """One phase function of a sum."""

    weight: float
    """Share of the scattering; the weights of a sum add up to 1."""
    kind: str
    g: float = 0.0
    """Asymmetry of ``henyey_greenstein``."""
    n: float = 0.0
    """Index of ``fournier_forand``, relative to the water."""
    backscatter: float = 0.0
    """B = b_b/b of ``fournier_forand``."""


@dataclass(frozen=True)
class PlainMesh:
    """Triangles of one reflectance per channel."""

    name: str
    vertices: np.ndarray
    """float64 [V, 3] [m]."""
    faces: np.ndarray
    """int32 [F, 3], counter-clockwise seen from outside."""
    reflectance: tuple[float, float, float]
    normals: np.ndarray | None = None
    """Float64 [F, 3, 3] of the corners; None: flat."""

    def corners(self) -> "PlainMesh":
        """Return the mesh with three vertices for each face, for formats with one normal per vertex."""
        faces = np.arange(self.faces.size, dtype=np.int32).reshape(-1, 3)
        return PlainMesh(self.name, self.vertices[self.faces].reshape(-1, 3), faces, self.reflectance, self.normals)


@dataclass(frozen=True)
class PlainLight:
    """A point light with a cone; ``half_angle`` [rad] is pi for one that shines everywhere."""

    position: np.ndarray
    axis: np.ndarray
    half_angle: float
    blend: float
    """Share of the cone's 1 - cos(half_angle) over which it fades (smoothstep in the cosine); 0 is a hard edge."""
    intensity: np.ndarray
    """Radiant intensity on the axis [W/sr], [3]."""


@dataclass(frozen=True)
class PlainScene:
    """What one camera sees from one pose. Lengths in metres, world axes, relative to ``origin``."""

    origin: np.ndarray
    """Float64 [3]: whole metres near the camera, subtracted from everything."""
    meshes: list[PlainMesh]
    lights: list[PlainLight]
    sigma_s: np.ndarray
    sigma_a: np.ndarray
    lobes: tuple[Lobe, ...]
    """The phase function of the water, as a sum."""
    T_w_c: np.ndarray
    """Pose of the camera, OpenCV axes (x right, y down, z forward)."""
    resolution: tuple[int, int]
    """Width, height."""
    focal: tuple[float, float]
    """fx, fy [pixels]; the principal point is the middle of the image."""
    aperture: float
    """Radius of the lens [m]; 0 is a pinhole."""
    focus: float
    """Distance of the plane in focus [m]."""
    max_events: int | None
    """Most scatterings and reflections together on a path; None: no bound."""

    @property
    def sigma_t(self) -> np.ndarray:
        """Extinction [1/m]."""
        return self.sigma_s + self.sigma_a
