"""The parts of a world as plain arrays: what mesh loading, terrain and assets make, and the device scene uploads."""

from dataclasses import KW_ONLY, dataclass, replace

import numpy as np

from varos_warp.scene.description.world import Material, Stop


@dataclass(frozen=True)
class Skin:
    """Colours that a mesh file brings along: a texture map with its coordinates, or colours of the corners."""

    corners: np.ndarray
    """float32 [F, 3, 2]: u, v (v up; they repeat outside of 0..1); or [F, 3, 3]: linear reflectances."""
    image: np.ndarray | None = None
    """float32 [H, W, 3]: linear reflectances, rows from the top, sides powers of two; None with colours."""


@dataclass(frozen=True)
class Shape:
    """What parts and instances have."""

    name: str
    """Key in the scene file: ``terrain``, ``objects.3``, ``scatter.0``, or ``scatter.0.17`` for a copy; of a vehicle's
    body ``vehicles.ID``."""
    vertices: np.ndarray
    """float64 [V, 3] [m]."""
    faces: np.ndarray
    """int32 [F, 3], counter-clockwise seen from outside."""
    material: Material
    _: KW_ONLY
    smooth_angle: float = np.pi / 6
    """[rad]"""
    smooth_shading: bool = False
    """Whether A and B are lit with the smoothed normals."""
    skin: Skin | None = None
    """What the file says of the surface; None where the scene names a material."""
    survey: dict | None = None
    """Facts of the survey that it was made from (geometry/survey/read.py); None: of none."""
    doubts: tuple[str, ...] = ()
    """What looked wrong when it was made, a sentence each."""


@dataclass(frozen=True)
class Part(Shape):
    """A terrain or an object, in world coordinates."""

    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The object's position [m]; seeds its procedural material."""

    def boxes(self) -> list["Part"]:
        """The part itself, as what encloses it."""
        return [self]


@dataclass(frozen=True, kw_only=True)
class Moving(Part):
    """An object that moves along a path, or the body of a vehicle; its vertices are where it begins."""

    path: tuple[Stop, ...] = ()
    """All that it takes to know where it is (sim/poses.py); none of a body, which is where its vehicle is."""
    R_w_o: np.ndarray
    """float64 [3, 3]: its attitude where it begins; its place there is ``origin``."""


@dataclass(frozen=True)
class Instances(Shape):
    """One mesh, in the axes of a prototype o, that stands in many places: what a block of ``scatter`` makes."""

    T_w_o: np.ndarray
    """float64 [N, 4, 4]: poses of the copies in the world, their uniform scale folded in."""

    def __len__(self):
        return len(self.T_w_o)

    @property
    def scale(self) -> np.ndarray:
        """How many times the prototype's size each copy is [N]."""
        return np.cbrt(np.linalg.det(self.T_w_o[:, :3, :3]))

    def parts(self) -> list[Part]:
        """Every copy as a part, ``scatter.0.17``, with its position as the seed of its material."""
        return [Part(f"{self.name}.{i}", self.vertices @ T[:3, :3].T + T[:3, 3], self.faces, self.material,
                     tuple(T[:3, 3].tolist()), smooth_angle=self.smooth_angle, smooth_shading=self.smooth_shading,
                     skin=self.skin) for i, T in enumerate(self.T_w_o)]

    def boxes(self) -> list[Part]:
        """Every copy as the corners of its bounding box, turned with it, without faces."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        return replace(self, vertices=corners, faces=np.zeros((0, 3), np.int32)).parts()
