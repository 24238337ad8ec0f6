"""What stands between a camera and what it sees: distortion and port, and the index of the water."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from varos_warp.scene.block import Block, Vec3, outside, unwritten_if_absent
from varos_warp.scene.optics.camera import camera_model, unit
from varos_warp.scene.optics.distortion import DOUBLE_SPHERE, FISHEYES

Index = Annotated[float, Field(ge=1.0, le=3.0)]
"""Refractive index, relative to air."""
Size = Annotated[float, Field(gt=0.0, le=100.0)]
"""A size above 0 [m]."""
Thickness = Annotated[float, Field(ge=0.0, le=100.0)]
"""A thickness, which may be 0 [m]."""
SHORTEST_S = 1e-9
"""Shortest time above 0 [s]: times are counted in nanoseconds."""
Duration = Annotated[float, Field(ge=0.0, le=60.0), outside(0.0, SHORTEST_S, "is 0 or at least 1e-9 s, a nanosecond")]
"""A duration: 0, or a nanosecond or more [s]."""


class FlatPort(Block):
    """A flat pane before the lens, with air between."""

    kind: Literal["flat"]
    distance_m: Annotated[float, Field(ge=1e-6, le=100.0)] = Field(examples=[0.02])
    """Distance from the lens (its entrance pupil) to the glass, along the normal [m]."""
    thickness_m: Thickness = 0.0
    """Thickness of the glass [m]."""
    n_glass: Index = 1.49
    """Refractive index of the glass, relative to air; 1.49 is acrylic, 1.52 glass, 1.77 sapphire."""
    normal: Vec3 = (0.0, 0.0, 1.0)
    """Normal of the pane towards the water, in camera axes (x right, y down, z forward), of any length."""
    clear_radius_m: Size | None = Field(default=None, examples=[0.05])
    """Radius of what is clear of the pane's outer face, around the place nearest to the lens [m]; what is past it is
    black. Absent: all is clear."""

    _written = unwritten_if_absent("clear_radius_m")


class DomePort(Block):
    """A spherical shell before the lens, with air between."""

    kind: Literal["dome"]
    radius_m: Size = Field(examples=[0.06])
    """Radius of the outer surface [m]."""
    thickness_m: Thickness = 0.0
    """Thickness of the shell [m]."""
    n_glass: Index = 1.49
    """Refractive index of the shell, relative to air; 1.49 is acrylic, 1.52 glass."""
    centre: Vec3 = (0.0, 0.0, 0.0)
    """Centre of the dome in camera axes (x right, y down, z forward) [m]: 0 is the lens (its entrance pupil), where
    nothing is bent."""
    half_angle_deg: Annotated[float, Field(gt=0.0, le=180.0)] | None = Field(default=None, examples=[90])
    """Half angle of the shell, at its centre, to the camera's axis [degrees]: 90 is a hemisphere. Absent: a whole
    sphere."""

    _written = unwritten_if_absent("half_angle_deg")


Port = Annotated[FlatPort | DomePort, Field(discriminator="kind")]


class Seawater(Block):
    """Water whose index follows from temperature and salinity (Quan and Fry 1995), different for R, G and B."""

    temperature_C: Annotated[float, Field(ge=-2.0, le=40.0, examples=[8.0])]  # noqa: N815
    """Temperature of the water [degrees Celsius]."""
    salinity: Annotated[float, Field(ge=0.0, le=45.0, examples=[35.0])]
    """Salinity of the water [per mille]; the ocean has 35."""


WaterIndex = Index | tuple[Index, Index, Index] | Seawater


class Vignetting(Block):
    """Fall of the light towards the corners: natural (cos^4 of the angle to the axis), or a polynomial.

    The polynomial is 1 + a1 r^2 + a2 r^4 + ..., r from the principal point in half diagonals of the image.
    """

    kind: Literal["cos4", "polynomial"] = "cos4"
    """Law of the fall: ``cos4``, as cos^4 of the angle to the axis, or ``polynomial``, by ``coefficients``."""
    coefficients: tuple[float, ...] = ()
    """Coefficients a1, a2, ... of a polynomial 1 + a1 r^2 + a2 r^4 + ..., r from the principal point in half diagonals
    of the image; for ``kind: polynomial`` only."""

    @model_validator(mode="after")
    def _coefficients_belong_to_the_polynomial(self):
        if (self.kind == "polynomial") != bool(self.coefficients):
            raise ValueError("coefficients [a1, a2, ...] belong to kind: polynomial, which needs at least one")
        return self


LENS = ("distortion", "port", "n_water", "vignetting")
"""Keys of what bends or dims a camera's rays."""


def resized(camera: Any, width: int, height: int) -> Any:
    """A camera with the same view in another number of pixels."""
    changed: dict[str, Any] = {"resolution": (width, height)}
    if camera.intrinsics is not None:
        x, y = width / camera.resolution[0], height / camera.resolution[1]
        fx, fy, cx, cy = (number for _, number in camera.intrinsics)
        changed["intrinsics"] = camera.intrinsics.model_copy(
            update={"fx": fx * x, "fy": fy * y, "cx": (cx + 0.5) * x - 0.5, "cy": (cy + 0.5) * y - 0.5}
        )
    return camera.model_copy(update=changed)


def twin(camera: Any) -> Any:
    """The same camera as a pinhole or thin lens in the water: without what bends, dims or blurs what it sees.

    In the middle of the image it shows things as large, so of a double sphere the focal length is another.
    """
    scale, changed = camera_model(camera).lens.central_scale, dict[str, Any](dict.fromkeys(LENS))
    changed["exposure"] = camera.exposure.model_copy(update={"time_s": 0.0, "readout_s": 0.0})
    if scale != 1.0 and camera.intrinsics is not None:
        f = {key: scale * getattr(camera.intrinsics, key) for key in ("fx", "fy")}
        changed["intrinsics"] = camera.intrinsics.model_copy(update=f)
    elif scale != 1.0:
        changed["focal_mm"] = scale * camera.focal_mm
    return camera.model_copy(update=changed)


def has_twin(camera: Any) -> bool:
    """Whether its `twin` is another camera: it has a port, distortion, vignetting or an exposure that lasts."""
    return bool(twin(camera) != camera)


def has_lens(camera: Any) -> bool:
    """Whether something bends or dims its rays."""
    return any(getattr(camera, name) is not None for name in LENS)


CROSS = np.array([[0, 0], [-0.5, 0], [0.5, 0], [0, -0.5], [0, 0.5]])
"""A place and those half a pixel beside it."""


def check_optics(camera: Any) -> Any:
    """Validator of a camera: lens, port and water fit together."""
    for problem in (_of_intrinsics, _of_water, _of_port, _of_lens, _of_rim, _of_vignetting):
        if found := problem(camera):
            raise ValueError(found)
    return camera


def _of_water(camera: Any) -> str | None:
    if camera.n_water is not None and camera.port is None:
        return "n_water has no effect without a port; give the port, or leave n_water out"
    return None


def unwritten_of_camera(camera: Any) -> list[str]:
    """Keys that a camera does not write down.

    What is absent, the calibration, whose numbers are written instead, and what says nothing beside intrinsics.
    """
    keys = [key for key in (*LENS, "intrinsics", "response", "color_matrix") if getattr(camera, key) is None]
    keys += ["exposure"] if camera.exposure == type(camera.exposure)() else []
    beside = [] if camera.intrinsics is None else ["sensor_mm"] if camera.f_stop > 0.0 else ["sensor_mm", "focal_mm"]
    return [*keys, *beside, "calibration"]


def _of_intrinsics(camera: Any) -> str | None:
    """Focal lengths are given once."""
    if camera.intrinsics is None:
        return None
    of, given = "calibration" if camera.calibration else "intrinsics", camera.model_fields_set
    if "sensor_mm" in given:
        return f"sensor_mm: stands beside {of}, which say how large pixels are; leave out one of them"
    if camera.f_stop > 0.0 and "focal_mm" not in given:
        return f"f_stop: beside {of}, in pixels, it needs focal_mm, too: the aperture's diameter is focal_mm / f_stop"
    if camera.f_stop == 0.0 and "focal_mm" in given:
        return (
            f"focal_mm: stands beside {of}, which say it in pixels; leave out one of them (with an f_stop, "
            "focal_mm is of the aperture only)"
        )
    return None


def _of_lens(camera: Any) -> str | None:
    """The middle of the image sees something."""
    if camera.distortion is None:
        return None
    model = camera.distortion.model
    if camera.f_stop > 0.0 and model in FISHEYES:
        return f"f_stop: a fisheye (distortion {model}) has no depth of field here; leave f_stop out"
    middle = 0.5 * np.array(camera.resolution) + CROSS
    if np.isfinite(camera_model(camera).directions(middle)).all():
        return None
    return (
        "distortion: not even the middle of the image sees anything, for the lens ends before; give smaller "
        f"{'xi' if model == DOUBLE_SPHERE else 'coefficients'}, or longer focal lengths"
    )


def _of_port(camera: Any) -> str | None:
    """The lens is on the air's side of the glass."""
    port, lens_radius = camera.port, 0.5e-3 * camera.focal_mm / camera.f_stop if camera.f_stop else 0.0
    if port is None:
        return None
    if port.kind == "dome":
        if port.thickness_m >= port.radius_m:
            return "port.thickness_m must be less than port.radius_m, which is that of the outer surface"
        if np.linalg.norm(port.centre) + lens_radius >= port.radius_m - port.thickness_m:
            return (
                f"port: the lens (of radius {lens_radius:g} m, at [0, 0, 0]) does not lie within the dome; "
                "move port.centre nearer to it or give a larger port.radius_m"
            )
        return None
    cosine = unit(port.normal)[2] if any(port.normal) else 0.0
    if cosine <= 1e-6:
        return "port.normal must point forwards: the glass of a flat port is before the lens, so its z is above 0"
    if lens_radius * np.sqrt(max(0.0, 1.0 - cosine**2)) >= port.distance_m:
        return (
            f"port.distance_m: the glass cuts the lens, whose radius (focal_mm / f_stop / 2) is {lens_radius:g} m; "
            "give a larger distance_m or f_stop"
        )
    return None


def _of_rim(camera: Any) -> str | None:
    """The pixels in the middle of the image see something."""
    model = camera_model(camera)
    middle = model.K[:2, 2] + CROSS
    if model.port is None or all((model.rays(middle, channel).weight > 0.0).all() for channel in range(3)):
        return None
    key = "clear_radius_m" if camera.port.kind == "flat" else "half_angle_deg"
    return f"port.{key}: the rim of the port hides the middle of the image; give a larger one"


BRIGHTEST = 10.0
"""Most that a polynomial may multiply the light by."""


def _farthest_corner(camera: Any) -> float:
    """Square of the largest r of a polynomial: 1 if the principal point is in the middle."""
    if camera.intrinsics is None:
        return 1.0
    half, centre = 0.5 * np.array(camera.resolution), camera_model(camera).K[:2, 2]
    return float(((np.abs(centre - half) + half) ** 2).sum() / (half**2).sum())


def _of_vignetting(camera: Any) -> str | None:
    fall, lens = camera_model(camera).vignetting, camera.distortion
    if fall is None:
        return None
    if fall.kind == "cos4" and lens is not None and lens.model in FISHEYES:
        return f"vignetting.kind: cos4 is not the law of a fisheye (distortion {lens.model}); give a polynomial"
    with np.errstate(over="ignore", invalid="ignore"):
        share = fall.polynomial(np.linspace(0.0, _farthest_corner(camera), 257))
    if not ((share >= 0.0) & (share <= BRIGHTEST)).all():
        return (
            "vignetting.coefficients: between the centre and the corners, 1 + a1 r^2 + a2 r^4 ... does not stay "
            f"between 0 and {BRIGHTEST:g}; r is in half diagonals of the image"
        )
    return None
