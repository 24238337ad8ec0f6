"""Lamps that are not the same all around their axis: what they emit, what they light, and where integrators agree."""

import numpy as np
import pytest
import trimesh
import warp as wp
from chance import assert_plausible, run, two_sided
from ies_by_hand import ies_text, intensity_by_hand
from physics.test_reference_integrator import assert_agrees_with_heavy_tail
from rig import assert_agrees, floor, hg, one_ray_scene, radiance, to_vehicle

from varos_warp.errors import InputError
from varos_warp.kernels.world.lights import light as lights
from varos_warp.render.field.open_water import unavailable
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry.parts import Part
from varos_warp.scene.lights.records import Lights

WATER = {"sigma_s": [0.2] * 3, "sigma_a": [0.1] * 3, "phase": {"g": 0.8}}
TURBID = {"sigma_s": [0.3] * 3, "sigma_a": [0.2] * 3, "phase": {"g": 0.0}}
VERTICAL, HORIZONTAL = np.arange(0.0, 91.0, 5.0), np.arange(0.0, 361.0, 15.0)


def two_lobes() -> str:
    """A file of type C: bright up and half as bright to the right, 30 degrees off the axis; nearly dark elsewhere."""
    v, c = np.meshgrid(np.radians(VERTICAL), np.radians(HORIZONTAL))
    lobes = np.maximum(np.cos(c), 0.0) ** 8 + 0.5 * np.maximum(-np.sin(c), 0.0) ** 8 + 0.02
    return ies_text("C", VERTICAL, HORIZONTAL, 1000.0 * lobes * np.exp(-(((v - np.radians(30.0)) / 0.25) ** 2)))


LOBES = two_lobes()


def lamp(folder, position=(0, 0, 0), axis=(0, 0, 1), up=(0, 1, 0), **keys) -> dict:
    """In axes of the notes: x right, y up, z along the ray."""
    (folder / "lobes.ies").write_text(LOBES)
    return {
        "kind": "profile",
        "file": str(folder / "lobes.ies"),
        "intensity": [1.0] * 3,
        "position": to_vehicle(position),
        "direction": to_vehicle(axis),
        "up": to_vehicle(up),
        **keys,
    }


def towards(offset, axis=(0, 0, 1), up=(0, 1, 0)) -> np.ndarray:
    """Intensity of the lamp towards places [..., 3] relative to it, its peak 1, by the second reading of the file."""
    offset, axis, up = (np.asarray(vector, float) for vector in (offset, axis, up))
    axis = axis / np.linalg.norm(axis)
    up = up - (up @ axis) * axis
    up /= np.linalg.norm(up)
    d = offset / np.linalg.norm(offset, axis=-1, keepdims=True)
    # the notes' axes are those of a mirror: x right, y up, z ahead
    right = np.cross(up, axis)
    return intensity_by_hand(LOBES, d @ axis, d @ up, d @ right).reshape(d.shape[:-1]) / PEAK


PEAK = 1000.0 * 1.02  # at 30 degrees in the half plane C = 0


# ---------------------------------------------------------------------------------------------------- what is emitted


@wp.kernel(enable_backward=False)
def emit(
    records: wp.array(dtype=lights.Light),
    u: wp.array(dtype=wp.vec2),
    d: wp.array(dtype=wp.vec3),
    area: wp.array(dtype=float),
    sent: wp.array(dtype=float),
):
    i = wp.tid()
    light = records[0]
    d[i] = lights.light_emit(light, u[i][0], u[i][1]).d
    area[i] = lights.light_solid_angle(light, wp.dot(d[i], light.axis))
    sent[i] = lights.light_sample(light, light.position + 2.0 * d[i]).L[0]


def emitted(folder, port=None, count=1 << 16):
    """Directions in axes of the notes, and the power [W] of each photon, of a tilted lamp of the file's peak."""
    scene = one_ray_scene([lamp(folder, axis=(0.3, -0.2, 1.0)) | ({"port": port} if port else {})], None)
    u = np.random.default_rng(5).random((count, 2))
    made = Lights(scene, "cpu")  # keeps the profiles to which the records point
    d, area, sent = run(emit, [made.at(np.eye(4), np.zeros(3)), u], [wp.vec3, float, float], dim=count)
    return d[:, [0, 2, 1]].astype(float), area.astype(float) * sent, area.astype(float)


def test_photons_per_solid_angle_follow_the_file(tmp_path):
    """Power, and the first and second moments of the directions, against an integral over the second reading."""
    d, power, _ = emitted(tmp_path)
    z = (np.arange(2000) + 0.5) / 2000
    phi = 2 * np.pi * (np.arange(720) + 0.5) / 720
    z, phi = np.meshgrid(z, phi)
    everywhere = np.stack([np.sqrt(1 - z * z) * np.cos(phi), np.sqrt(1 - z * z) * np.sin(phi), z], axis=-1)
    axis = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    across = np.linalg.qr(np.column_stack([axis, np.eye(3)[:, :2]]))[0][:, 1:]
    everywhere = everywhere @ np.column_stack([across, axis]).T
    of_file = towards(everywhere, axis=axis) * 2 * np.pi / z.size
    moments = [np.ones(1), *np.eye(3)]
    tests = []
    for n in range(3):
        for m in range(n, 3):
            moments.append((n, m))
    for moment in moments:

        def value(x, moment=moment):
            if isinstance(moment, tuple):
                return x[..., moment[0]] * x[..., moment[1]]
            return np.ones(x.shape[:-1]) if len(moment) == 1 else x @ moment

        weighted = power * value(d)
        off = weighted.mean() - (of_file * value(everywhere)).sum()
        tests.append(off / (weighted.std() / np.sqrt(len(weighted))))
    assert_plausible(two_sided(np.array(tests)))


@pytest.mark.parametrize("port", [None, {"kind": "flat"}])
def test_no_photon_carries_more_than_the_peak_into_the_whole_cone(tmp_path, port):
    """Weights are bounded, and so are all their moments."""
    _, power, area = emitted(tmp_path, port, 4096)
    gain = 1.0 if port is None else 1.34**2 / np.cos(np.pi / 4)  # at most within the critical angle
    assert power.max() <= gain * area.max()
    assert np.ptp(area) == 0.0


# -------------------------------------------------------------------------------------------------------- what is lit


QUADRANTS = [(0.9, 1.3), (-0.8, 1.1), (-1.2, -0.7), (1.4, -0.9), (0.2, 1.7), (1.6, 0.15)]


@pytest.mark.parametrize("integrator", ["path", "reference"])
@pytest.mark.parametrize("place", QUADRANTS)
def test_a_floor_has_the_irradiance_of_the_file_in_every_quadrant(tmp_path, place, integrator):
    """Without water E = I(theta, phi) cos(theta) / d^2; to 1e-4 of the peak's."""
    scene = one_ray_scene([lamp(tmp_path, (0.1, -0.1, 0.2))], None, direction=(*place, 3.0), pixels=4)
    offset = np.array([*place, 3.0]) - [0.1, -0.1, 0.2]
    d2 = offset @ offset
    scale = 0.3 / np.pi * offset[2] / d2**1.5
    got, stderr = radiance(scene, [floor(3.0, 0.3)], "direct", integrator=integrator, spp=4)
    assert np.all(stderr <= 1e-5 * scale)
    np.testing.assert_allclose(got / scale, towards(offset), atol=1e-4)


@pytest.mark.parametrize(("axis", "up"), [((0.4, 0.3, 1.0), (0, 1, 0)), ((-0.3, 0, 1.0), (1.0, 1.0, 0.3))])
def test_a_tilted_and_turned_lamp_lights_a_floor_as_its_file_says(tmp_path, axis, up):
    scene = one_ray_scene([lamp(tmp_path, (0.1, -0.1, 0.2), axis, up)], None, direction=(0.5, 1.0, 3.0), pixels=4)
    offset = np.array([0.4, 1.1, 2.8])
    scale = 0.3 / np.pi * offset[2] / (offset @ offset) ** 1.5
    got = radiance(scene, [floor(3.0, 0.3)], "direct", spp=4)[0]
    np.testing.assert_allclose(got / scale, towards(offset, axis, up), atol=1e-3)


def scattered_once(T, position, axis):
    """Light of the lamp that is scattered once into the ray along z up to ``T`` in WATER, in 1e5 steps."""
    t = T * (np.arange(100_000) + 0.5) / 100_000
    x = t[:, None] * [0.0, 0.0, 1.0] - position
    d = np.linalg.norm(x, axis=1)
    return T * float((towards(x, axis) * 0.2 * hg(-x[:, 2] / d, 0.8) / d**2 * np.exp(-0.3 * (t + d))).mean())


@pytest.mark.parametrize("integrator", ["path", "reference"])
def test_what_such_a_lamp_scatters_once_is_a_quadrature(tmp_path, integrator):
    position, axis = np.array([-0.5, -0.6, 0.1]), (0.3, -0.2, 1.0)
    spp = 64 if integrator == "path" else 4096
    scene = one_ray_scene([lamp(tmp_path, position, axis)], WATER)
    estimate = radiance(scene, [floor(3.0, 0.0)], "single", integrator=integrator, spp=spp)
    expected = scattered_once(3.0, position, axis)
    assert_agrees(estimate, expected, truth_stderr=1e-3 * expected, precision=0.02)


# -------------------------------------------------------------------------------------------------------- integrators


def wall(x, reflectance=0.8):
    corners = np.array([[x, -5.0, -5.0], [x, 5.0, -5.0], [x, 5.0, 5.0], [x, -5.0, 5.0]])
    return Part("wall", corners, np.array([[0, 2, 1], [0, 3, 2]], np.int32), Diffuse(reflectance=[reflectance] * 3))


@pytest.mark.parametrize("radius_m", [None, 0.3])
def test_paths_and_the_reference_agree_on_light_from_wall_to_wall(tmp_path, radius_m):
    """Virtual point lights and paths, weighted against each other; the wall is lit by the lamp's right lobe."""
    keys = {} if radius_m is None else {"radius_m": radius_m}
    scene = one_ray_scene([lamp(tmp_path, (0, 0, 0.3), (0.1, -0.1, 1), **keys)], None, direction=(-0.1, 0.2, 1))
    parts = [floor(2.0, 0.8), wall(0.7)]
    one = radiance(scene, parts, "multiple", spp=256)
    other = radiance(scene, parts, "multiple", spp=2048, integrator="reference")
    assert_agrees(one, other[0], truth_stderr=other[1])


def box(low, high, reflectance):
    """A closed room."""
    room = trimesh.creation.box(bounds=[low, high])
    return Part(
        "box", np.asarray(room.vertices), np.asarray(room.faces, np.int32), Diffuse(reflectance=[reflectance] * 3)
    )


@pytest.mark.parametrize("port", [None, {"kind": "flat"}])
def test_paths_and_the_reference_agree_in_a_turbid_box(tmp_path, port):
    """A tilted and turned lamp, in air or behind its port."""
    keys = {} if port is None else {"port": port}
    scene = one_ray_scene([lamp(tmp_path, (-0.6, -0.2, -0.3), (0.3, 0.1, 1), (0.5, 1, 0), **keys)], TURBID)
    parts = [box([-1.0, -0.6, -0.8], [1.1, 2.0, 0.9], 0.5)]
    one, other = radiance(scene, parts, spp=128), radiance(scene, parts, spp=2048, integrator="reference")
    assert_agrees(one, other[0], truth_stderr=other[1], precision=0.02)


@pytest.mark.parametrize("layer", ["direct", "single", "multiple"])
def test_paths_and_the_reference_agree_in_coastal_water(tmp_path, layer):
    """Fournier and Forand's phase function, in which the reference mostly falls short of light scattered often."""
    water = {
        "sigma_s": [0.3] * 3,
        "sigma_a": [0.15] * 3,
        "phase": {"kind": "fournier_forand", "backscatter_fraction": 0.0183},
    }
    scene = one_ray_scene([lamp(tmp_path, (-0.5, -0.6, 0.0), (0.2, 0.1, 1.0))], water, direction=(0.05, 0.1, 1))
    ground = [floor(2.0, 0.4)]
    one = radiance(scene, ground, layer, spp=256 if layer == "multiple" else 16)
    other = radiance(scene, ground, layer, spp=4096, integrator="reference")
    if layer == "multiple":
        assert_agrees_with_heavy_tail(other, one[0], one[1], precision=0.1)
    else:
        assert_agrees(other, one[0], truth_stderr=one[1])


def test_such_a_lamp_is_rendered_by_paths_and_the_field_says_why(tmp_path):
    scene = one_ray_scene([lamp(tmp_path)], WATER, pixels=2)
    assert "lobes.ies) changes around its axis" in unavailable(scene)
    with pytest.raises(InputError, match="changes around its axis"):
        radiance(scene, integrator="field", spp=1)


@pytest.mark.gpu
def test_a_gpu_lights_as_a_cpu_does(tmp_path):
    scene = one_ray_scene([lamp(tmp_path, (-0.6, -0.2, -0.3), (0.3, 0.1, 1))], TURBID)
    cpu, gpu = (radiance(scene, [floor(2.0, 0.5)], device=device, spp=128) for device in ("cpu", "cuda:0"))
    assert_agrees(gpu, cpu[0], truth_stderr=cpu[1], precision=0.02)
