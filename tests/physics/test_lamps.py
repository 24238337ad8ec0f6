"""Lamps with a profile or a port: images against the spot that they describe, and against a quadrature."""

import numpy as np
import pytest
from rig import assert_agrees, floor, hg, one_ray_scene, radiance, spot

from tests.truths import SIGMAS
from varos_warp.render.kinds import FEW_LIGHTS
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.geometry.parts import Part
from varos_warp.scene.lights import distribution as distribution_module
from varos_warp.scene.lights.distribution import distribution
from varos_warp.scene.lights.profiles import read_profile

WATER = {"sigma_s": [0.2] * 3, "sigma_a": [0.1] * 3, "phase": {"g": 0.8}}
PLACES = [(-0.15, 0, -0.1), (0.15, 0, -0.1)]


def soft_spot(folder) -> dict:
    """A light of the kind ``profile`` that shines like a spot with a soft edge of 0.5."""
    angle, half = np.linspace(0.0, 32.5, 2001), np.cos(np.radians(32.5))
    s = np.clip((np.cos(np.radians(angle)) - half) / (0.5 * (1.0 - half)), 0.0, 1.0)
    rows = "\n".join(f"{a},{x}" for a, x in zip(angle, 7.0 * s * s * (3.0 - 2.0 * s), strict=True))
    (folder / "spot.csv").write_text(f"angle_deg,intensity\n{rows}\n")
    return {"kind": "profile", "file": str(folder / "spot.csv")}


def hot_spot(folder) -> dict:
    """A lamp with a bright middle and a long wing."""
    angle = np.linspace(0.0, 60.0, 121)
    intensity = np.exp(-((angle / 12.0) ** 2)) + 0.1 * np.cos(np.radians(1.5 * angle))
    rows = "\n".join(f"{a},{x}" for a, x in zip(angle, intensity, strict=True))
    (folder / "hot.csv").write_text(f"angle_deg,intensity\n{rows}\n")
    return {"kind": "profile", "file": str(folder / "hot.csv")}


def lamps(like: dict) -> list[dict]:
    """Two, beside the camera."""
    return [
        {key: value for key, value in spot(place).items() if key not in ("kind", "cone_deg", "blend")} | like
        for place in PLACES
    ]


def test_a_profile_shines_like_the_spot_that_it_describes(tmp_path):
    """With the same random numbers, but that 512 linear steps differ from the soft edge by 1e-4 of the peak."""
    ground = [floor(3.0, 0.3)]
    one = radiance(one_ray_scene([spot(place, blend=0.5) for place in PLACES], WATER), ground)[0]
    other = radiance(one_ray_scene(lamps(soft_spot(tmp_path)), WATER), ground)[0]
    np.testing.assert_allclose(other, one, rtol=1e-3)


def scattered_once(scene, T):
    """Radiance of light that all lamps of a scene scatter once into the ray along z up to ``T``, by quadrature."""
    total, count = 0.0, 100_000
    t = T * (np.arange(count) + 0.5) / count
    for light, (px, py, pz) in zip(scene.vehicle.lights, PLACES, strict=True):
        shape, distance = distribution(light, scene), np.sqrt(px**2 + py**2 + (t - pz) ** 2)
        cosine = (t - pz) / distance
        sent = shape.gain * shape.at(np.arccos(cosine)) / distance**2 * np.exp(-0.3 * (t + distance))
        total += T * float((0.2 * hg(-cosine, 0.8) * sent).mean())
    return total


@pytest.mark.parametrize("like", [{"kind": "spot", "port": {"kind": "flat"}}, "hot", "hot behind a port"])
@pytest.mark.parametrize("integrator", ["path", "field"])
def test_what_such_lamps_scatter_once_is_a_quadrature(tmp_path, like, integrator):
    """To a thousandth: the integrand jumps where the ray enters the cone."""
    if isinstance(like, str):
        like = hot_spot(tmp_path) | ({"port": {"kind": "flat"}} if "port" in like else {})
    scene = one_ray_scene(lamps(like), WATER, pixels=64)
    estimate = radiance(scene, [floor(3.0, 0.0)], "single", integrator=integrator, spp=16)
    assert_agrees(estimate, scattered_once(scene, 3.0), truth_stderr=3e-4 * estimate[0][0])


@pytest.mark.parametrize("port", [None, {"kind": "flat"}])
def test_the_floor_below_a_lamp_has_the_irradiance_of_its_profile(tmp_path, port):
    scene = one_ray_scene(lamps(hot_spot(tmp_path) | ({"port": port} if port else {})), None)
    shape, (x, _, z) = distribution(scene.vehicle.lights[0], scene), PLACES[1]
    r = np.hypot(x, 3.0 - z)
    E = 2.0 * shape.gain * shape.at(np.arctan2(x, 3.0 - z)) / r**2 * (3.0 - z) / r
    assert_agrees(radiance(scene, [floor(3.0, 0.3)], "direct", spp=4), 0.3 / np.pi * E)


@pytest.mark.gpu
@pytest.mark.parametrize("port", [{}, {"port": {"kind": "flat"}}])
@pytest.mark.parametrize("integrator", ["path", "field"])
def test_a_gpu_lights_as_a_cpu_does(tmp_path, port, integrator):
    scene, ground = one_ray_scene(lamps(hot_spot(tmp_path) | port), WATER, pixels=64), [floor(3.0, 0.3)]
    cpu, gpu = (radiance(scene, ground, device=device, integrator=integrator) for device in ("cpu", "cuda:0"))
    assert_agrees(gpu, cpu[0], truth_stderr=cpu[1])


def test_the_file_of_a_profile_is_not_read_for_every_frame(tmp_path, monkeypatch):
    """Nor for the lights of the device twice: once for them, and once to see whether the field serves."""
    reads = []
    monkeypatch.setattr(distribution_module, "read_profile", lambda *of: reads.append(of) or read_profile(*of))
    renderer = FrameRenderer(one_ray_scene(lamps(hot_spot(tmp_path))[:1], WATER), "cpu", parts=[])
    for frame in range(3):
        renderer.render(np.eye(4), outputs="A", integrator="auto", layers=("single",), spp=1, frame=frame)
    assert len(reads) == 2


@pytest.mark.parametrize("count", [FEW_LIGHTS, FEW_LIGHTS + 1])
def test_direct_light_is_the_sum_of_the_lamps(count):
    """Few are each asked, so images add up to rounding; of more one is chosen, and they add up to their errors.

    A plate hides half of the floor from every second lamp.
    """
    lights = [spot((0.8 * (-1) ** i, 0.0, -0.1 * i), cone_deg=120.0) for i in range(count)]
    plate = floor(1.5, 0.3, size=0.25, offset=(0.4, 0.0, 0.0))
    parts = [floor(3.0, 0.3), Part("plate", plate.vertices, plate.faces, plate.material)]
    view = {"sensor_mm": [4.0, 4.0], "focal_mm": 4.0}

    def direct(some):
        scene = one_ray_scene(some, WATER, pixels=24, **view)
        image = FrameRenderer(scene, "cpu", parts=parts).render(
            np.eye(4), outputs="A", spp=8, seed=3, integrator="path", layers=("direct",), denoise="none"
        )
        return image.A

    together, apart = direct(lights), [direct([light]) for light in lights]
    total = np.sum([image.radiance for image in apart], axis=0, dtype=float)
    if count <= FEW_LIGHTS:
        np.testing.assert_allclose(together.radiance, total, rtol=count * 2.0**-22)
    else:
        assert not np.allclose(together.radiance, total, rtol=1e-3)
        stderr = np.sqrt((together.stderr.astype(float) ** 2).sum((0, 1))) / total[..., 0].size
        assert np.all(np.abs(together.radiance.mean((0, 1)) - total.mean((0, 1))) < SIGMAS * stderr)
