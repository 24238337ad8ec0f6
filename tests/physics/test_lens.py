"""Images of plates whose every pixel is known: distance, direction, and the blur of an edge out of focus."""

import numpy as np
import pytest
from scipy.integrate import quad

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.frames import intrinsics
from varos_warp.scene.geometry.parts import Part

pytestmark = pytest.mark.subject("camera")


def rectangle(corner, u, v, reflectance, name):
    corners = np.array(corner, float) + np.array([[0, 0, 0], u, np.add(u, v), v], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Part(name, corners, faces, Diffuse(reflectance=(reflectance,) * 3))


FAR_LAMP = {"kind": "point", "position": [0, -2000, 0], "intensity": [np.pi * 2000.0**2] * 3}
"""Lights a white plate across its light to radiance 1, but for its own distance."""


def scene_of(**view):
    """A camera at the origin that looks along +y of the vehicle and the world: x right, z up."""
    return Scene(
        water="none", vehicle={"cameras": [view], "lights": [FAR_LAMP]}, trajectory={"poses": [{"position": [0, 0, 0]}]}
    )


@pytest.mark.parametrize("slope", [0.0, 0.5, 2.0])
def test_depth_of_a_slanted_plane_is_where_its_equation_says(truth, slope):
    """The plane y = 3 + slope x through the ray of each pixel's centre (sensor and focal length of the paper)."""
    view = {"resolution": [64, 36], "sensor_mm": [4.416, 2.484], "focal_mm": 3.4}
    plane = rectangle((-1.2, 3 - 1.2 * slope, -50), (9, 9 * slope, 0), (0, 0, 100), 0.5, "plane")
    made = FrameRenderer(scene_of(**view), "cpu", parts=[plane]).render(np.eye(4), outputs="D").D
    sizes = ((64, 4.416), (36, 2.484))
    across, down = np.meshgrid(*((np.arange(n) + 0.5 - n / 2) * size / n / 3.4 for n, size in sizes))
    with np.errstate(divide="ignore"):
        depth = 3.0 / (1.0 - slope * across)
    seen = (depth > 0) & (depth * across > -1.2) & (depth * across < 7.8)
    assert np.array_equal(np.isfinite(made.depth), seen)
    assert seen.mean() > 0.3
    # the ray's rounding moves the hit along the plane: over the cosine of its slant
    rounding = 1e-6 * depth / (1.0 - slope * across) * np.hypot(1.0, slope)
    reason = "float32 rounding over the cosine of the slant"
    truth(
        f"planar depth [m] of all pixels, slope {slope}",
        source="3/(1 - slope x/f)",
        expected=depth[seen],
        got=made.depth[seen],
        tolerance=rounding[seen],
        reason=reason,
    )
    length = np.sqrt(1.0 + across**2 + down**2)
    truth(
        f"range [m] of all pixels, slope {slope}",
        source="3/(1 - slope x/f) sqrt(1 + (x/f)^2 + (y/f)^2)",
        expected=(depth * length)[seen],
        got=made.range[seen],
        tolerance=(rounding * length)[seen],
        reason=reason,
    )


def edge_spread(x):
    """Share of the unit disk on one side of a line at ``x``."""
    x = np.clip(x, -1.0, 1.0)
    return (np.arccos(-x) + x * np.sqrt(1.0 - x * x)) / np.pi


@pytest.mark.parametrize(("distance", "focus"), [(1.0, 3.0), (8.0, 3.0), (2.0, 2.0)])
def test_an_edge_out_of_focus_is_as_soft_as_the_circle_of_confusion_is_large(truth, distance, focus):
    """White beside black in even light: a disk of radius A |1 - s/F| in the plane, over the pixel's box.

    All pixels of a column have the same radiance, and 64 of them tell its error by how they differ. The image's own
    standard errors do not: they are means over 7 x 7 pixels, which is more than the edge is wide.
    """
    view = {"resolution": [48, 64], "sensor_mm": [4.8, 6.4], "focal_mm": 40.0, "f_stop": 1.4, "focus_m": focus}
    scene = scene_of(**view)
    white = rectangle((0.0, distance, -9), (9, 0, 0), (0, 0, 18), 1.0, "white")
    black = rectangle((-9, distance, -9), (9, 0, 0), (0, 0, 18), 0.0, "black")
    how = {"outputs": "A", "spp": 256, "layers": ("direct",), "seed": 5}
    image = FrameRenderer(scene, "cpu", parts=[white, black]).render(np.eye(4), **how).A
    radius = 0.5 * 0.040 / 1.4 * abs(1.0 - distance / focus)
    pixel = distance / intrinsics(scene.vehicle.cameras[0])[0, 0]
    left = (np.arange(48) - 24) * pixel
    if radius == 0.0:
        expected = (left >= 0.0).astype(float)
    else:
        expected = np.array([quad(lambda x: edge_spread(x / radius), a, a + pixel)[0] / pixel for a in left])
    expected *= (2000.0 / (2000.0 + distance)) ** 2
    pixels = image.radiance[..., 0].astype(float)
    got, stderr = pixels.mean(axis=0), pixels.std(axis=0, ddof=1) / np.sqrt(len(pixels))
    assert ((got > 0.05) & (got < 0.95)).sum() == ((expected > 0.05) & (expected < 0.95)).sum()
    truth(
        f"columns of pixels across the edge, {distance} m away, focus at {focus} m, f/1.4, 40 mm",
        source="thin lens: disk of A |1 - s/F|, over the pixel",
        expected=expected,
        got=got,
        stderr=stderr,
        tolerance=3e-5,
        reason="float32 rounding, slant of the light",
    )
