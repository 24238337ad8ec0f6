"""What is left out because it hardly reaches the image: nothing that is seen, and no more light than is stated."""

import numpy as np
import pytest

from varos_warp.render.frame import FrameRenderer
from varos_warp.render.plan import plan_render, planned_renderer
from varos_warp.render.reach import NEAREST_M, _peak, without_hidden
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.frames import look_at_matrix, transform
from varos_warp.scene.geometry import Part
from varos_warp.scene.procedural import generate_terrain
from varos_warp.scene.water.phase.fournier_forand import FournierForand
from varos_warp.scene.water.phase.henyey_greenstein import HenyeyGreenstein
from varos_warp.scene.water.phase.rayleigh import Rayleigh

VIEW = {"resolution": [64, 36], "sensor_mm": [4.416, 2.484], "focal_mm": 3.4}
LAMP = {"kind": "spot", "position": [0.15, -0.1, 0.0], "cone_deg": 65}
POSES = [transform(look_at_matrix((x, 0.0, 2.0), (x, 6.0, 0.0)), (x, 0.0, 2.0)) for x in (-1.0, 1.0)]
WATER = {"sigma_s": [0.02] * 3, "sigma_a": [0.05] * 3, "phase": {"g": 0.8}}


def make_scene(lights=(LAMP,), **render):
    """Without B, whose light reaches everywhere."""
    return Scene(water={"coefficients": WATER}, vehicle={"lights": list(lights), "cameras": [VIEW]},
                 trajectory={"poses": [{"position": [0, 0, 0]}]},
                 render={"denoise": "none", "integrator": "path", "outputs": ["A", "C", "D"]} | render)


@pytest.fixture(scope="module")
def survey():
    """A map of 800 m, seen from its middle, with hills of 10 m."""
    points, faces = generate_terrain(800.0, 257, 10.0, seed=4)
    points = points - [0.0, 0.0, points[np.abs(points[:, :2]).max(axis=1) < 10, 2].mean()]
    return Part("terrain", points, faces, Diffuse(reflectance=[0.5] * 3))


def test_a_plan_leaves_out_most_of_a_large_map_and_the_images_stay(survey):
    """C and D to the last bit; A with the same random numbers within what is stated.

    It is stated from few samples, none of which may have met what is left out. What is lost beyond that is less than
    the rounding of pixels: half a digit of each in both images.
    """
    scene = make_scene(tolerance=0.05)
    whole = FrameRenderer(scene, "cpu", parts=[survey])
    plan = plan_render(scene, whole, POSES)
    assert not plan.hidden
    stated = {d.what: d.error for d in plan.decisions}["triangles"]
    less = planned_renderer(whole, plan.to_dict(), POSES)
    assert len(less.parts[0].faces) < 0.7 * len(survey.faces)
    for pose in POSES:
        one, two = (renderer.render(pose, outputs="ACD", spp=64) for renderer in (whole, less))
        assert np.array_equal(one.C.normal, two.C.normal)
        assert np.array_equal(one.D.depth, two.D.depth)
        full, missing = (frame.A.radiance.astype(float).mean((0, 1)) for frame in (one, two))
        assert np.all(np.abs(missing - full) <= (np.array(stated) + np.finfo(np.float32).eps) * full)


def test_what_is_near_or_looked_at_is_never_hidden(survey):
    made, gone = without_hidden(make_scene(), [survey], POSES)
    assert gone == len(survey.faces) - len(made[0].faces)
    centre = survey.vertices[survey.faces].mean(axis=1)
    kept = {tuple(face) for face in made[0].faces.tolist()}
    lost = np.array([tuple(face) not in kept for face in survey.faces.tolist()])
    for pose in POSES:
        p = (centre - pose[:3, 3]) @ pose[:3, :3]
        assert np.linalg.norm(p, axis=1)[lost].min() > NEAREST_M
        assert np.degrees(np.arctan2(np.abs(p[:, 0]), p[:, 1]))[lost].min() > 33.0  # half the field of view


def test_a_map_that_a_clear_view_would_miss_is_kept(survey):
    """With B, evenly lit: walls of 60 m around the vehicle, which only its floor sees."""
    angles = np.linspace(0, 2 * np.pi, 121)
    ring = np.array([[30.0 * np.cos(a), 30.0 * np.sin(a), z] for z in (-5.0, 60.0) for a in angles])
    quads = np.array([[k, k + 1, k + 122, k, k + 122, k + 121] for k in range(120)]).reshape(-1, 3)
    behind = quads[ring[quads].mean(axis=1)[:, 1] < -5.0]
    points, faces = subdivide(ring, behind, 4)
    wall = Part("objects.0", points, faces, Diffuse(reflectance=[0.9] * 3))
    floor = Part("terrain", *generate_terrain(60.0, 33, 0.1, seed=4), Diffuse(reflectance=[0.9] * 3))
    scene = make_scene(tolerance=0.02, outputs=["A", "B"])
    assert without_hidden(scene, [floor, wall], POSES)[1] > 0.5 * len(faces)
    assert plan_render(scene, FrameRenderer(scene, "cpu", parts=[floor, wall]), POSES).hidden


def subdivide(points, faces, times):
    """A finer mesh of the same surface."""
    import trimesh

    for _ in range(times):
        points, faces = trimesh.remesh.subdivide(points, faces)
    return points, faces.astype(np.int32)


# --------------------------------------------------------------------------------------------------------------- lamps


FAINT = LAMP | {"intensity": [1e-5] * 3}


def test_lamps_without_effect_are_left_out_and_the_image_stays(survey):
    scene = make_scene([LAMP, FAINT, LAMP | {"intensity": [0.0] * 3}], tolerance=0.2)
    renderer = FrameRenderer(scene, "cpu", parts=[survey])
    plan = plan_render(scene, renderer, POSES)
    assert plan.lamps == [0]
    assert plan.decisions[0].what == "lamps"
    less = planned_renderer(renderer, plan.to_dict(), POSES)
    one, two = (r.render(POSES[0], outputs="A", spp=16, max_scatterings=0, max_bounces=1).A.radiance.astype(float)
                for r in (renderer, less))
    assert len(less.scene.vehicle.lights) == 1
    assert one.mean() > 0.0
    np.testing.assert_allclose(two.mean((0, 1)), one.mean((0, 1)), rtol=0.1)  # 16 samples


def test_a_lamp_that_lights_what_is_seen_by_way_of_a_wall_is_kept():
    """It looks at a white wall beside the view, which lights the floor in it; no unshaded lamp light would tell."""
    wall = np.array([[-1.0, -1, -2], [-1, 9, -2], [-1, 9, 4], [-1, -1, 4]])
    floor = np.array([[-9.0, -9, -1.5], [9, -9, -1.5], [9, 9, -1.5], [-9, 9, -1.5]])
    quad = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    parts = [Part(name, points, faces, Diffuse(reflectance=[0.9] * 3)) for name, points, faces in
             (("objects.0", wall, quad[:, ::-1].copy()), ("objects.1", floor, quad))]
    aside = {"kind": "spot", "position": [0, 0, 0], "direction": [-1, 0, 0.3], "cone_deg": 10}
    scene = make_scene([LAMP | {"intensity": [3.0] * 3}, aside], tolerance=0.2)
    assert plan_render(scene, FrameRenderer(scene, "cpu", parts=parts), [np.eye(4)]).lamps is None


def test_the_peak_of_a_phase_function_over_its_mean():
    """That of sea water's has no end: the first degree's mean stands for it."""
    assert _peak(HenyeyGreenstein(0.8)) == pytest.approx(4.0 * np.pi * HenyeyGreenstein(0.8).eval(1.0))
    assert _peak(HenyeyGreenstein(-0.8)) == pytest.approx(_peak(HenyeyGreenstein(0.8)))
    assert _peak(Rayleigh()) == pytest.approx(4.0 * np.pi * Rayleigh().eval(1.0), rel=1e-3)
    assert _peak(FournierForand(1.10, 3.5835)) == pytest.approx(0.254567 / np.sin(np.radians(0.5)) ** 2, rel=1e-5)
