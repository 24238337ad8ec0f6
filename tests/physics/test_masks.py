"""Masks of mesh files cut holes, exactly where their alpha is below the cutoff, for every ray."""

import numpy as np
import pytest
from made_meshes import BOARD, Gltf, picture

from varos_warp.render.moments import NextFrame
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene import device
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.mesh_files import load_mesh

PIXELS = 64
CHECKER = np.indices((4, 4)).sum(axis=0) % 2 * 255
"""Alpha of the board, rows from the top: 4 x 4 squares, the first a hole."""
FLAT = {"poses": [{"position": [0, 0, 0]}]}


def net(path, alpha=CHECKER, tints=None, layers=1, cutoff=0.5, **more):
    """Boards behind one another in the plane of x and y, 1 cm apart, with an alpha picture, upright."""
    pixels = np.concatenate([np.full((*alpha.shape, 3), 188), alpha[..., None]], axis=2)
    gltf = Gltf()
    material = gltf.textured(picture(pixels), alphaMode="MASK", alphaCutoff=cutoff, **more)
    for layer in range(layers):
        attributes = {"TEXCOORD_0": gltf.uv()}
        if tints is not None:
            attributes["COLOR_0"] = gltf.accessor(tints)
        gltf.mesh(BOARD - [0, 0, 0.01 * layer], material=material, attributes=attributes)
    return gltf.save(path)


def scene(folder, objects, *, lights=(), water="none", outputs="BCDSF", **render):
    """A camera at the origin that looks along +y through nets, which fill its view at 2 m, at a wall at 4 m."""
    wall = {"kind": "mesh", "file": "wall.glb", "up": "y", "position": [0, 4, 0]}
    gltf = Gltf()
    gltf.mesh(6.0 * BOARD)
    gltf.save(folder / "wall.glb")
    return scene_from_dict(
        {
            "objects": [*objects, wall],
            "water": water,
            "vehicle": {
                "lights": list(lights),
                "cameras": [{"resolution": [PIXELS, PIXELS], "sensor_mm": [2.0, 2.0], "focal_mm": 2.0}],
            },
            "trajectory": FLAT,
            "render": {"outputs": [*outputs], "denoise_b": "none", **render},
        },
        folder,
    )


NET = {"file": "net.glb", "up": "y", "position": [0, 2, 0]}


def expected_holes(alpha=CHECKER):
    """Whether each pixel's centre looks through a hole, and whether it is a texel away from an edge."""
    side = PIXELS // alpha.shape[0]
    holes = (alpha < 128).repeat(side, 0).repeat(side, 1)
    inner = np.tile([False, *[True] * (side - 2), False], alpha.shape[0])
    return holes, inner[:, None] & inner[None, :]


def rendered(scene, letters="BCDS", **options):
    return FrameRenderer(scene, device="cpu").render(np.eye(4), outputs=letters, **options)


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    folder = tmp_path_factory.mktemp("net")
    net(folder / "net.glb")
    return rendered(scene(folder, [NET]), spp_b=1)


def test_depth_normals_and_segments_are_of_what_the_ray_meets_behind_a_hole(seen, truth):
    holes, sure = expected_holes()
    np.testing.assert_allclose(seen.D.depth[sure], np.where(holes, 4.0, 2.0)[sure], rtol=1e-6)
    np.testing.assert_array_equal(seen.S.instance[sure], np.where(holes, 2, 1)[sure])
    np.testing.assert_allclose(seen.C.normal[sure], np.broadcast_to([0, -1.0, 0], (sure.sum(), 3)), atol=1e-6)
    truth(
        "depth behind the holes of a mask [m]",
        source="the wall is 4 m away",
        got=seen.D.depth[sure & holes],
        expected=4.0,
        tolerance=4e-6,
        reason="rounding of single precision",
        subject="surfaces and lights",
    )


def test_an_edge_lies_where_the_blended_alpha_is_the_cutoff(tmp_path):
    """Texels of alpha 0 and 255 in a row: their blend is 0.75 three quarters of the way between their centres."""
    net(tmp_path / "net.glb", np.array([[0, 255]]).repeat(2, 0).repeat(1, 1), cutoff=0.75)
    depth = rendered(scene(tmp_path, [NET]), "D").D.depth
    edge = np.argmax(depth[32] < 3.0) / PIXELS  # picture() makes 16 texels of each: the blend is 1/16 of the board wide
    assert edge == pytest.approx(0.5 + 0.25 / 32, abs=1.0 / PIXELS)


@pytest.mark.parametrize("layers", [2, 50])
def test_rays_pass_many_nets_behind_one_another(tmp_path, layers):
    """Where holes lie behind one another, whatever the parallax, a ray goes on to the wall; else it ends at a net."""
    net(tmp_path / "net.glb", layers=layers)
    depth = rendered(scene(tmp_path, [NET]), "D").D.depth
    row, col = np.indices(depth.shape) + 0.5
    expected = np.full(depth.shape, 4.0)
    sure = np.ones(depth.shape, bool)
    for layer in range(layers)[::-1]:
        distance = 2.0 + 0.01 * layer
        u, v = ((1.0 + (place - 32) / 64 * distance) / 2.0 for place in (col, row))
        square = CHECKER[(4 * v).astype(int).clip(0, 3), (4 * u).astype(int).clip(0, 3)]
        outside = (np.minimum(u, v) < 0.0) | (np.maximum(u, v) > 1.0)
        expected = np.where((square > 128) & ~outside, distance, expected)
        for place in (u, v):
            sure &= np.abs(4 * place - np.round(4 * place)) > 0.1
    np.testing.assert_allclose(depth[sure], expected[sure], rtol=1e-6)
    assert np.count_nonzero(sure & (expected == 4.0)) > 200


def test_a_ray_that_grazes_a_net_passes_its_holes(tmp_path):
    """Rays along the net, 1 mm above its plane at the lens, meet it at angles down to 1e-4."""
    net(tmp_path / "net.glb", np.zeros((2, 2), int) + [[0, 255], [0, 255]])
    tilted = {"file": "net.glb", "up": "y", "position": [0, 2, -0.001], "rotation_euler_deg": [90, 0, 0]}
    depth = rendered(scene(tmp_path, [tilted]), "D").D.depth
    assert np.isfinite(depth).all()
    right = np.arange(PIXELS) > 34
    assert np.all(depth[33:, ~right][:, :30] > 3.9)  # the left half of the net is a hole


def test_alpha_of_vertices_multiplies_that_of_the_picture(tmp_path):
    """Without holes of its own, alpha of 1 to 0 from left to right cuts the right half away."""
    tints = np.array([[1.0, 1, 1, 1], [1, 1, 1, 0], [1, 1, 1, 0], [1, 1, 1, 1]])
    net(tmp_path / "net.glb", np.full((2, 2), 255), tints)
    depth = rendered(scene(tmp_path, [NET]), "D").D.depth
    np.testing.assert_allclose(depth[:, :31], 2.0, rtol=1e-6)
    np.testing.assert_allclose(depth[:, 33:], 4.0, rtol=1e-6)


@pytest.mark.parametrize("gap", [0.0, 1e-6, 1e-5, 1e-4])
@pytest.mark.parametrize(
    "more", [{}, {"path": [{"time_s": t, "position": [0, 2, t]} for t in (0, 1)]}], ids=["still", "moving"]
)
@pytest.mark.parametrize("turn", [[10, 0, 20], [33, 5, -20]])
def test_what_lies_close_behind_a_hole_is_seen(tmp_path, gap, more, turn):
    """A wall behind a net, in one file with it, at no distance or less than a step to the other side of a hole."""
    gltf = Gltf()
    pixels = np.concatenate([np.full((4, 4, 3), 188), CHECKER[..., None]], axis=2)
    gltf.mesh(
        3.0 * BOARD, material=gltf.textured(picture(pixels), alphaMode="MASK"), attributes={"TEXCOORD_0": gltf.uv()}
    )
    gltf.mesh(3.0 * np.roll(BOARD, 1, axis=0) - [0, 0, gap])
    gltf.save(tmp_path / "both.glb")
    both = {"file": "both.glb", "up": "y", "position": [0, 2, 0], "rotation_euler_deg": turn, **more}
    depth = rendered(scene(tmp_path, [both]), "D").D.depth
    gltf = Gltf()
    gltf.mesh(3.0 * BOARD)
    gltf.save(tmp_path / "both.glb")
    plain = rendered(scene(tmp_path, [both]), "D").D.depth
    np.testing.assert_allclose(depth, plain, atol=3.0 * gap + 1e-5)


def test_holes_are_there_in_what_moves(tmp_path, seen):
    net(tmp_path / "net.glb")
    path = [{"time_s": 0, "position": [0, 2, 0]}, {"time_s": 1, "position": [0, 2, 1]}]
    same = rendered(scene(tmp_path, [{"file": "net.glb", "up": "y", "path": path}]), "CD")
    np.testing.assert_allclose(same.D.depth, seen.D.depth, rtol=1e-6)
    np.testing.assert_array_equal(same.C.normal, seen.C.normal)


def test_copies_have_the_same_holes_as_instances_and_in_one_mesh(tmp_path, monkeypatch):
    net(tmp_path / "net.glb")
    scatter = {
        "object": {"file": "net.glb", "up": "y", "scale": 0.3, "rotation_euler_deg": [0, 0, 20]},
        "count": 40,
        "scale_range": [0.4, 2.5],
    }
    data = (
        scene(tmp_path, []).model_dump(mode="json")
        | {"scatter": [scatter]}
        | {"terrain": {"kind": "procedural", "size_m": 6, "resolution": 5, "relief_m": 0, "position": [0, 3.2, -0.5]}}
    )
    made = scene_from_dict(data, tmp_path)
    images = []
    for most in (0, 1 << 20):
        monkeypatch.setitem(device.MOST_JOINED_FACES, "cpu", most)
        images.append(rendered(made, "DS"))
    instances, joined = images
    assert np.mean(instances.S.instance != joined.S.instance) < 2e-3
    same = instances.S.instance == joined.S.instance
    np.testing.assert_allclose(instances.D.depth[same], joined.D.depth[same], rtol=1e-5)
    assert len(np.unique(joined.S.instance)) > 4


def test_light_falls_through_holes_and_nowhere_else(tmp_path):
    """A lamp at the lens lights through the holes just what the camera sees through them: no shadow is in sight."""
    net(tmp_path / "net.glb")
    holes, sure = expected_holes()
    spot = {"kind": "spot", "position": [0, 0, 0], "cone_deg": 150, "intensity": [16.0] * 3}
    A = rendered(
        scene(tmp_path, [NET], lights=[spot], outputs="A"), "A", spp=16, integrator="path", layers=("direct",)
    ).A.radiance[..., 0]
    row, col = np.indices(A.shape) + 0.5
    x, z = (col - 32) / 32 * 0.5, (32 - row) / 32 * 0.5  # tangents
    cosine = 1.0 / np.sqrt(1.0 + x**2 + z**2)
    for distance, albedo, where in ((4.0, 0.5, holes & sure), (2.0, 0.5028865, ~holes & sure)):
        irradiance = 16.0 * cosine**3 / distance**2
        np.testing.assert_allclose(A[where], (albedo / np.pi * irradiance)[where], rtol=3e-3)


def test_a_lamp_beside_the_camera_casts_the_shadow_of_the_net(tmp_path):
    """On the wall, at 4 m, the net at 2 m shadows a point p when (p + lamp) / 2 is on the net's whole parts."""
    net(tmp_path / "net.glb")
    lamp = {"kind": "spot", "position": [0.5, 0, 0], "cone_deg": 150, "intensity": [16.0] * 3}
    A = rendered(
        scene(tmp_path, [NET], lights=[lamp], outputs="A"), "A", spp=16, integrator="path", layers=("direct",)
    ).A.radiance[..., 0]
    holes, sure = expected_holes()
    row, col = np.indices(A.shape) + 0.5
    wall_x = (col - 32) / 32 * 2.0
    u = (0.5 * (wall_x + 0.5) + 1.0) / 2.0  # where the light's ray meets the net, in pictures across
    column = np.floor(4.0 * u).astype(int)
    lit = CHECKER[(row // 16).astype(int), column.clip(0, 3)] < 128
    clear = np.abs(4.0 * u - np.round(4.0 * u)) > 0.2
    where = holes & sure & clear
    assert np.all(A[where & lit] > 0.05)
    assert np.all(A[where & ~lit] == 0.0)
    assert np.count_nonzero(where & lit) > 100 < np.count_nonzero(where & ~lit)


def test_path_and_reference_agree_in_turbid_water_behind_a_net(tmp_path):
    """The mean of A in quarters of the image, by two integrators with their own code."""
    net(tmp_path / "net.glb")
    lamp = {
        "kind": "spot",
        "position": [0.4, 0, 0.2],
        "direction": [-0.1, 1, 0],
        "cone_deg": 80,
        "intensity": [40.0] * 3,
    }
    water = {"coefficients": {"sigma_s": [0.3] * 3, "sigma_a": [0.1] * 3}}
    made = scene(tmp_path, [NET], lights=[lamp], water=water, outputs="A")
    renderer = FrameRenderer(made, device="cpu")

    def quarters(image):
        return image.reshape(2, 32, 2, 32, 3).mean(axis=(1, 3, 4))

    means = {}
    for integrator, spp, seeds in (("path", 16, 8), ("reference", 128, 8)):
        runs = [
            quarters(
                renderer.render(
                    np.eye(4), outputs="A", spp=spp, integrator=integrator, seed=seed, denoise="none"
                ).A.radiance
            )
            for seed in range(seeds)
        ]
        means[integrator] = np.mean(runs, axis=0), np.std(runs, axis=0, ddof=1) / np.sqrt(seeds)
    (a, sa), (b, sb) = means["path"], means["reference"]
    assert np.all(np.abs(a - b) < 4.5 * np.hypot(sa, sb))
    assert np.all(np.hypot(sa, sb) < 0.03 * a)


def test_a_material_of_the_scene_has_no_holes(tmp_path):
    net(tmp_path / "net.glb")
    made = scene_from_dict(scene(tmp_path, [NET]).model_dump(mode="json") | {"materials": {"grey": {}}}, tmp_path)
    data = made.model_dump(mode="json")
    data["objects"][0]["material"] = "grey"
    depth = rendered(scene_from_dict(data, tmp_path), "D").D.depth
    np.testing.assert_allclose(depth, 2.0, rtol=1e-6)


def test_flow_knows_what_hides_behind_the_net(tmp_path):
    """The vehicle moves sideways: what is seen of the wall through a hole hides behind the net in the next frame."""
    net(tmp_path / "net.glb")
    made = scene(tmp_path, [NET], outputs="F")
    data = made.model_dump(mode="json")
    data["trajectory"] = {"poses": [{"time_s": 0, "position": [0, 0, 0]}, {"time_s": 1.0, "position": [0.25, 0, 0]}]}
    made = scene_from_dict(data, tmp_path)
    there = np.eye(4)
    there[0, 3] = 0.25
    frame = FrameRenderer(made, device="cpu").render(np.eye(4), outputs="DF", following=NextFrame(there))
    holes, sure = expected_holes()
    row, col = np.indices(holes.shape) + 0.5
    wall_x = (col - 32) / 32 * 2.0
    u = (0.5 * (wall_x + 0.25) + 1.0) / 2.0
    hidden = CHECKER[(row // 16).astype(int), np.floor(4 * u).astype(int).clip(0, 3)] > 128
    clear = (np.abs(4.0 * u - np.round(4.0 * u)) > 0.2) & (u < 0.98)
    where = holes & sure & clear
    np.testing.assert_array_equal(frame.F.occluded[where], hidden[where])


def test_a_mask_that_cuts_nothing_is_none(tmp_path):
    """Opaque pictures with alphaMode MASK are common; they cost what others cost."""
    for alpha in (255, 130):
        net(tmp_path / "net.glb", np.full((2, 2), alpha))
        assert not load_mesh(tmp_path / "net.glb", up_axis="y").skin.has_holes
    net(tmp_path / "net.glb", np.full((2, 2), 255), np.array([[1.0, 1, 1, 0.4]] * 4))
    assert load_mesh(tmp_path / "net.glb", up_axis="y").skin.has_holes


def test_what_lies_under_holes_does_not_colour_the_net_from_afar(tmp_path):
    """A fine net of grey 188: black or grey under its holes, B of it is the same at any distance."""
    alpha, means = np.indices((64, 64)).sum(axis=0) % 2 * 255, []
    for under in (0, 188):
        pixels = np.where(alpha[..., None] > 0, 188, under) * np.ones(3, int)
        gltf = Gltf()
        gltf.mesh(
            material=gltf.textured(picture(np.dstack([pixels, alpha]), side=1), alphaMode="MASK"),
            attributes={"TEXCOORD_0": gltf.uv()},
        )
        gltf.save(tmp_path / "net.glb")
        made = scene(tmp_path, [{**NET, "position": [0, 3.5, 0]}], outputs="B")
        means.append(rendered(made, "B", spp_b=64).B.radiance[24:40, 24:40].mean())
    assert means[0] == pytest.approx(means[1], rel=0.02)
