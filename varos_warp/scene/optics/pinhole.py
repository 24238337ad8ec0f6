"""The best pinhole in place of a port, and how far off it is: no more model than a scene needs.

Behind a port, where a point is seen depends on its distance in ways that no distortion of a pinhole has. How much that
is follows from the distances that a camera sees.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from varos_warp.scene.optics.camera import PINHOLE, CameraModel, camera_model
from varos_warp.scene.optics.distortion import BROWN_CONRADY, FISHEYES, KANNALA_BRANDT, Lens

ALIKE_PX = 0.05
"""Pictures that differ by less everywhere are the same."""
GRID = (33, 19)
"""Image points tried, across and down."""
DIGITS = 6
"""Significant digits of the keys of a pinhole: a thousandth of a pixel in a thousand."""


class PortWorth(NamedTuple):
    """The error of the best pinhole with distortion, for what is seen in a range of distances."""

    rms_px: float
    max_px: float
    near_m: float
    far_m: float
    colours_px: float
    """Largest distance between red and blue [px]; 0 where the water's index is one number."""
    besides: tuple[str, ...]
    """Other differences, in words."""
    pinhole: dict[str, Any] | None
    """``focal_mm`` or ``intrinsics``, and perhaps ``distortion``, of a camera without port that shows the same; None:
    there is none."""

    @property
    def in_words(self) -> str:
        """One sentence that says what the port is worth."""
        where = f"({self.near_m:.2g} to {self.far_m:.2g} m)"
        if self.pinhole:
            keys = str(self.pinhole).replace("'", "")
            return f"within {ALIKE_PX:g} px a pinhole without port shows the same {where}, with the keys {keys[1:-1]}"
        words = (
            f"a pinhole with the best distortion is off by {self.rms_px:.2g} px rms, {self.max_px:.2g} px at most "
            f"{where}"
        )
        words += f"; red and blue part by up to {self.colours_px:.2g} px" if self.colours_px else ""
        return "; ".join([words, *self.besides])


def port_worth(camera: Any, ranges: np.ndarray) -> PortWorth:
    """What the port of a scene's camera block is worth.

    Args:
        ranges: Distances [K] from the port along the rays [m], all as frequent as each other.
    """
    model, (width, height) = camera_model(camera), camera.resolution
    x, y = (np.linspace(0.5, side - 0.5, count) for side, count in zip((width, height), GRID, strict=True))
    image = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    rays = model.rays(image)
    seen = np.isfinite(rays.direction).all(-1)
    points = (rays.origin + ranges[:, None, None] * rays.direction)[:, seen]
    image = np.broadcast_to(image[seen], (*points.shape[:2], 2))
    lens = KANNALA_BRANDT if model.lens.model in FISHEYES else BROWN_CONRADY
    off = distance_px(fit_pinhole(model, image, points, lens), image, points)
    colours, keys, besides = 0.0, None, [*_besides(camera, model, seen)]
    if len(set(model.n_water)) > 1:
        colours = float(np.nanmax(np.linalg.norm(model.project(points, 0) - model.project(points, 2), axis=-1)))
    if colours < ALIKE_PX and not besides:
        free = camera.intrinsics is not None
        fits = [fit_pinhole(model, image, points, kind, centre=free) for kind in ("none", lens)]
        apart = [np.linalg.norm(fit.project(points) - image, axis=-1).max() for fit in fits]  # NaN: its lens folds
        keys = next((_keys(camera, model, fit) for fit, px in zip(fits, apart, strict=True) if px < ALIKE_PX), None)
        if keys is None and off.max() < ALIKE_PX and not free:
            besides.append(f"with its centre in the middle of the image, {np.nanmin(apart):.2g} px")
    rms = float(np.sqrt(np.square(off).mean()))
    return PortWorth(rms, float(off.max()), float(ranges.min()), float(ranges.max()), colours, tuple(besides), keys)


def _besides(camera: Any, model: CameraModel, seen: np.ndarray) -> Iterator[str]:
    """What a pinhole would not have, but for the places of points."""
    ends = model.lens_ends_within(*camera.resolution)
    if ends:
        yield "the lens ends within the image, and a fitted one would elsewhere"
    elif not seen.all():
        yield "a part of the image sees nothing through the port"
    if camera.f_stop > 0.0:
        yield "its depth of field would be another"
    if camera.vignetting is not None and camera.vignetting.kind == "cos4":
        yield "its vignetting would be another"


def fit_pinhole(
    camera: CameraModel, image: np.ndarray, points: np.ndarray, lens: str, *, centre: bool = True
) -> CameraModel:
    """The pinhole at the lens that sees points [..., 3] [m] nearest to where a camera does, by least squares.

    Its focal length and coefficients, and where ``centre`` is set its centre too, are linear in the image.

    Args:
        camera: Whose aspect, and otherwise centre, it keeps.
        image: Image points [..., 2] [pixels].
        points: In camera axes.
        lens: none, brown_conrady or kannala_brandt, the model of its distortion.
        centre: Whether its centre is free.
    """
    f, c = camera.K[[0, 1], [0, 1]], camera.K[:2, 2]
    terms = _terms(points.reshape(-1, 3), lens)
    if centre:
        terms = np.concatenate([terms, np.broadcast_to(np.eye(2), (len(terms), 2, 2))], -1)
    columns = (terms * f[:, None]).reshape(-1, terms.shape[-1])
    found = np.linalg.lstsq(columns, (image - c).reshape(-1), rcond=None)[0]
    known, moved = (found[:-2], found[-2:]) if centre else (found, np.zeros(2))
    K = camera.K.copy()
    K[[0, 1], [0, 1]], K[:2, 2] = known[0] * f, c + moved * f
    return CameraModel(K, Lens(lens, tuple((known[1:] / known[0]).tolist())) if lens != "none" else PINHOLE)


def _terms(points: np.ndarray, lens: str) -> np.ndarray:
    """What the image plane's points are sums of [N, 2, terms]: the focal length, and it times each coefficient."""
    if lens == KANNALA_BRANDT:
        beside = np.linalg.norm(points[:, :2], axis=-1, keepdims=True)
        angle = np.arctan2(beside, points[:, 2:])
        along = points[:, :2] / np.where(beside > 0.0, beside, 1.0)
        return np.stack([along * angle**power for power in (1, 3, 5, 7, 9)], -1)
    xy = points[:, :2] / points[:, 2:]
    if lens == "none":
        return xy[..., None]
    q, product = (xy**2).sum(-1, keepdims=True), 2.0 * xy.prod(-1, keepdims=True)
    squares = q + 2.0 * xy**2
    p1 = np.concatenate([product, squares[:, 1:]], -1)
    p2 = np.concatenate([squares[:, :1], product], -1)
    return np.stack([xy, xy * q, xy * q**2, p1, p2, xy * q**3], -1)


def distance_px(pinhole: CameraModel, image: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How far [...] [pixels] from image points [..., 2] a pinhole sees points [..., 3], also where its lens folds."""
    at = _terms(points.reshape(-1, 3), pinhole.lens.model) @ [1.0, *pinhole.lens.k]
    at = at * pinhole.K[[0, 1], [0, 1]] + pinhole.K[:2, 2]
    return np.linalg.norm(at.reshape(image.shape) - image, axis=-1)


def _keys(camera: Any, model: CameraModel, fit: CameraModel) -> dict[str, Any]:
    """The keys of a camera's block that make it the pinhole of a fit."""
    keys: dict[str, Any] = {"focal_mm": float(f"{camera.focal_mm * fit.K[0, 0] / model.K[0, 0]:.{DIGITS}g}")}
    if camera.intrinsics is not None:
        numbers = (*fit.K[[0, 1], [0, 1]], *(fit.K[:2, 2] - 0.5))
        names = ("fx", "fy", "cx", "cy")
        keys = {
            "intrinsics": {name: float(f"{number:.{DIGITS}g}") for name, number in zip(names, numbers, strict=True)}
        }
    if fit.lens.model != "none":
        # what is left of zeros by rounding is not written down
        k = [float(f"{round(k, 9) + 0.0:.{DIGITS}g}") for k in fit.lens.k]
        keys["distortion"] = {"model": fit.lens.model, "k": k}
    return keys
