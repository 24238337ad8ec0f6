"""Tables of the light that scattering adds to a camera's rays, over the place in the image and the distance.

They exist where rays are straight and the camera moves with all lights, so that neither changes with the pose.
"""

import warp as wp

from varos_warp.kernels.numerics import trilinear

wp.set_module_options({"enable_backward": False})


@wp.struct
class AlongCamera:
    """Radiance that is added to a camera's rays up to each distance."""

    radiance: wp.array3d(dtype=wp.vec3)
    """[distance, row, column], nodes that span the image."""
    nearest: float
    """First of the distances [m]; they are evenly spaced in the logarithm. Nearer, radiance is in proportion."""
    log_step: float


@wp.func
def distance_along(table: AlongCamera, k: int):
    """The distance [m] of a node."""
    return table.nearest * wp.exp(float(k) * table.log_step)


@wp.func
def radiance_along(table: AlongCamera, x: float, y: float, t: float):
    """Radiance added before ``t`` [m] along the camera's ray through (x, y) in [0, 1]^2."""
    steps = wp.log(wp.max(t, 1.0e-9) / table.nearest) / table.log_step
    share = float(1.0)
    if steps < 0.0:
        share = wp.exp(steps * table.log_step)
    at = wp.clamp(steps, 0.0, float(table.radiance.shape[0] - 1) - 1.0e-3)
    u = wp.clamp(x, 0.0, 1.0) * float(table.radiance.shape[2] - 1)
    v = wp.clamp(y, 0.0, 1.0) * float(table.radiance.shape[1] - 1)
    return share * trilinear(table.radiance, at, v, u)
