"""The parts of a world as plain arrays: what mesh loading, terrain and assets make, and the device scene uploads."""

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np

from varos_warp.scene.description.placed import Stop
from varos_warp.scene.description.world import Material
from varos_warp.scene.spectra.spectrum import GRID


@dataclass(frozen=True)
class Page:
    """A texture of a mesh file, as one of its materials uses it."""

    texels: np.ndarray
    """uint8 [H, W, 3]: sRGB, rows from the top."""
    factor: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Linear reflectance that multiplies the image."""
    wrap: tuple[str, str] = ("repeat", "repeat")
    """Wrapping outside of 0..1 along u and along v: repeat, clamp or mirror."""
    alpha: np.ndarray | None = None
    """uint8 [h, w], rows from the top: alpha of a mask; None: there are no holes."""
    cutoff: float = 0.0
    """Alpha, as a share of 255, below which there are holes."""

    @property
    def masks(self) -> bool:
        """True if it cuts holes."""
        return self.alpha is not None

    def shown(self) -> np.ndarray | None:
        """Which of the texels the mask leaves, bool [H, W]; None without a mask."""
        if self.alpha is None:
            return None
        rows, cols = (
            (np.arange(new) + 0.5) * old / new for new, old in zip(self.texels.shape[:2], self.alpha.shape, strict=True)
        )
        return self.alpha[np.ix_(rows.astype(int), cols.astype(int))] >= 255.0 * self.cutoff


@dataclass(frozen=True)
class FaceSpectra:
    """Reflectances of faces by wavelength, as measured, which are not made of the colours that stand for them."""

    of_face: np.ndarray
    """int32 [F]: which of the curves each face has."""
    curves: np.ndarray
    """float64 [N, 301]: reflectances on `spectra.spectrum.GRID`."""

    def at(self, wavelength_nm: np.ndarray) -> np.ndarray:
        """Reflectances of the faces at wavelengths [n], float64 [F, n]."""
        return np.array([np.interp(wavelength_nm, GRID, curve) for curve in self.curves])[self.of_face]


@dataclass(frozen=True)
class Skin:
    """Colours that a mesh file brings along: textures with their coordinates, and colours of the corners."""

    corners: np.ndarray
    """float32 [F, 3, 2]: u, v (v up) of the one page; or [F, 3, 3]: linear reflectances, and u, v, 0 where there is a
    page."""
    pages: tuple[Page, ...] = ()
    """The textures; none with colours alone."""
    page: np.ndarray | None = None
    """int32 [F]: the page of each face, -1 where it has colours. None: the one page, or colours if there is none."""
    tints: np.ndarray | None = None
    """float32 [F, 3, 4]: linear colours of the corners that multiply the texture, and alpha. None: there are none."""
    cut: np.ndarray | None = None
    """bool [F]: the faces where a mask may cut holes. None: there are none."""
    spectra: FaceSpectra | None = None
    """What the faces reflect in water by wavelength. None: spectra are made of the colours."""

    @property
    def has_holes(self) -> bool:
        """True if masks cut holes."""
        return self.cut is not None and bool(self.cut.any())

    def repeated(self, count: int) -> "Skin":
        """The skin of so many copies, one after another."""
        return self._with(lambda values: np.concatenate([values] * count))

    def of_faces(self, chosen: np.ndarray) -> "Skin":
        """The skin of some of the faces, by their numbers or bool [F]."""
        return self._with(lambda values: values[chosen])

    def _with(self, of: Callable[[np.ndarray], np.ndarray]) -> "Skin":
        """The skin with other faces, given what becomes of an array that has a row for each."""
        rows = {name: getattr(self, name) for name in ("corners", "page", "tints", "cut")}
        spectra = self.spectra and replace(self.spectra, of_face=of(self.spectra.of_face))
        return replace(self, **{name: of(own) for name, own in rows.items() if own is not None}, spectra=spectra)


@dataclass(frozen=True)
class MeshFacts:
    """What became of a mesh file, for `varos-warp info`."""

    file: Path
    up_axis: str
    up_is_guess: bool
    """True if neither the file nor the scene says which way is up."""
    unit_m: float
    triangles: int
    """Number of triangles in the file, with all copies of its nodes."""
    lost: int
    """Number of the file's triangles without area, which are left out."""
    area_m2: float
    """Area of all faces in the file [m^2], before equal vertices are merged."""
    area_lost: float
    """Share of the area that is not built."""
    textures: dict[str, float]
    """Its textures, and the share of the triangles with each whose coordinates reach outside of 0..1."""
    constant: tuple[str, ...] = ()
    """Its textures that are one colour throughout."""


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
    """Largest angle between the faces of an edge that is smoothed [rad]."""
    smooth_shading: bool = False
    """True if A and B are lit with the smoothed normals."""
    skin: Skin | None = None
    """What the file says of the surface; None where the scene names a material."""
    normals: np.ndarray | None = None
    """float [F, 3, 3]: smoothed normals of the corners, of some of a shape's faces; None: its faces tell them."""
    files: tuple[MeshFacts, ...] = ()
    """What became of the mesh files that it is made from."""
    survey: dict | None = None
    """Facts of the survey that it was made from (geometry/survey/read.py); None: of none."""
    relief: dict | None = None
    """What its relief took, as plain types (geometry/relief/apply.py); None: it has none."""
    before: Self | None = None
    """The shape before its relief, which courses keep clear of; None: it has none."""
    doubts: tuple[str, ...] = ()
    """What looked wrong when it was made, a sentence each."""

    @property
    def has_holes(self) -> bool:
        """True if masks of its mesh file cut holes."""
        return self.skin is not None and self.skin.has_holes

    @property
    def whole_faces(self) -> int:
        """How many of its faces no mask cuts."""
        return len(self.faces) - (np.count_nonzero(self.skin.cut) if self.has_holes else 0)

    def whole_first(self) -> Self:
        """Return the shape with the faces that masks may cut behind all others."""
        if not self.has_holes:
            return self
        order = np.argsort(self.skin.cut, kind="stable")
        return replace(self, faces=self.faces[order], skin=self.skin.of_faces(order))

    def divided(self, normals: np.ndarray) -> list[Self]:
        """What is whole of a shape and what masks may cut, two shapes; given its normals [F, 3, 3]."""
        return [
            replace(self, faces=self.faces[some], skin=self.skin.of_faces(some), normals=normals[some])
            for some in (~self.skin.cut, self.skin.cut)
            if some.any()
        ]


@dataclass(frozen=True)
class Part(Shape):
    """A terrain or an object, in world coordinates."""

    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The object's position [m]; seeds its procedural material."""

    @property
    def first_name(self) -> str:
        """Its name, as if it were the first of copies."""
        return self.name

    def boxes(self) -> list["Part"]:
        """The part itself, as what encloses it."""
        return [self]

    def extents(self) -> np.ndarray:
        """Least and greatest coordinates, float64 [1, 2, 3]."""
        return self._box[None]

    @cached_property
    def _box(self):
        box = np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])
        box.flags.writeable = False  # all who ask get the same
        return box


@dataclass(frozen=True, kw_only=True)
class Moving(Part):
    """An object that moves along a path, or the body of a vehicle; its vertices are where it begins."""

    path: tuple[Stop, ...] = ()
    """Stops of the path, by which its poses are known (sim/poses.py); none of a body, which is where its vehicle is."""
    R_w_o: np.ndarray
    """float64 [3, 3]: its attitude where it begins; its place there is ``origin``."""

    @classmethod
    def of(cls, part: Part, R_w_o: np.ndarray, path: tuple[Stop, ...] = ()) -> Self:
        """A part that stands where it begins, as one that moves."""
        return cls(**{entry.name: getattr(part, entry.name) for entry in fields(part)}, R_w_o=R_w_o, path=path)


@dataclass(frozen=True)
class Instances(Shape):
    """One mesh, in the axes of a prototype o, that stands in many places: what a block of ``scatter`` makes."""

    T_w_o: np.ndarray
    """float64 [N, 4, 4]: poses of the copies in the world, their uniform scale folded in."""
    numbers_in_block: np.ndarray | None = None
    """Numbers of the copies, int [N]: those of the same block's other prototypes have other numbers. None: from 0."""

    def __len__(self):
        return len(self.T_w_o)

    @property
    def numbers(self) -> np.ndarray:
        """Numbers of the copies within their block, int [N]."""
        return np.arange(len(self)) if self.numbers_in_block is None else self.numbers_in_block

    @property
    def first_name(self) -> str:
        """Name of the first of the copies, which no other part or group has."""
        return f"{self.name}.{self.numbers[0]}"

    def some(self, chosen: np.ndarray | slice) -> Self:
        """Some of the copies, by their places in ``T_w_o`` or bool [N]."""
        return replace(self, T_w_o=self.T_w_o[chosen], numbers_in_block=self.numbers[chosen])

    @property
    def scale(self) -> np.ndarray:
        """How many times the prototype's size each copy is [N]."""
        return np.cbrt(np.linalg.det(self.T_w_o[:, :3, :3]))

    @property
    def names(self) -> list[str]:
        """Name of every copy, such as ``scatter.0.17``."""
        return [f"{self.name}.{i}" for i in self.numbers]

    def parts(self) -> list[Part]:
        """Every copy as a part, with its position as the seed of its material."""
        return [
            Part(
                name,
                self.vertices @ T[:3, :3].T + T[:3, 3],
                self.faces,
                self.material,
                tuple(T[:3, 3].tolist()),
                smooth_angle=self.smooth_angle,
                smooth_shading=self.smooth_shading,
                skin=self.skin,
            )
            for name, T in zip(self.names, self.T_w_o, strict=True)
        ]

    def joined(self) -> Part:
        """All copies as one part, the faces of one after those of another."""
        skin = None if self.skin is None else self.skin.repeated(len(self))
        starts = np.int32(len(self.vertices)) * np.arange(len(self), dtype=np.int32)
        return Part(
            self.name,
            self._placed(self.vertices).reshape(-1, 3),
            (self.faces[None] + starts[:, None, None]).reshape(-1, 3),
            self.material,
            smooth_angle=self.smooth_angle,
            smooth_shading=self.smooth_shading,
            skin=skin,
        )

    def boxes(self) -> list[Part]:
        """Every copy as the corners of its bounding box, turned with it, without faces."""
        return replace(self, vertices=self._corners(), faces=np.zeros((0, 3), np.int32)).parts()

    def extents(self) -> np.ndarray:
        """Least and greatest coordinates of every copy's box, turned with it, float64 [N, 2, 3]."""
        corners = self._placed(self._corners())
        return np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1)

    def _placed(self, points: np.ndarray) -> np.ndarray:
        """Points [M, 3] of the prototype where every copy has them [N, M, 3]."""
        return points @ self.T_w_o[:, :3, :3].swapaxes(1, 2) + self.T_w_o[:, None, :3, 3]

    def _corners(self) -> np.ndarray:
        """Corners [8, 3] [m] of the prototype's bounding box."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


@dataclass(frozen=True, kw_only=True)
class Grown(Instances):
    """Copies of one shape and tint that grow on other parts: what a block of ``growth`` makes."""

    hosts: tuple[str, ...]
    """Names of what they grow on: of parts, and of copies of a scatter."""
    host: np.ndarray
    """int32 [N]: which of ``hosts`` carries each copy."""
    facts: dict = field(default_factory=dict)
    """Facts of the whole block, for `varos-warp info`; only its first shape has them."""

    def some(self, chosen: np.ndarray | slice) -> Self:
        """Some of the copies, with their hosts."""
        return replace(super().some(chosen), host=self.host[chosen])
