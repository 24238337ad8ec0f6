"""How much light a bound on the scatterings of a path loses: a measured Poisson law over the orders of scattering.

docs/models.md says how it was measured and where it holds.
"""

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import uniform_filter
from scipy.special import pdtrc

from varos_warp.render.adapt import DARK
from varos_warp.render.pilot import View
from varos_warp.scene.description import Scene
from varos_warp.scene.frames import camera_pose, intrinsics, lamp_position
from varos_warp.scene.water import OpticalProperties, optical_properties

SAFETY = 1.5
"""The criterion under-predicts by up to a third where wide-angle orders rule the tail."""
MOST_SCATTERINGS = 6
"""Beyond so many scatterings the Poisson law has not been measured."""
DEEPEST = 3.0
"""Largest x_s at which the Poisson law of surface light has been measured."""
FARTHEST_LAMP_M = 1.5
"""The law of volume light has been measured for lamps beside the camera, at most a metre off."""


def unmeasured(scene: Scene) -> str | None:
    """Why the truncation criterion says nothing about a scene that scatters; None where it has been measured."""
    water, vehicle = optical_properties(scene), scene.vehicle
    if len(scene.render.layers) < 3:
        return "the criterion is about the whole light, and a layer is left out"
    if not vehicle.lights:
        return "there are no lamps"
    if not water.phase.is_henyey_greenstein:
        return f"the criterion is known for the phase function of Henyey and Greenstein, not for {water.phase.kind}"
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
    """Largest share of the light that a bound of 0, 1, 2 ... scatterings loses anywhere in a view [bounds, 3].

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
        share = np.divide(lost, judged, out=np.zeros_like(lost), where=judged > 0.0)
        errors.append(share.max((0, 1)))
    return SAFETY * np.array(errors)


def view_rays(view: View) -> tuple[np.ndarray, np.ndarray]:
    """Origin [3] and directions [H, W, 3] of the rays through the pixel centres, world axes."""
    T_w_c, K = camera_pose(view.camera, view.T_w_v), intrinsics(view.camera)
    row, col = np.indices(view.range.shape) + 0.5
    d = np.stack([col, row, np.ones_like(col)], axis=-1) @ (T_w_c[:3, :3] @ np.linalg.inv(K)).T
    return T_w_c[:3, 3], d / np.linalg.norm(d, axis=-1, keepdims=True)


def surface_path(scene: Scene, view: View) -> np.ndarray:
    """Length [H, W] of the way lamp - surface - camera [m], mean over the lamps by I/d^2; 0 where nothing is hit."""
    origin, d = view_rays(view)
    t = np.where(np.isfinite(view.range), view.range, 0.0)
    weights, lengths = np.zeros(t.shape), np.zeros(t.shape)
    for light in scene.vehicle.lights:
        lamp = lamp_position(light, view.T_w_v)
        distance = np.maximum(np.linalg.norm(origin + t[..., None] * d - lamp, axis=-1), 1e-3)
        weight = sum(light.intensity) / distance**2
        weights, lengths = weights + weight, lengths + weight * (t + distance)
    return np.where(t > 0.0, lengths / np.maximum(weights, 1e-30), 0.0)


def volume_path(scene: Scene, view: View, water: OpticalProperties) -> np.ndarray:
    """Mean path length <l> [H, W, 3] [m] of light scattered once on the way, by quadrature along every ray.

    The mean of t + d with the integrand of single scattering, I p(theta) exp(-sigma_t (t + d))/d^2 inside the lamps'
    cones, at a distance t from the camera and d from the lamp; 0 where no lamp reaches the ray.
    """
    origin, direction = view_rays(view)
    end = np.minimum(view.range, _FAR_M)
    weights, lengths = np.zeros((*end.shape, 3)), np.zeros((*end.shape, 3))
    for u in (np.arange(_NODES) + 0.5) / _NODES:
        t = _NEAR_M * np.expm1(u * np.log1p(end / _NEAR_M))  # evenly in log(near + t): dt is in proportion to near + t
        p = origin + t[..., None] * direction
        for light in scene.vehicle.lights:
            to_p = p - lamp_position(light, view.T_w_v)
            d = np.maximum(np.linalg.norm(to_p, axis=-1), 1e-3)
            weight = (t + _NEAR_M) * in_cone(light, view.T_w_v, to_p, d) / d**2
            cosine = -np.einsum("...i,...i", to_p, direction) / d
            weight = weight * water.phase.eval(cosine)
            length = (t + d)[..., None]
            weight = weight[..., None] * light.intensity * np.exp(-water.sigma_t * length)
            weights += weight
            lengths += weight * length
    return np.divide(lengths, weights, out=np.zeros_like(lengths), where=weights > 0.0)


_NODES, _NEAR_M, _FAR_M = 32, 0.1, 100.0


def in_cone(light, T_w_v: np.ndarray, to_p: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Whether points [H, W] at ``to_p``, ``d`` from a spot light, are inside its cone."""
    axis = T_w_v[:3, :3] @ light.direction / np.linalg.norm(light.direction)
    return to_p @ axis > d * np.cos(np.radians(half_angle_deg(light)))
