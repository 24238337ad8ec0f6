"""What is left out because it cannot reach the image: nothing that is seen, and no more light than is stated."""

import numpy as np
import pytest

from varos_warp.render.detail import choose_detail
from varos_warp.render.frame import FrameRenderer
from varos_warp.render.pilot import scout
from varos_warp.render.plan import plan_render, planned_renderer
from varos_warp.render.reach import NEAREST_M, cut_parts, lamp_bounds
from varos_warp.render.truncation import view_rays
from varos_warp.scene.description import Diffuse, Scene
from varos_warp.scene.frames import look_at_matrix, transform
from varos_warp.scene.geometry import Part
from varos_warp.scene.procedural import generate_terrain

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


def test_most_of_a_large_map_is_cut_and_the_images_stay(survey):
    """C and D to the last bit; A with the same random numbers within what is stated."""
    scene = make_scene()
    made, light, cut = cut_parts(scene, [survey], POSES, 0.002)
    assert 0.0 < light <= 0.002
    assert cut == len(survey.faces) - len(made[0].faces) > 0.3 * len(survey.faces)
    whole, less = (FrameRenderer(scene, "cpu", parts=parts) for parts in ([survey], made))
    for pose in POSES:
        one, two = (renderer.render(pose, outputs="ACD", spp=64) for renderer in (whole, less))
        assert np.array_equal(one.C.normal, two.C.normal)
        assert np.array_equal(one.D.depth, two.D.depth)
        full, missing = (frame.A.radiance.astype(float).mean((0, 1)) for frame in (one, two))
        assert np.all(np.abs(missing - full) <= light * full)


def test_a_clear_view_of_the_horizon_keeps_its_hills(survey):
    """With B far hills count, since nothing absorbs what they send: their form factor is above 1 %."""
    _, _, cut = cut_parts(make_scene(outputs=["A", "B"]), [survey], POSES, 0.002)
    assert cut == 0


def test_what_is_near_or_looked_at_is_never_cut(survey):
    made, _, _ = cut_parts(make_scene(), [survey], POSES, np.inf)
    centre = survey.vertices[survey.faces].mean(axis=1)
    kept = {tuple(face) for face in made[0].faces.tolist()}
    gone = np.array([tuple(face) not in kept for face in survey.faces.tolist()])
    for pose in POSES:
        p = (centre - pose[:3, 3]) @ pose[:3, :3]
        distance = np.linalg.norm(p, axis=1)
        assert distance[gone].min() > NEAREST_M
        beside = np.degrees(np.arctan2(np.abs(p[:, 0]), p[:, 1]))
        assert beside[gone].min() > 33.0 + 25.0  # half the field of view, and nearly 30 degrees


def test_the_plan_says_so_and_a_small_mesh_is_left_alone(survey):
    scene = make_scene(tolerance=0.05)
    detail = choose_detail(scene, [survey], POSES)
    assert detail.meshes["out_of_reach"]["triangles"] == len(survey.faces) - len(detail.parts[0].faces)
    assert "out_of_reach" not in choose_detail(make_scene(spp=8), [survey], POSES).meshes  # no tolerance, no models
    small = Part("terrain", *generate_terrain(800.0, 33, 10.0, seed=4), Diffuse())
    assert choose_detail(scene, [small], POSES).parts[0] is small


# --------------------------------------------------------------------------------------------------------------- lamps


FAINT = LAMP | {"intensity": [1e-5] * 3}
BACKWARDS = LAMP | {"direction": [0, -1, 0]}


@pytest.mark.parametrize("lamp", [LAMP, BACKWARDS, {"kind": "point", "position": [0.3, 0, 0]},
                                  {"kind": "point", "position": [0, 40.0, 10.0]}])
def test_the_bound_on_a_lamp_holds(survey, lamp):
    """Everywhere in the mean over places of 16 x 12 pixels, by 64 samples per pixel."""
    scene = make_scene([lamp])
    renderer = FrameRenderer(scene, "cpu", parts=[survey])
    view = next(scout(scene, renderer, POSES))
    bound = lamp_bounds(scene, view, view_rays(view))[0]
    image = renderer.render(view.T_w_v, view.camera, "A", spp=64).A.radiance.astype(float)
    places = [x.reshape(3, 12, 4, 16, 3).mean((1, 3)) for x in (image, bound)]
    assert np.all(places[0] <= places[1])


def test_lamps_without_effect_are_left_out_and_the_image_stays(survey):
    scene = make_scene([LAMP, FAINT, LAMP | {"intensity": [0.0] * 3}], tolerance=0.2)
    renderer = FrameRenderer(scene, "cpu", parts=[survey])
    plan = plan_render(scene, renderer, POSES)
    assert plan.lamps == [0]
    assert plan.decisions[0].what == "lamps"
    less = planned_renderer(renderer, plan.lamps)
    one, two = (r.render(POSES[0], outputs="A", spp=16, max_scatterings=0, max_bounces=1).A.radiance.astype(float)
                for r in (renderer, less))
    assert len(less.scene.vehicle.lights) == 1
    assert one.mean() > 0.0
    np.testing.assert_allclose(two.mean((0, 1)), one.mean((0, 1)), rtol=0.1)  # 16 samples
    both = make_scene([LAMP, BACKWARDS], tolerance=0.2)
    assert plan_render(both, FrameRenderer(both, "cpu", parts=[survey]), POSES).lamps is None
