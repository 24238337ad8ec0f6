"""Places in a pixel: even on average by their weights, and dense where a light is seen."""

import numpy as np
import pytest
import warp as wp
from chance import rng_array, run

from varos_warp.kernels.transport.pixel import sample_pixel
from varos_warp.kernels.world.camera import Camera, camera_ray, image_point
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.lights.record import Light

COUNT = 1 << 18
ROW, COL = 5, 7


@wp.kernel
def sample_places(scene: SceneData, camera: Camera, u: wp.array(dtype=wp.vec4), places: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    point = sample_pixel(scene, camera, ROW, COL, u[i])
    places[i] = wp.vec3(point.x, point.y, point.weight)


@wp.kernel
def image_again(
    camera: Camera, at: wp.array(dtype=wp.vec2), lens: wp.array(dtype=wp.vec2), t: float, found: wp.array(dtype=wp.vec3)
):
    i = wp.tid()
    ray = camera_ray(camera, at[i][0], at[i][1], lens[i])
    found[i] = image_point(camera, ray.o + t * ray.d, lens[i])


def camera_of(aperture=0.0):
    camera = Camera()
    camera.right, camera.down, camera.forward = wp.vec3(1, 0, 0), wp.vec3(0, 1, 0), wp.vec3(0, 0, 1)
    camera.position = wp.vec3(0.3, -0.2, 0.1)
    camera.fx, camera.fy, camera.cx, camera.cy = 20.0, 21.0, 8.0, 6.0
    camera.aperture, camera.focus = aperture, 2.0
    return camera


def lights_at(camera, *places, depth=3.0):
    """A scene of lights that a pinhole sees at these image points (x, y)."""
    lights = []
    for x, y in places:
        light = Light()
        light.position = camera.position + depth * wp.vec3(
            (x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0
        )
        lights.append(light)
    scene = SceneData()
    scene.lights = wp.array(lights, dtype=Light, device="cpu")
    return scene


def places_of(scene, camera):
    return run(sample_places, [scene, camera, rng_array(3, (COUNT, 4))], [wp.vec3]).astype(float)


def inverse_distance(at):
    """Integral of 1 / r over the pixel, r from an image point: a closed form of its corners."""

    def corner(x, y):
        return (x * np.arcsinh(y / abs(x)) if x else 0.0) + (y * np.arcsinh(x / abs(y)) if y else 0.0)

    x0, y0 = COL - at[0], ROW - at[1]
    return corner(x0 + 1, y0 + 1) - corner(x0, y0 + 1) - corner(x0 + 1, y0) + corner(x0, y0)


SEEN = {
    "within": (7.3, 5.8),
    "on the edge": (7.0, 5.5),
    "on a corner": (8.0, 6.0),
    "in the neighbour": (8.001, 5.4),
    "half a pixel off": (8.5, 5.2),
    "far off": (30.0, 5.5),
}


@pytest.mark.parametrize("seen", SEEN)
def test_weighted_places_are_even_and_find_what_a_light_scatters(seen):
    camera = camera_of()
    x, y, weight = places_of(lights_at(camera, SEEN[seen]), camera).T
    assert ((x >= COL) & (x <= COL + 1) & (y >= ROW) & (y <= ROW + 1)).all()
    inverse = weight / np.hypot(x - SEEN[seen][0], y - SEEN[seen][1])
    for values, expected in (
        (weight, 1.0),
        (weight * x, COL + 0.5),
        (weight * x * y, (COL + 0.5) * (ROW + 0.5)),
        (inverse, inverse_distance(SEEN[seen])),
    ):
        assert abs(values.mean() - expected) < 4 * values.std() / np.sqrt(COUNT) + 1e-6 * expected


@pytest.mark.parametrize("seen", ["within", "on a corner"])
def test_no_sample_of_a_light_that_is_seen_rules(seen):
    """Of as many even samples of 1/r the largest has a tenth of the sum of squares: their tail is an inverse square."""
    camera, at = camera_of(), SEEN[seen]
    x, y, weight = places_of(lights_at(camera, at), camera).T
    inverse = weight / np.hypot(x - at[0], y - at[1])
    assert inverse.max() < 2.0 * inverse.mean()
    assert inverse.std() < 0.4 * inverse.mean()


def test_lights_side_by_side_are_found_by_one_mixture():
    camera, pair = camera_of(), ((7.3, 5.8), (7.4, 5.3))
    x, y, weight = places_of(lights_at(camera, *pair), camera).T
    assert weight.max() <= 8.0 + 1e-5  # the even share
    inverse = weight * sum(1.0 / np.hypot(x - at[0], y - at[1]) for at in pair)
    expected = sum(map(inverse_distance, pair))
    assert abs(inverse.mean() - expected) < 4 * inverse.std() / np.sqrt(COUNT)
    assert inverse.max() < 3.0 * inverse.mean()


@pytest.mark.parametrize("depth", [-3.0, 0.0, -1e-7])
def test_a_light_behind_the_camera_or_at_it_changes_nothing(depth):
    camera = camera_of()
    places = places_of(lights_at(camera, SEEN["within"], depth=depth), camera)
    assert (places[:, 2] == 1.0).all()
    assert np.isfinite(places).all()


def test_a_light_out_of_focus_is_found_from_each_point_of_the_lens():
    """Its image moves with the point of the lens: here by up to 2 pixels, so it is beside for some only."""
    camera = camera_of(aperture=0.4)
    x, y, weight = places_of(lights_at(camera, SEEN["within"], depth=4.0), camera).T
    assert (weight == 1.0).any()
    assert (weight != 1.0).any()
    for values, expected in ((weight, 1.0), (weight * x, COL + 0.5), (weight * y, ROW + 0.5)):
        assert abs(values.mean() - expected) < 4 * values.std() / np.sqrt(COUNT)


@pytest.mark.parametrize("aperture", [0.0, 0.05])
def test_image_points_are_the_inverse_of_rays_of_every_point_of_the_lens(aperture):
    rng = np.random.default_rng(5)
    at, lens = rng.uniform(0, 16, (500, 2)), rng.random((500, 2))
    found = run(image_again, [camera_of(aperture), at, lens, 3.7], [wp.vec3])
    # float32 rounding of coordinates of metres, in pixels of 1/20 m at one metre
    np.testing.assert_allclose(found[:, :2], at, atol=2e-5)
    assert (found[:, 2] > 0).all()
