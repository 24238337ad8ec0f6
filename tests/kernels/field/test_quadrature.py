"""The quadrature of single scattering ray by ray, where lights are far from the origin and rays pass them closely."""

import numpy as np
import pytest
import warp as wp
from physics.rig import single_scattering as reference

from varos_warp.kernels.field.single_scattering import single_scattering
from varos_warp.kernels.world.lights.record import Light
from varos_warp.kernels.world.medium import Medium

RAYS, EXTINCTION = 100, np.float32(0.1)
POSITION = np.array([300.0, -400.0, 500.0])
AXIS = np.array([0.3, 1.0, -0.2]) / np.linalg.norm([0.3, 1.0, -0.2])
LONGEST_M = 4.0


@wp.kernel(enable_backward=False)
def radiances(
    medium: Medium, light: Light, o: wp.array(dtype=wp.vec3), d: wp.array(dtype=wp.vec3), out: wp.array(dtype=wp.vec3)
):
    i = wp.tid()
    out[i] = single_scattering(medium, light, o[i], d[i], LONGEST_M)


def rays():
    """Origins and unit directions, float32 [N, 3]: they pass the light's axis at millimetres to decimetres."""
    rng = np.random.default_rng(3)
    distance, aside = np.exp(rng.uniform(np.log([0.1, 0.003]), np.log([2.0, 0.3]), (RAYS, 2))).T[..., None]
    along = POSITION + AXIS * rng.uniform(0.1, 2.0, (RAYS, 1))
    o = along + distance * rng.normal(size=(RAYS, 3))
    d = along + aside * rng.normal(size=(RAYS, 3)) - o
    return o.astype(np.float32), (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)


def truth(o, d, g, cone_deg, blend):
    """The same in float64: the rig's quadrature in axes where a ray starts at the origin and runs along z."""
    found = []
    for start, z in zip(o.astype(float), d.astype(float), strict=True):
        z /= np.linalg.norm(z)
        to_light = POSITION.astype(np.float32) - start
        x = to_light - (to_light @ z) * z
        axes = np.array([x / np.linalg.norm(x), np.cross(z, x) / np.linalg.norm(x), z])
        found.append(reference(axes @ to_light, 1.0, EXTINCTION, g, LONGEST_M, axes @ AXIS, cone_deg, blend))
    return np.array(found)


@pytest.mark.parametrize("g", [0.0, 0.9])
def test_narrow_cones_that_rays_pass_closely_keep_their_digits(g):
    """0.1 % is the most that the nodes leave; of rays darker than a thousandth of the brightest, of that.

    With the light's place in the world rounded before the ray's is taken off, it is 0.6 %.
    """
    cos_half, blend, (o, d) = 0.98, 0.15, rays()
    medium, light = Medium(), Light()
    medium.sigma_s, medium.sigma_t, medium.phase.g = wp.vec3(1.0), wp.vec3(float(EXTINCTION)), g
    light.position, light.axis, light.intensity = wp.vec3(*POSITION), wp.vec3(*AXIS), wp.vec3(1.0)
    light.cos_half, light.blend = cos_half, blend
    out = wp.zeros(RAYS, dtype=wp.vec3, device="cpu")
    wp.launch(
        radiances,
        dim=RAYS,
        inputs=[medium, light, *(wp.array(v, dtype=wp.vec3, device="cpu") for v in (o, d))],
        outputs=[out],
        device="cpu",
    )
    expected = truth(o, d, g, 2.0 * np.degrees(np.arccos(np.float32(cos_half))), np.float32(blend))
    assert np.count_nonzero(expected) > RAYS / 2
    off = np.abs(out.numpy()[:, 0] - expected) / np.maximum(expected, 1e-3 * expected.max())
    assert off.max() < 1e-3
