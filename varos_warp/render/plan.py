"""The cheapest model that meets the tolerance: how many scatterings A needs, how many samples, and what that will cost.

Everything follows from a pilot: a few poses of the sequence at low resolution with a few samples. Its layers tell how
much light a bound on the scatterings would lose (a measured Poisson law over the orders of scattering), its standard
errors how many samples the tolerance needs. Times are measured for the cost only; nothing that is chosen depends on
them, so machines that share the work choose alike. docs/models.md says what is behind the numbers.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import uniform_filter
from scipy.special import pdtrc

from varos_warp.render.denoise import available_method
from varos_warp.render.frame import resolve_integrator
from varos_warp.scene.description import Camera, Scene
from varos_warp.scene.frames import camera_pose, intrinsics
from varos_warp.scene.water import OpticalProperties, optical_properties

CHANNELS = ("red", "green", "blue")

TRUNCATION_SHARE = 0.25
"""Share of the tolerance that the light lost to ``max_scatterings`` may take; the rest is for noise."""
SAFETY = 1.5
"""The criterion under-predicts by up to a third where wide-angle orders rule the tail."""
MOST_SCATTERINGS = 6
"""Beyond so many scatterings the Poisson law has not been measured."""
DEEPEST = 3.0
"""Largest x_s at which the Poisson law of surface light has been measured."""
FARTHEST_LAMP_M = 1.5
"""The law of volume light has been measured for lamps beside the camera, at most a metre off."""
DARK = 0.1
"""Places darker than this share of the image's mean are judged as if they had it: their error is an absolute one."""

PILOT_POSES = 5
PILOT_PIXELS, PILOT_SPP = 160 * 90, 4
"""Size of an image of the pilot; smaller ones get more samples per pixel, the same in all."""
POOLED_SAMPLES = 256
"""Relative variances are those of squares of pixels with so many samples, mean over 3 x 3 of them. Fewer samples miss
the rare bright ones: the median over pixels of a 4-sample standard error is half of the right one; that of these
squares is 10 % below what 256 samples per pixel find in them."""
FEWEST_SPP, MOST_SPP, SPP_STEP = 8, 4096, 8


@dataclass(frozen=True)
class Plan:
    """What to render with, and why."""

    spp: int
    """Samples per pixel of A."""
    max_scatterings: int | None
    """Most scatterings in the water on a path; None: no bound."""
    reasons: list[str]
    """One sentence for each choice."""
    models: dict[str, str] = field(default_factory=dict)
    """How each output is made, by its letter."""
    cost: dict[str, Any] | None = None
    """Seconds on this device; only where they were asked for."""
    meshes: dict[str, Any] | None = None
    """What was kept of every mesh, why, and what that costs; from `varos_warp.render.detail`."""

    def to_dict(self) -> dict[str, Any]:
        """Plain types; the same on every machine as long as there is no ``cost``."""
        content = {"spp": self.spp, "max_scatterings": self.max_scatterings, "models": self.models}
        content |= {} if self.cost is None else {"cost": self.cost}
        return content | {"reasons": self.reasons} | ({} if self.meshes is None else {"meshes": self.meshes})


def plan_render(scene: Scene, renderer, poses: Sequence[np.ndarray], *, measure_cost: bool = False,
                meshes: dict | None = None) -> Plan:
    """Choose samples and scatterings for a sequence; what the scene file fixes stays as it is.

    Args:
        scene: The scene.
        renderer: A `FrameRenderer` of it.
        poses: T_w_v [4, 4] of every frame.
        measure_cost: Also measure how long it will take on this device.
        meshes: What was kept of the meshes, for the plan.
    """
    settled = _settled_scatterings(scene)
    views = [] if settled and scene.render.spp is not None else list(_pilot(scene, renderer, poses))
    max_scatterings, why_scatterings = settled or _fewest_scatterings(scene, views)
    spp, why_spp = _fewest_spp(scene, views)
    cost = _cost(scene, renderer, poses, spp, max_scatterings) if measure_cost else None
    reasons = [why_scatterings, why_spp, *_why_meshes(meshes)]
    return Plan(spp, max_scatterings, reasons, _models(scene, spp, max_scatterings), cost, meshes)


def _why_meshes(meshes: dict | None) -> list[str]:
    """A sentence on the meshes where any were reduced."""
    if meshes is None or meshes["level_of_detail"] is None:
        return []
    asked = ", ".join(f"{key} {value}" for key, value in meshes["level_of_detail"].items())
    depth = meshes.get("depth_error", {})
    cost = f"; D moves by {depth['rms_mm']:.2g} mm (rms)" if "rms_mm" in depth else ""
    return [f"level_of_detail {asked}: {meshes['kept']} of {meshes['triangles']} triangles are kept{cost}"]


TRACERS = {"reference": "reference path tracer", "path": "path tracer", "tables": "tables of open water"}


def _integrators(scene: Scene, max_scatterings: int | None) -> set[str]:
    """What renders A, over the cameras."""
    render = scene.render
    return {resolve_integrator(scene, camera, render.integrator, max_scatterings) for camera in scene.vehicle.cameras}


def _models(scene: Scene, spp: int, max_scatterings: int | None) -> dict[str, str]:
    """What makes each output, in words."""
    render = scene.render
    bounds = ((max_scatterings, "scattering", "in the water"), (render.max_bounces, "reflection", "on surfaces"))
    words = [f"any number of {noun}s {where}" if bound is None else
             f"at most {bound} {noun}{'' if bound == 1 else 's'} {where}" for bound, noun, where in bounds]
    tracer = " or ".join(TRACERS[name] for name in sorted(_integrators(scene, max_scatterings)))
    return {"A": f"{tracer}, paths with {' and '.join(words)}, {spp} samples per pixel, denoise {render.denoise}",
            "B": f"no water, uniform ambient light, {render.spp_b} samples per pixel, denoise {render.denoise_b}",
            "C": "first hits of pixel centres, smoothed normals", "D": "first hits of pixel centres",
            "S": "first hits of pixel centres"}


# ------------------------------------------------------------------------------------------------------------ the pilot


@dataclass(frozen=True)
class View:
    """One image of the pilot, and where it was taken."""

    label: str
    camera: Camera
    """With the resolution of the pilot."""
    T_w_v: np.ndarray
    spp: int
    image: Any
    """`RadianceImage` of A."""
    range: np.ndarray
    """Distance of the first hits along the rays [H, W] [m]; inf where nothing is hit."""


def pilot_camera(camera: Camera, pixels: int = PILOT_PIXELS) -> Camera:
    """The same field of view with at most so many pixels."""
    scale = min(1.0, np.sqrt(pixels / np.prod(camera.resolution)))
    return camera.model_copy(update={"resolution": tuple(max(1, round(scale * side)) for side in camera.resolution)})


def pilot_frames(count: int) -> list[int]:
    """A few frames of ``count``, evenly spread and with the first and the last."""
    return np.unique(np.linspace(0, count - 1, PILOT_POSES).round().astype(int)).tolist()


def _pilot(scene: Scene, renderer, poses) -> Iterator[View]:
    """Render a few poses, evenly spread and with the first and the last, through every camera."""
    render = scene.render
    for frame in pilot_frames(len(poses)):
        for camera in map(pilot_camera, scene.vehicle.cameras):
            spp = round(PILOT_SPP * PILOT_PIXELS / np.prod(camera.resolution))
            made = renderer.render(poses[frame], camera, "AD", spp=spp, max_scatterings=render.max_scatterings,
                                   max_bounces=render.max_bounces, layers=tuple(render.layers), frame=frame)
            yield View(f"frame {frame}, camera {camera.id}", camera, poses[frame], spp, made.A, made.D.range)


# ---------------------------------------------------------------------------------------------------------- scatterings


def _settled_scatterings(scene: Scene) -> tuple[int | None, str] | None:
    """``max_scatterings`` and its reason where they do not depend on how the scene looks."""
    bound, layers = scene.render.max_scatterings, scene.render.layers
    if bound is not None:
        return bound, f"max_scatterings {bound}: given"
    if not optical_properties(scene).sigma_s.any():
        return 0, "max_scatterings 0: the water does not scatter"
    if "multiple" not in layers:
        bound = int("single" in layers)
        return bound, f"max_scatterings {bound}: the layers asked for have no more"
    if _integrators(scene, None) == {"tables"}:
        return None, "max_scatterings null: the tables hold all orders"
    why = _unknown(scene)
    return None if why is None else (None, f"max_scatterings null: {why}")


def _fewest_scatterings(scene: Scene, views: Sequence[View]) -> tuple[int | None, str]:
    """The fewest scatterings that lose less light than ``TRUNCATION_SHARE`` of the tolerance, and why."""
    if not max(view.image.radiance.max() for view in views) > 0.0:
        return None, "max_scatterings null: none of the poses looked at sees any light"
    allowed = TRUNCATION_SHARE * scene.render.tolerance
    worst = SAFETY * np.max([truncation_errors(scene, view) for view in views], axis=0)
    bound = next((n for n, error in enumerate(worst) if error < allowed), None)
    if bound is None:
        return None, (f"max_scatterings null: {MOST_SCATTERINGS} might lose {worst[-1]:.2%} of the light somewhere, "
                      f"and {allowed:.2%} is allowed")
    fewer = f"; {bound - 1} might lose {worst[bound - 1]:.2%}" if bound else ""
    return bound, (f"max_scatterings {bound}: loses at most {worst[bound]:.2%} of the light anywhere, and "
                   f"{allowed:.2%} is allowed (a quarter of the tolerance){fewer}")


def _unknown(scene: Scene) -> str | None:
    """Why the truncation criterion says nothing about a scene that scatters; None where it has been measured."""
    water, vehicle = optical_properties(scene), scene.vehicle
    if len(scene.render.layers) < 3:
        return "the criterion is about the whole light, and a layer is left out"
    if not vehicle.lights:
        return "there are no lamps"
    if water.g < KAPPA_G[0]:
        return f"the criterion is known for g from {KAPPA_G[0]}, not for {water.g:g}"
    narrow, wide = (end(map(half_angle_deg, vehicle.lights)) for end in (min, max))
    low, high = KAPPA_HALF_ANGLE_DEG[0], KAPPA_HALF_ANGLE_DEG[-1]
    if narrow < low or wide > high or wide > 1.5 * narrow:
        return (f"the criterion is known for lamps of one kind with cones of {2 * low:g} to {2 * high:g} degrees, "
                f"not for {2 * narrow:g} to {2 * wide:g}")
    if any(camera.mount == "world" or np.linalg.norm(np.subtract(camera.position, light.position)) > FARTHEST_LAMP_M
           for camera in vehicle.cameras for light in vehicle.lights):
        return f"the criterion is known for lamps within {FARTHEST_LAMP_M} m of the camera"
    return None


def half_angle_deg(light) -> float:
    """Half the cone of a lamp; 180 for one that shines everywhere."""
    return light.cone_deg / 2 if light.kind == "spot" else 180.0


KAPPA_G = (0.5, 0.8, 0.9, 0.95, 1.0)
KAPPA_HALF_ANGLE_DEG = (10.0, 20.0, 32.5, 60.0)
KAPPA = ((0.245, 0.419, 0.550, 0.667),
         (0.54, 0.74, 0.82, 0.87),
         (0.75, 0.87, 0.91, 0.93),
         (0.88, 0.94, 0.97, 0.99),
         (1.0, 1.0, 1.0, 1.0))
"""Share of the scattered light that still arrives, by g and half angle of the lamps' cone. Fitted to order-resolved
Monte Carlo, spread 2 % over waters and distances; g = 1 does not deflect, so there it is 1."""


def kappa(g: float, half_angle_deg: float) -> float:
    """``KAPPA`` between its nodes, linearly."""
    return float(RegularGridInterpolator((KAPPA_G, KAPPA_HALF_ANGLE_DEG), KAPPA)((g, half_angle_deg)))


def truncated_light(n: int, direct, single, x_s, x_v) -> tuple[np.ndarray, np.ndarray]:
    """Radiance lost by paths of at most ``n`` scatterings, and radiance of all orders, as the Poisson law has them.

    Light of order k off the surface is x_s^k/k! of the direct light; light of order k that never met a surface is
    x_v^(k-1)/(k-1)! of single scattering. Where x_s is beyond what was measured, all surface light counts as lost.

    Args:
        n: Bound on the scatterings.
        direct: Radiance of direct surface light S_0, any shape.
        single: Radiance of single scattering V_1.
        x_s: kappa sigma_s (distance from the camera + distance from the lamp).
        x_v: sigma_s <l>, with <l> the mean path length of singly scattered light.
    """
    surface, volume = direct * np.exp(np.minimum(x_s, 80.0)), single * np.exp(np.minimum(x_v, 80.0))
    surface_lost = np.where(x_s > DEEPEST, 1.0, pdtrc(n, x_s))
    volume_lost = pdtrc(n - 1, x_v) if n > 0 else 1.0
    return surface * surface_lost + volume * volume_lost, surface + volume


def truncation_errors(scene: Scene, view: View) -> np.ndarray:
    """Largest share of the light that a bound of 0, 1, 2 ... scatterings loses in a view, over places and channels.

    Light scattered forward comes from around a pixel, so what is lost and what there is are averaged over an eighth of
    the image before they are compared. Approximations: <l> is that of unoccluded lamps, the lens is a pinhole.
    """
    water, layers = optical_properties(scene), view.image.layers
    widest = max(half_angle_deg(light) for light in scene.vehicle.lights)
    x_s = kappa(water.g, widest) * water.sigma_s * surface_path(scene, view)[..., None]
    x_v = water.sigma_s * volume_path(scene, view, water)
    size = (*(max(1, side // 8) for side in view.range.shape), 1)
    errors = []
    for n in range(MOST_SCATTERINGS + 1):
        lost, total = (uniform_filter(light.astype(float), size)
                       for light in truncated_light(n, layers["direct"], layers["single"], x_s, x_v))
        judged = np.maximum(total, DARK * total.mean((0, 1)))
        errors.append(np.max(np.divide(lost, judged, out=np.zeros_like(lost), where=judged > 0.0)))
    return np.array(errors)


def _rays(view: View) -> tuple[np.ndarray, np.ndarray]:
    """Origin [3] and directions [H, W, 3] of the rays through the pixel centres, world axes."""
    T_w_c, K = camera_pose(view.camera, view.T_w_v), intrinsics(view.camera)
    row, col = np.indices(view.range.shape) + 0.5
    d = np.stack([col, row, np.ones_like(col)], axis=-1) @ (T_w_c[:3, :3] @ np.linalg.inv(K)).T
    return T_w_c[:3, 3], d / np.linalg.norm(d, axis=-1, keepdims=True)


def surface_path(scene: Scene, view: View) -> np.ndarray:
    """Length [H, W] of the way lamp - surface - camera [m], mean over the lamps by I/d^2; 0 where nothing is hit."""
    origin, d = _rays(view)
    t = np.where(np.isfinite(view.range), view.range, 0.0)
    weights, lengths = np.zeros(t.shape), np.zeros(t.shape)
    for light in scene.vehicle.lights:
        lamp = view.T_w_v[:3, :3] @ light.position + view.T_w_v[:3, 3]
        distance = np.maximum(np.linalg.norm(origin + t[..., None] * d - lamp, axis=-1), 1e-3)
        weight = sum(light.intensity) / distance**2
        weights, lengths = weights + weight, lengths + weight * (t + distance)
    return np.where(t > 0.0, lengths / np.maximum(weights, 1e-30), 0.0)


def volume_path(scene: Scene, view: View, water: OpticalProperties) -> np.ndarray:
    """Mean path length <l> [H, W, 3] [m] of light scattered once on the way, by quadrature along every ray.

    The mean of t + d with the integrand of single scattering, I p(theta) exp(-sigma_t (t + d))/d^2 inside the lamps'
    cones, at a distance t from the camera and d from the lamp; 0 where no lamp reaches the ray.
    """
    origin, direction = _rays(view)
    end = np.minimum(view.range, _FAR_M)
    weights, lengths = np.zeros((*end.shape, 3)), np.zeros((*end.shape, 3))
    for u in (np.arange(_NODES) + 0.5) / _NODES:
        t = _NEAR_M * np.expm1(u * np.log1p(end / _NEAR_M))  # evenly in log(near + t): dt is in proportion to near + t
        p = origin + t[..., None] * direction
        for light in scene.vehicle.lights:
            to_p = p - (view.T_w_v[:3, :3] @ light.position + view.T_w_v[:3, 3])
            d = np.maximum(np.linalg.norm(to_p, axis=-1), 1e-3)
            weight = (t + _NEAR_M) * _lit(light, view.T_w_v, to_p, d) / d**2
            cosine = -np.einsum("...i,...i", to_p, direction) / d
            weight = weight * (1.0 + water.g**2 - 2.0 * water.g * cosine) ** -1.5
            length = (t + d)[..., None]
            weight = weight[..., None] * light.intensity * np.exp(-water.sigma_t * length)
            weights += weight
            lengths += weight * length
    return np.divide(lengths, weights, out=np.zeros_like(lengths), where=weights > 0.0)


_NODES, _NEAR_M, _FAR_M = 32, 0.1, 100.0


def _lit(light, T_w_v: np.ndarray, to_p: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Whether points [H, W] at ``to_p``, ``d`` from a spot light, are inside its cone."""
    axis = T_w_v[:3, :3] @ light.direction / np.linalg.norm(light.direction)
    return to_p @ axis > d * np.cos(np.radians(half_angle_deg(light)))


# -------------------------------------------------------------------------------------------------------------- samples


DENOISED_TO = (0.006, 0.01, 0.02, 0.03, 0.04)
DENOISER_GAIN = (1.0, 1.5, 2.2, 2.7, 3.5)
"""Factor by which a denoiser lowers the relative error, by the error that it arrives at: what is left in the end is its
own blur, which more samples lower slowly. Open Image Denoise and non-local means are alike. Measured at 320 x 180, full
transport, against two independent references (so that their noise cancels), worst channel, median over places:

    spp   demo, frame 6: noisy -> oidn, nlm   spp   a sea floor without textures
      4   0.190 -> 0.044, 0.046                 4   0.167 -> 0.033, 0.034
     16   0.102 -> 0.034, 0.032                16   0.094 -> 0.023, 0.021
     64   0.056 -> 0.022, 0.022                64   0.049 -> 0.015, 0.016
    600   0.018 -> 0.011, 0.009               256   0.026 -> 0.011, 0.011

The table stays a little below the lesser gain; under 0.006, where nothing was measured, denoising does not count."""


TABLES_TO = (0.006, 0.0071, 0.0084, 0.0115, 0.017)
TABLES_GAIN = (1.0, 2.8, 3.6, 4.2, 4.4)
"""The same with tables, where only the residual is denoised: relative RMSE on ref1, 16 to 2 samples per pixel."""


def _fewest_spp(scene: Scene, views: Sequence[View]) -> tuple[int, str]:
    """Samples per pixel that bring the median relative error of the noisiest view and channel to the tolerance."""
    render = scene.render
    if render.spp is not None:
        return render.spp, f"spp {render.spp}: given"
    noise = np.array([sample_noise(view.image, view.spp) for view in views])
    if not np.any(noise > 0.0):
        return FEWEST_SPP, f"spp {FEWEST_SPP}: no noise was found, and no fewer are taken"
    view, channel = np.unravel_index(np.argmax(noise), noise.shape)
    method = available_method(render.denoise)
    gains = (TABLES_TO, TABLES_GAIN) if _integrators(scene, render.max_scatterings) == {"tables"} else (
        DENOISED_TO, DENOISER_GAIN)
    gain = 1.0 if method == "none" else np.interp(render.tolerance, *gains)
    needed = (noise.max() / (render.tolerance * gain)) ** 2
    spp = int(np.clip(SPP_STEP * np.ceil(needed / SPP_STEP), FEWEST_SPP, MOST_SPP))
    helped = f"{method} divides the error of their mean by {gain:.1f}, " if gain > 1.0 else ""
    why = (f"spp {spp}: one sample has a relative error of {noise.max():.2f} ({CHANNELS[channel]}, "
           f"{views[view].label}), {helped}and {render.tolerance:g} is asked")
    if needed > MOST_SPP:
        why += f"; that would need {needed:.0f}, more than are ever taken: the error will be larger"
    elif needed <= FEWEST_SPP:
        why += "; no fewer are taken"
    return spp, why


def sample_noise(image, spp: int) -> np.ndarray:
    """Relative standard error [3] of one sample: the median over places of an image, 0 where there is no light.

    Args:
        image: `RadianceImage`.
        spp: Its samples per pixel, 2 at least.
    """
    side = max(1, round(np.sqrt(POOLED_SAMPLES / spp)))
    variance = spp * _pool(np.square(image.stderr, dtype=np.float64), side)
    radiance = _pool(image.radiance.astype(np.float64), side)
    lit = radiance > 0.0
    relative = np.divide(variance, radiance**2, out=np.zeros_like(variance), where=lit)
    weight = uniform_filter(lit.astype(float), (3, 3, 1))
    relative = uniform_filter(relative, (3, 3, 1)) / np.maximum(weight, 1e-30)
    return np.array([np.sqrt(np.median(relative[..., c][lit[..., c]])) if lit[..., c].any() else 0.0 for c in range(3)])


def _pool(image: np.ndarray, side: int) -> np.ndarray:
    """Means over squares of ``side`` pixels, less at the right and lower edge: [H, W, 3] to [h, w, 3]."""
    for axis in (0, 1):
        starts = np.arange(0, image.shape[axis], side)
        count = np.diff(np.append(starts, image.shape[axis]))
        image = np.add.reduceat(image, starts, axis) / np.expand_dims(count, (1 - axis, 2))
    return image


# ----------------------------------------------------------------------------------------------------------------- cost


def _cost(scene: Scene, renderer, poses, spp: int, max_scatterings: int | None) -> dict[str, Any]:
    """Seconds that rendering takes on this device, from the middle pose; denoising and writing go on beside it."""
    asked = scene.render.outputs
    groups = {"A": (spp, "A" in asked), "B": (scene.render.spp_b, "B" in asked), "CDS": (1, set("CDS") & set(asked))}
    seconds = {letters: sum(_seconds(scene, renderer, camera, poses[len(poses) // 2], letters, samples, max_scatterings)
                            for camera in scene.vehicle.cameras)
               for letters, (samples, wanted) in groups.items() if wanted}
    a_frame = sum(seconds.values())
    return {"device": f"{renderer.device} ({renderer.device_name})", "frames": len(poses),
            "cameras": len(scene.vehicle.cameras), "seconds_per_frame": float(f"{a_frame:.3g}"),
            "seconds_by_output": {letters: float(f"{value:.3g}") for letters, value in seconds.items()},
            "seconds_in_all": float(f"{a_frame * len(poses):.3g}")}


def _seconds(scene: Scene, renderer, camera: Camera, T_w_v, letters: str, spp: int, max_scatterings) -> float:
    """Seconds for one image: of a small one with few samples on a CPU, where time is in proportion to both."""
    small = pilot_camera(camera) if renderer.device == "cpu" else camera  # a GPU is not full with a small image
    few = min(spp, PILOT_SPP if renderer.device == "cpu" else 8 * PILOT_SPP)
    start, compiled = time.perf_counter(), renderer.compile_seconds
    renderer.render(T_w_v, small, letters, spp=few, spp_b=few, max_scatterings=max_scatterings,
                    max_bounces=scene.render.max_bounces, layers=tuple(scene.render.layers))
    seconds = time.perf_counter() - start - (renderer.compile_seconds - compiled)
    return seconds * spp / few * np.prod(camera.resolution) / np.prod(small.resolution)
