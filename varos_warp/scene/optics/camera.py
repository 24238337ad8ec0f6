"""A camera in the water: from image points to rays, and from points back to image points."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from varos_warp.errors import InputError
from varos_warp.scene.frames import intrinsics
from varos_warp.scene.optics.distortion import Lens, lens_of
from varos_warp.scene.optics.ports import DomePort, FlatPort, Port
from varos_warp.scene.optics.seawater import CHANNELS_NM, SEA, seawater_index

CHANNELS = ("red", "green", "blue")
"""Channels, each of which may have an index of its own; geometry (C, D, S, T) follows green."""
GREEN = 1


def channel_number(name: str) -> int:
    """Place of a channel among `CHANNELS`.

    Raises:
        InputError: If there is no such channel.
    """
    if name not in CHANNELS:
        raise InputError("no such channel", key="channel", value=name, remedy=f"There are: {', '.join(CHANNELS)}.")
    return CHANNELS.index(name)


PINHOLE = Lens()
BORDER, BAND = 65, 64
"""Places along each side of an image at which a lens is asked whether it ends, and rows that are looked at at once."""
TRIED_PX = 4
"""Distance of the rows and columns on which the inverse in float32 is tried; on the border, that of the places is 1."""


@dataclass(frozen=True)
class Vignetting:
    """Fall of the light towards the corners: cos^4 of the angle to the axis at the lens, or a polynomial."""

    kind: str = "cos4"
    """Law of the fall: cos4 or polynomial."""
    coefficients: tuple[float, ...] = ()
    """Numbers a of 1 + a1 r^2 + a2 r^4 + ..., r from the principal point in half diagonals of the image."""

    def polynomial(self, r2: np.ndarray) -> np.ndarray:
        """Values [...] of the polynomial, which may be below 0, at the squares of r."""
        return np.ones_like(r2) + sum(a * r2 ** (i + 1) for i, a in enumerate(self.coefficients))


class Rays(NamedTuple):
    """Rays in the water; NaN and weight 0 where none is seen."""

    origin: np.ndarray
    """Points [..., 3] [m] on the port's outer surface, or the lens."""
    direction: np.ndarray
    """Unit vectors [..., 3] along the rays."""
    weight: np.ndarray
    """Radiance at the sensor over that in the water [...]: transmittance / n^2 behind a port; and vignetting."""

    def moved(self, T: np.ndarray) -> "Rays":
        """Return the same rays in the axes to which T [4, 4] maps."""
        return Rays(self.origin @ T[:3, :3].T + T[:3, 3], self.direction @ T[:3, :3].T, self.weight)


class LensEnd(NamedTuple):
    """The place where a lens ends within an image."""

    pixels: int
    """Pixels whose centres see nothing for it, whatever a port hides."""
    share: float
    """Share of all pixels that these are."""
    radius_px: float
    """Distance from the principal point to the nearest place of the lens's edge [pixels]."""
    half_angle: float
    """Half angle of the cone that the lens sees, in air if there is a port [rad]."""


@dataclass(frozen=True)
class CameraModel:
    """Camera axes (x right, y down, z forward), origin at the lens; the centre of the first pixel is (0.5, 0.5)."""

    K: np.ndarray
    """Intrinsics [3, 3] [pixels]."""
    lens: Lens = PINHOLE
    port: Port | None = None
    n_water: tuple[float, float, float] = (SEA, SEA, SEA)
    """Refractive index of the water behind the port, for R, G and B."""
    vignetting: Vignetting | None = None
    size: tuple[int, int] | None = None
    """Width and height of the image [pixels]; None: K is that of its middle."""

    @property
    def is_pinhole(self) -> bool:
        """True if there is neither port nor distortion, so that K says it all."""
        return self.port is None and self.lens.model == "none"

    @property
    def axis_weight(self) -> float:
        """Radiance at the sensor over that in the water, in the middle of the image; 1 where the water is not seen."""
        return float(self.rays(self.K[:2, 2]).weight) or 1.0

    @property
    def pixel_angle(self) -> float:
        """Angle [rad] in the water between the rays of two pixels side by side in the middle of the image."""
        if self.is_pinhole:
            return float(1.0 / self.K[0, 0])
        d = self.rays(self.K[:2, 2] + [[-0.5, 0.0], [0.5, 0.0]]).direction
        return float(np.linalg.norm(np.cross(*d)))

    def field_of_view(self, width: int, height: int) -> np.ndarray:
        """Angles [2] [rad] across and down an image, through its principal point, between the outermost rays seen.

        Through the edge nearest to the principal point where that lies outside; 0 if nothing is seen there.
        """
        size, angles = np.array([width, height]), []
        through, along = np.clip(self.K[:2, 2], 0.0, size), np.linspace(-1.0, 1.0, 1025)
        for axis in range(2):
            points = np.tile(through, (len(along), 1))
            points[:, axis] = size[axis] / 2 + along * (size[axis] / 2)
            d = self.rays(points).direction
            angle = np.copysign(np.arctan2(np.hypot(d[:, 0], d[:, 1]), d[:, 2]), points[:, axis] - self.K[axis, 2])
            angle = angle[np.isfinite(angle)]
            angles.append(angle[-1] - angle[0] if len(angle) else 0.0)
        return np.array(angles)

    def lens_ends_within(self, width: int, height: int) -> bool:
        """Return whether its lens ends within an image, of which a part then sees nothing: if so, at its border."""
        across, down = (np.linspace(0.0, side, BORDER) for side in (width, height))
        sides = [
            np.stack(np.broadcast_arrays(x, y), -1)
            for x, y in ((across, 0.0), (across, float(height)), (0.0, down), (float(width), down))
        ]
        return self.lens.model != "none" and not np.isfinite(self.directions(np.concatenate(sides))).all()

    def lens_settles(self, width: int, height: int, halvings: int, steps: int) -> bool:
        """Return whether kernels find in float32 what its lens sees all over an image, by a fixed number of steps."""
        if self.lens.is_closed_form:
            return True
        inner = np.meshgrid(np.arange(0, width, TRIED_PX), np.arange(0, height, TRIED_PX))
        along, down = np.arange(width + 1), np.arange(height + 1)
        sides = [np.broadcast_arrays(*side) for side in ((along, 0), (along, height), (0, down), (width, down))]
        points = np.concatenate([np.stack([x.ravel(), y.ravel()], -1) for x, y in (inner, *sides)])
        f, c = self.K[[0, 1], [0, 1]], self.K[:2, 2]
        return self.lens.settles((points - c) / f, self.lens_reach(width, height), halvings, steps)

    def lens_reach(self, width: int, height: int) -> float:
        """Tangent or angle of the axis that no point of an image exceeds; see `Lens.reach`."""
        return self.lens.reach((np.array([[0.0, 0.0], [width, height]]) - self.K[:2, 2]) / self.K[[0, 1], [0, 1]])

    def lens_end(self, width: int, height: int) -> LensEnd | None:
        """The place where its lens ends within an image; None if it does not."""
        if not self.lens_ends_within(width, height):
            return None
        edge = self.lens.edge(np.linspace(0.0, 2.0 * np.pi, 721))
        away, unseen = np.hypot(edge[:, 0], edge[:, 1]), 0
        inner, outer = (1.0 - 1e-4) * away.min(), (1.0 + 1e-4) * away.max()  # between azimuths, a little more
        f, c = self.K[[0, 1], [0, 1]], self.K[:2, 2]
        for row in range(0, height, BAND):  # which bounds the memory
            at = (pixel_centres(width, min(BAND, height - row)) + [0.0, row] - c) / f
            r = np.hypot(at[..., 0], at[..., 1])
            near = (r >= inner) & (r <= outer)
            unseen += int((r > outer).sum() + np.isnan(self.lens.directions(at[near])[:, 0]).sum())
        return LensEnd(unseen, unseen / (width * height), float(np.hypot(*(edge * f).T).min()), self.lens.half_angle)

    def directions(self, points: np.ndarray) -> np.ndarray:
        """Unit vectors [..., 3] in front of the lens, in air if there is a port, of image points [..., 2]."""
        x, y = ((points[..., i] - self.K[i, 2]) / self.K[i, i] for i in range(2))
        return self.lens.directions(np.stack([x, y], -1))

    def vignette(self, points: np.ndarray) -> np.ndarray:
        """Share [...] of the light at image points [..., 2] that vignetting leaves."""
        x, y = (points[..., i] - self.K[i, 2] for i in range(2))
        if self.vignetting is None:
            return np.ones(x.shape)
        if self.vignetting.kind == "polynomial":
            half = self.K[:2, 2] if self.size is None else 0.5 * np.array(self.size)
            return np.maximum(self.vignetting.polynomial((x**2 + y**2) / (half[1] ** 2 + half[0] ** 2)), 0.0)
        if self.lens.model == "none":
            return 1.0 / (1.0 + (x / self.K[0, 0]) ** 2 + (y / self.K[1, 1]) ** 2) ** 2
        return np.fmax(self.directions(points)[..., 2], 0.0) ** 4  # 0 where nothing is seen

    def rays(self, points: np.ndarray, channel: int = GREEN) -> Rays:
        """Rays of image points [..., 2] [pixels] for one of R, G, B."""
        points = np.asarray(points, float)
        rays = self._rays(points, channel)
        return rays if self.vignetting is None else rays._replace(weight=rays.weight * self.vignette(points))

    def _rays(self, points: np.ndarray, channel: int) -> Rays:
        d = self.directions(points)
        if self.port is None:
            seen = np.isfinite(d).all(-1)
            return Rays(np.where(seen[..., None], 0.0, np.nan) * d, d, seen.astype(float))
        n = self.n_water[channel]
        ray = self.port.leave(np.zeros(3), d, n)
        return Rays(ray.origin, ray.direction, ray.transmittance / n**2)

    def project(self, points: np.ndarray, channel: int = GREEN) -> np.ndarray:
        """Image points [..., 2] [pixels] of points [..., 3] [m]; NaN where the camera cannot see them."""
        points = np.asarray(points, float)
        d, n = points, self.n_water[channel]
        if self.port is not None:
            d = self.port.arrive(points, n)
            if self.port.has_rim:
                d = np.where(self.port.leave(np.zeros(3), d, n).transmittance[..., None] > 0.0, d, np.nan)
        return self.lens.image_plane(d) * self.K[[0, 1], [0, 1]] + self.K[:2, 2]


def water_indices(n_water: Any, wavelength_nm: Sequence[float] = CHANNELS_NM) -> tuple[float, ...]:
    """Indices at wavelengths, or for R, G, B, of a scene's ``n_water``.

    Args:
        n_water: None, a number, three, or a block of temperature and salinity. Three are linear between the wavelengths
            of R, G, B, and beyond these what they are there.
        wavelength_nm: Where they are wanted.
    """
    if hasattr(n_water, "salinity"):
        return tuple(float(seawater_index(n_water.temperature_C, n_water.salinity, nm)) for nm in wavelength_nm)
    of_channels = np.broadcast_to(SEA if n_water is None else n_water, 3)
    return (*np.interp(wavelength_nm, CHANNELS_NM[::-1], of_channels[::-1]).tolist(),)


def camera_model(camera: Any) -> CameraModel:
    """The model of a scene's camera block."""
    lens = PINHOLE if camera.distortion is None else lens_of(**camera.distortion.model_dump())
    port = None if camera.port is None else port_model(**camera.port.model_dump())
    vignetting = None if camera.vignetting is None else Vignetting(**camera.vignetting.model_dump())
    return CameraModel(intrinsics(camera), lens, port, water_indices(camera.n_water), vignetting, camera.resolution)


def described_camera(about: dict[str, Any]) -> CameraModel:
    """The model of a camera of dataset.json."""
    lens, port, fall = about.get("distortion", "none"), about.get("port"), about.get("vignetting")
    return CameraModel(
        np.array(about["K_center_half"], float),
        PINHOLE if isinstance(lens, str) else lens_of(**lens),
        port_model(**port) if port else None,
        tuple(about.get("n_water") or (SEA, SEA, SEA)),
        Vignetting(fall["kind"], tuple(fall.get("coefficients") or ())) if fall else None,
        (about["width"], about["height"]),
    )


def port_model(kind: str, **values: Any) -> Port:
    """The port of a scene's block."""
    if kind == "dome":
        return DomePort(**values | {"centre": tuple(values["centre"])})
    return FlatPort(**values | {"normal": tuple(unit(values["normal"]).tolist())})


def unit(vector: ArrayLike) -> np.ndarray:
    """A vector that is not 0, of any length that float64 holds, at unit length."""
    scaled = np.array(vector, float) / np.abs(vector).max()
    return scaled / np.linalg.norm(scaled)


def pixel_centres(width: int, height: int) -> np.ndarray:
    """Image points [height, width, 2] of the pixels' centres."""
    row, col = np.indices((height, width))
    return np.stack([col + 0.5, row + 0.5], -1)
