"""Tables along a camera's rays of lamps that are disks: as right as those of points, or there are none."""

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from physics.rig import one_ray_scene, spot

from varos_warp.device.launcher import Launcher
from varos_warp.render.field import along_camera
from varos_warp.render.field.open_water import OpenWater
from varos_warp.scene.lights import records

WATER = {"sigma_s": [0.2] * 3, "sigma_a": [0.1] * 3, "phase": {"g": 0.8}}
VIEW = {"resolution": (64, 36), "sensor_mm": (4.416, 2.484), "focal_mm": 3.4}


def dense_nodes():
    """Points of the unit disk: Gauss and Legendre's in the square of the radius, even ones around it."""
    square, weight = leggauss(4)
    angle = 2.0 * np.pi * (np.arange(12) + 0.5) / 12
    return np.array(
        [
            (np.sqrt(0.5 * (s + 1.0)) * np.cos(t), np.sqrt(0.5 * (s + 1.0)) * np.sin(t), w / 24.0)
            for s, w in zip(square, weight, strict=True)
            for t in angle
        ]
    )


def polynomial_means(nodes):
    x, y, weight = nodes.T
    return [float(weight @ (x**a * y**b)) for a in range(6) for b in range(6 - a)]


def test_the_points_of_a_disk_have_its_means_up_to_degree_five():
    assert polynomial_means(records.DISK_NODES) == pytest.approx(polynomial_means(dense_nodes()), abs=1e-12)
    assert (records.DISK_NODES[:, 2] @ np.square(records.DISK_NODES[:, :2])) == pytest.approx(0.25)


@pytest.mark.parametrize("name", ["SINGLE", "MULTIPLE"])
@pytest.mark.parametrize(
    "lamp",
    [
        spot((-0.15, 0, -0.1), blend=1.0),
        spot((0.3, 0, 0.1), axis=(-0.5, 0, 1), cone_deg=100.0, blend=0.3),
    ],
    ids=["paper", "tilted"],
)
def test_few_points_of_a_disk_are_as_right_as_many(few_nodes, name, lamp, monkeypatch):
    """At the largest radius that has tables; fewer nodes than of images, at the same places of the rays.

    Both are of the same field, which need not be right to more than a hundredth; disks of twice the radius exceed what
    is accepted three times with all of its nodes and with few.
    """
    lamp = lamp | {"radius_m": 0.999 * along_camera.LARGEST_DISK * np.linalg.norm(lamp["position"])}
    scene = one_ray_scene([lamp], WATER, pixels=2)
    view = scene.vehicle.cameras[0].model_copy(update=VIEW)
    water, nodes = OpenWater(scene, Launcher("cpu", 1)), getattr(along_camera, name)._replace(counts=(24, 10, 17))
    monkeypatch.setattr(along_camera, "_is_right", lambda *_: True)  # of so few nodes
    few = water._tabulated(along_camera.as_pinhole(view)[0], nodes)
    monkeypatch.setattr(records, "DISK_NODES", dense_nodes())
    many = water._tabulated(along_camera.as_pinhole(view)[0], nodes)
    scale = np.sqrt(np.mean(many**2))
    assert np.sqrt(np.mean((few - many) ** 2)) < along_camera.MOST_ERROR * scale
    assert np.abs(few - many).max() < along_camera.MOST_ERROR_AT_A_POINT * scale
