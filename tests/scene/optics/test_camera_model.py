"""Cameras behind ports: image points to rays and back, and scene files that cannot be."""

import cv2
import numpy as np
import pytest
from scipy.optimize import brentq

from varos_warp.errors import InputError
from varos_warp.scene.description.optics import resized, twin
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.file.load import scene_from_dict, scene_to_dict
from varos_warp.scene.optics.camera import camera_model, pixel_centres
from varos_warp.scene.optics.seawater import seawater_index

PORTS = {
    "none": None,
    "flat": {"kind": "flat", "distance_m": 0.02, "thickness_m": 0.008, "n_glass": 1.49},
    "tilted": {"kind": "flat", "distance_m": 0.05, "thickness_m": 0.01, "n_glass": 1.52, "normal": [0.3, -0.2, 2.0]},
    "dome": {"kind": "dome", "radius_m": 0.05, "thickness_m": 0.007, "n_glass": 1.473},
    "decentred": {"kind": "dome", "radius_m": 0.05, "thickness_m": 0.007, "centre": [0.0042, -0.0037, 0.0284]},
    "near the wall": {"kind": "dome", "radius_m": 0.05, "thickness_m": 0.007, "centre": [0.0, 0.0, -0.0425]},
}
LENSES = {
    "pinhole": None,
    "barrel": {"model": "brown_conrady", "k": [-0.25, 0.06, 0.001, -0.002, 0.0]},
    "rational": {"model": "rational", "k": [4.1, 2.7, 0.0001, -0.0002, 0.1, 4.5, 4.0, 0.9]},
    "fisheye": {"model": "kannala_brandt", "k": [-0.02, 0.003, -0.001, 0.0002]},
    "sphere": {"model": "double_sphere", "xi": -0.2, "alpha": 0.59},
}
DOUBLE = LENSES["sphere"]
MEASURED = {"fx": 985.5, "fy": 984.5, "cx": 651.0, "cy": 340.25}


def model_of(port, lens, n_water=(1.339, 1.342, 1.347), **more):
    return camera_model(
        Camera(port=PORTS[port], distortion=LENSES[lens], n_water=n_water if PORTS[port] else None, **more)
    )


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("port", PORTS)
def test_every_point_of_a_ray_is_seen_where_the_ray_is_from(port, lens):
    """To 1e-9 px, from the outside of the port to 100 m away, for every channel."""
    model, rng = model_of(port, lens), np.random.default_rng(2)
    image = rng.uniform(0.0, 1.0, (300, 2)) * [1280, 720]
    for channel in range(3):
        ray = model.rays(image, channel)
        t = 10.0 ** rng.uniform(-3, 2, (300, 1))
        np.testing.assert_allclose(model.project(ray.origin + t * ray.direction, channel), image, atol=1e-9, rtol=0)


@pytest.mark.parametrize(
    "keys",
    [
        {"distortion": {"model": "brown_conrady", "k": [-0.9, 0.2, 0.004, -0.003, 0.0]}},
        {"distortion": {"model": "kannala_brandt", "k": [-0.3, 0.0, 0.0, 0.0]}, "intrinsics": MEASURED | {"fx": 700.0}},
        {
            "distortion": {"model": "double_sphere", "xi": -0.3, "alpha": 0.95},
            "port": PORTS["decentred"],
            "focal_mm": 1.6,
        },
        {
            "distortion": {"model": "rational", "k": [-0.9, -0.3, 0.004, -0.003, 0, 0.2, 0.1, 0.3]},
            "port": PORTS["tilted"],
        },
    ],
)
def test_the_whole_image_of_a_lens_that_ends_within_it_comes_back(keys):
    """Every pixel's centre, to 1e-9 px; where it sees nothing, it is not the image of anything."""
    model = camera_model(resized(Camera(**keys), 320, 180))
    image = pixel_centres(320, 180)
    ray = model.rays(image)
    seen = ray.weight > 0.0
    assert 0.02 < 1.0 - seen.mean() < 0.9
    np.testing.assert_array_equal(seen, np.isfinite(ray.direction).all(-1))
    back = model.project(ray.origin + 2.0 * ray.direction)
    np.testing.assert_allclose(back[seen], image[seen], atol=1e-9, rtol=0)
    d = np.random.default_rng(5).normal(size=(20_000, 3))
    at = model.project(3.0 * d / np.linalg.norm(d, axis=-1, keepdims=True))
    inside = ((at >= 0.0) & (at <= [320, 180])).all(-1)
    assert inside.sum() > 500
    assert (model.rays(at[inside]).weight > 0.0).all()


def test_points_before_the_glass_are_not_seen():
    assert np.isnan(model_of("flat", "pinhole").project([[0.0, 0.0, 0.0279], [0.1, 0.0, -1.0]])).all()
    assert np.isnan(model_of("dome", "pinhole").project([[0.0, 0.0, 0.049]])).all()
    assert np.isfinite(model_of("flat", "pinhole").project([0.0, 0.0, 0.0281])).all()


def test_colours_part_at_the_edge_of_the_image():
    """450 and 600 nm are 4.6 px apart at 33 degrees of the paper's camera behind flat glass, 35 per mille, 10 C."""
    index = {"temperature_C": 10.0, "salinity": 35.0}
    model = camera_model(Camera(port={"kind": "flat", "distance_m": 1e-6}, n_water=index))
    assert model.n_water == tuple(seawater_index(10.0, 35.0, nm) for nm in (600.0, 550.0, 450.0))
    edge = np.array([640.0 + model.K[0, 0] * np.tan(np.radians(33.0)), 360.0])
    ray = model.rays(edge, 0)
    far = ray.origin + 1e6 * ray.direction
    assert model.project(far, 2)[0] - model.project(far, 0)[0] == pytest.approx(4.6, abs=0.05)


def test_radiance_falls_by_the_square_of_the_index_and_by_reflection():
    weight = model_of("flat", "pinhole", 1.34).rays(np.array([640.0, 360.0])).weight
    assert weight == pytest.approx(4 * 1.49 / 2.49**2 * 4 * 1.49 * 1.34 / 2.83**2 / 1.34**2, rel=1e-12)


def test_a_pane_seen_edge_on_shows_nothing_there():
    """A fisheye of 195 degrees behind a flat port: beyond 90 degrees to the pane there is no water to see."""
    view = Camera(port=PORTS["tilted"], distortion={"model": "kannala_brandt"}, focal_mm=1.3, resolution=[64, 36])
    ray = camera_model(view).rays(np.array([[0.5, 18.0], [32.0, 18.0]]))
    assert np.isnan(ray.origin[0]).all()
    assert ray.weight[0] == 0.0
    assert ray.weight[1] > 0.5


def test_opencv_projects_to_the_same_pixels():
    """Through K_opencv, in which the centre of the top left pixel is (0, 0)."""
    model = model_of("none", "barrel")
    points = np.random.default_rng(3).uniform([-1, -0.6, 2], [1, 0.6, 4], (200, 3))
    K_opencv = model.K - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K_opencv, np.array(model.lens.k))[0][:, 0]
    np.testing.assert_allclose(model.project(points) - 0.5, expected, atol=1e-9, rtol=0)


def test_measured_intrinsics_are_opencvs():
    """Its projection of points, with the principal point aside, from the centre of the top left pixel."""
    model = model_of("none", "barrel", intrinsics=MEASURED)
    points = np.random.default_rng(3).uniform([-1, -0.6, 2], [1, 0.6, 4], (200, 3))
    K = np.array([[985.5, 0.0, 651.0], [0.0, 984.5, 340.25], [0.0, 0.0, 1.0]])
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array(model.lens.k))[0][:, 0]
    np.testing.assert_allclose(model.project(points) - 0.5, expected, atol=1e-9, rtol=0)


def test_the_field_of_view_of_a_camera_aside_is_the_sum_of_both_sides():
    across, down = model_of("none", "pinhole", intrinsics=MEASURED).field_of_view(1280, 720)
    assert across == pytest.approx(np.arctan(651.5 / 985.5) + np.arctan((1280 - 651.5) / 985.5), rel=1e-12)
    assert down == pytest.approx(np.arctan(340.75 / 984.5) + np.arctan((720 - 340.75) / 984.5), rel=1e-12)


def test_the_field_of_view_of_a_part_of_an_image_is_a_difference():
    """Its principal point lies to the left of it."""
    across, _ = model_of("none", "pinhole", intrinsics=MEASURED | {"cx": -200.5}).field_of_view(1280, 720)
    assert across == pytest.approx(np.arctan(1480 / 985.5) - np.arctan(200 / 985.5), rel=1e-12)


def test_a_polynomial_falls_from_the_principal_point_in_half_diagonals_of_the_image():
    view = {"vignetting": {"kind": "polynomial", "coefficients": [-0.3, 0.05]}}
    corner = np.array([1280.0, 0.0])
    r2 = ((1280 - 651.5) ** 2 + 340.75**2) / (640**2 + 360**2)
    aside, centred = camera_model(Camera(intrinsics=MEASURED, **view)), camera_model(Camera(**view))
    assert aside.vignette(corner) == pytest.approx(1.0 - 0.3 * r2 + 0.05 * r2**2, rel=1e-12)
    assert centred.vignette(corner) == pytest.approx(0.75, rel=1e-15)


def test_a_camera_in_other_pixels_sees_the_same():
    """Also where its principal point is aside; to rounding."""
    whole = Camera(intrinsics=MEASURED, distortion=LENSES["barrel"])
    small = resized(whole, 320, 90)
    at = np.random.default_rng(4).uniform(size=(100, 2))
    expected = camera_model(whole).rays(at * [1280, 720]).direction
    np.testing.assert_allclose(camera_model(small).rays(at * [320, 90]).direction, expected, atol=1e-13)
    assert resized(Camera(), 320, 90) == Camera(resolution=(320, 90))


@pytest.mark.parametrize("keys", [{}, {"intrinsics": MEASURED}])
@pytest.mark.parametrize("lens", LENSES)
def test_the_twin_shows_the_middle_as_large(lens, keys):
    """As a pinhole of the same principal point, whose focal length a double sphere counts in its own way."""
    view = Camera(distortion=LENSES[lens], **keys)
    model, pinhole = camera_model(view), camera_model(twin(view))
    assert pinhole.is_pinhole
    np.testing.assert_array_equal(pinhole.K[:2, 2], model.K[:2, 2])
    point = np.array([1e-4, 1e-4, 1.0])
    np.testing.assert_allclose(pinhole.project(point), model.project(point), atol=2e-4)


def test_a_pixel_is_smaller_in_water_behind_a_pane_and_as_large_behind_a_centred_dome():
    """What textures and their filters go by: to the square of half a pixel's angle."""
    f = model_of("none", "pinhole").K[0, 0]
    assert model_of("none", "pinhole").pixel_angle == 1.0 / f
    assert model_of("flat", "pinhole", 1.34).pixel_angle == pytest.approx(1.0 / (1.34 * f), rel=1e-6)
    assert model_of("dome", "pinhole", 1.34).pixel_angle == pytest.approx(1.0 / f, rel=1e-6)


def test_the_field_of_view_is_that_in_the_water():
    """By Snell's law 66 degrees of the paper's camera become 48.23, and 40.13 in height become 28.53."""
    view = Camera(port={"kind": "flat", "distance_m": 0.05}, n_water=1.333)
    across, down = camera_model(view).field_of_view(*view.resolution)
    expected = [2.0 * np.arcsin(np.sin(np.arctan(half / 3.4)) / 1.333) for half in (2.208, 1.242)]
    np.testing.assert_allclose([across, down], expected, rtol=1e-12)
    fisheye = camera_model(Camera(port=view.port, n_water=1.333, distortion={"model": "kannala_brandt"}, focal_mm=1.3))
    assert fisheye.field_of_view(1280, 720)[0] == pytest.approx(2.0 * np.arcsin(1.0 / 1.333), abs=1e-3)


def test_a_pane_of_a_size_is_seen_through_within_it():
    """Clear to 30 mm of the outer face 28 mm before the lens: by the angle in air whose ray leaves there."""
    model = camera_model(Camera(port=PORTS["flat"] | {"clear_radius_m": 0.03}, focal_mm=1.0, n_water=1.34))

    def reach(angle):
        return 0.02 * np.tan(angle) + 0.008 * np.tan(np.arcsin(np.sin(angle) / 1.49))

    limit = brentq(lambda angle: reach(angle) - 0.03, 0.1, 1.5)
    f = model.K[0, 0]
    image = np.array([640.0 + f * np.tan(limit) * np.array([0.999, 1.001, -0.999, -1.001]), [360.0] * 4]).T
    inside = np.array([True, False, True, False])
    rays = model.rays(image)
    assert np.array_equal(rays.weight > 0.0, inside)
    assert np.array_equal(np.isfinite(rays.direction).all(-1), inside)
    wide = camera_model(Camera(port=PORTS["flat"], focal_mm=1.0, n_water=1.34))
    ray = wide.rays(image)
    seen = model.project(ray.origin + 2.0 * ray.direction)
    np.testing.assert_allclose(seen[inside], image[inside], atol=1e-9, rtol=0)
    assert np.isnan(seen[~inside]).all()


def test_half_a_sphere_ends_at_90_degrees_of_its_centre():
    """Of a dome around the lens rays are straight, so that its rim is a direction; of a fisheye of 195 degrees."""
    keys = {"focal_mm": 1.3, "distortion": {"model": "kannala_brandt"}}
    model = camera_model(Camera(port=PORTS["dome"] | {"half_angle_deg": 90.0}, **keys))
    angle = np.radians([-93.0, -90.1, -89.9, 0.0, 89.9, 90.1])
    image = np.stack([640.0 + model.K[0, 0] * angle, np.full(6, 360.0)], -1)
    inside = np.abs(angle) < np.pi / 2
    assert np.array_equal(model.rays(image).weight > 0.0, inside)
    points = np.stack([np.sin(angle), 0.0 * angle, np.cos(angle)], -1)
    assert np.array_equal(np.isfinite(model.project(points)).all(-1), inside)
    whole = camera_model(Camera(port=PORTS["dome"], **keys))
    np.testing.assert_array_equal(model.project(points)[inside], whole.project(points)[inside])


BAD = {
    "port.clear_radius_m: the rim": {
        "port": {"kind": "flat", "distance_m": 0.02, "normal": [1, 0, 1], "clear_radius_m": 0.01}
    },
    "port.half_angle_deg: the rim of the port hides": {
        "port": {"kind": "dome", "radius_m": 0.05, "half_angle_deg": 1e-6}
    },
    "port.half_angle_deg: the rim": {
        "port": {"kind": "dome", "radius_m": 0.05, "centre": [0.03, 0, 0], "half_angle_deg": 30}
    },
    "n_water has no effect without a port": {"n_water": 1.34},
    "distortion: not even the middle of the image": {
        "distortion": {"model": "brown_conrady", "k": [-1e6, 0.0, 0.0, 0.0, 0.0]}
    },
    "distortion: not even the middle": {
        "focal_mm": 1.6,
        "distortion": {"model": "kannala_brandt", "k": [-1e6, 0.0, 0.0, 0.0]},
    },
    "no depth of field": {"f_stop": 1.7, "distortion": {"model": "kannala_brandt"}},
    "f_stop: a fisheye (distortion double_sphere)": {"f_stop": 1.7, "distortion": DOUBLE},
    "vignetting.kind: cos4 is not the law of a fisheye (distortion double_sphere)": {
        "vignetting": {},
        "distortion": DOUBLE,
    },
    "vignetting.coefficients: between the centre": {  # -0.5 r^2 reaches 0 before the far corner, whose r^2 is 2.25
        "vignetting": {"kind": "polynomial", "coefficients": [-0.5]},
        "intrinsics": MEASURED | {"cx": 319.5, "cy": 179.5},
    },
    "sensor_mm: stands beside intrinsics": {"intrinsics": MEASURED, "sensor_mm": [4.416, 2.484]},
    "focal_mm: stands beside intrinsics": {"intrinsics": MEASURED, "focal_mm": 3.4},
    "f_stop: beside intrinsics, in pixels, it needs focal_mm": {"intrinsics": MEASURED, "f_stop": 1.7},
    "port.thickness_m must be less": {"port": {"kind": "dome", "radius_m": 0.05, "thickness_m": 0.05}},
    "does not lie within the dome": {"port": {"kind": "dome", "radius_m": 0.05, "centre": [0.0, 0.0, 0.05]}},
    "of radius 0.034 m": {"focal_mm": 68.0, "f_stop": 1.0, "port": {"kind": "dome", "radius_m": 0.034}},
    "port.normal must point forwards": {"port": {"kind": "flat", "distance_m": 0.02, "normal": [0.0, 1.0, 0.0]}},
    "cos4 is not the law of a fisheye": {"vignetting": {}, "distortion": {"model": "kannala_brandt"}},
    "vignetting.coefficients: between": {"vignetting": {"kind": "polynomial", "coefficients": [-1.01]}},
    "vignetting.coefficients": {"vignetting": {"kind": "polynomial", "coefficients": [1e308, 1e308, -1e308, -1e308]}},
    "the glass cuts the lens": {"f_stop": 1.0, "port": {"kind": "flat", "distance_m": 1e-3, "normal": [1.0, 0.0, 0.5]}},
}


def scene_with(camera):
    return scene_from_dict({"vehicle": {"cameras": [camera]}, "trajectory": {"poses": [{"position": [0, 0, 0]}]}})


@pytest.mark.parametrize("problem", BAD)
def test_what_does_not_fit_together_is_one_clear_message(problem):
    with pytest.raises(InputError) as error:
        scene_with(BAD[problem])
    assert problem in str(error.value)
    assert str(error.value).startswith("vehicle.cameras.0")
    assert "more problem" not in str(error.value)


@pytest.mark.parametrize(
    ("keys", "key"),
    [
        ({"port": {"kind": "flat"}}, "port.distance_m"),
        ({"port": {"kind": "flat", "distance_m": 0.02}, "n_water": 0.9}, "n_water"),
        ({"port": {"kind": "flat", "distance_m": 0.02}, "n_water": {"salinity": 35}}, "n_water.temperature_C"),
        ({"distortion": {"model": "brown_conrady", "k": [0.1]}}, "distortion.k"),
        ({"vignetting": {"kind": "polynomial"}}, "vignetting"),
        ({"port": {"kind": "flat", "distance_m": 0.02, "clear_radius_m": 0.0}}, "port.clear_radius_m"),
        ({"port": {"kind": "dome", "radius_m": 0.05, "half_angle_deg": 181}}, "port.half_angle_deg"),
        ({"vignetting": {"kind": "cos3"}}, "vignetting.kind"),
    ],
)
def test_bad_values_are_named_by_their_key(keys, key):
    with pytest.raises(InputError) as error:
        scene_with(keys)
    assert str(error.value).startswith(f"vehicle.cameras.0.{key}")


def test_a_pinhole_is_written_down_as_before_there_were_ports():
    later = {"port", "n_water", "distortion", "vignetting", "intrinsics", "calibration"}
    assert not later & set(Camera().model_dump(mode="json"))
    for port in ("flat", "dome"):
        written = Camera(port=PORTS[port]).model_dump(mode="json")["port"]
        assert not {"clear_radius_m", "half_angle_deg"} & set(written)


def test_the_blocks_survive_being_written_down():
    scene = scene_with(
        {
            "port": PORTS["decentred"],
            "distortion": LENSES["barrel"],
            "n_water": {"temperature_C": 4.0, "salinity": 35.0},
            "vignetting": {"kind": "polynomial", "coefficients": [-0.3, 0.05]},
        }
    )
    assert scene_from_dict(scene_to_dict(scene)) == scene
    for lens in LENSES.values():
        scene = scene_with({"distortion": lens, "intrinsics": MEASURED})
        assert scene_from_dict(scene_to_dict(scene)) == scene
    scene = scene_with({"distortion": LENSES["barrel"], "intrinsics": MEASURED, "f_stop": 2.0, "focal_mm": 4.0})
    assert scene_from_dict(scene_to_dict(scene)) == scene
