"""Other renderers mean the same light as the scene file: closed forms, a reference, and what is refused.

A rendering is compared by its residuals, pixel by pixel, with a truth without noise: if the two are equal their mean
is zero, and their spread gives its standard error.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from physics.rig import Z, one_ray_scene, single_scattering, spot

from benchmarks import peers
from benchmarks.peers.mitsuba_scene import MASK_PIXELS, mask_pixels, write_mitsuba
from benchmarks.peers.plain import plain_scene
from benchmarks.peers.view import soft_edge
from benchmarks.scenes import SCENES, references
from varos_warp.errors import InputError
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse, Metal
from varos_warp.scene.frames import camera_pose, intrinsics
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.optics.camera import pixel_centres

ROOT = Path(__file__).parents[2]


@pytest.fixture(params=["mitsuba", "cycles"])
def peer(request):
    """Each peer that is installed."""
    if request.param not in peers.available():
        pytest.skip(f"{request.param} is not installed")
    return request.param


def render(peer, scene, parts, spp, **how):
    """Radiance of the first camera from the first pose at the world's origin, float64; Mitsuba as anyone has it."""
    variant = {"variant": "scalar_rgb"} if peer == "mitsuba" else {}
    image = peers.render(peer, scene, parts, scene.vehicle.cameras[0], np.eye(4), spp=spp, **variant, **how)
    assert image.seconds > 0.0
    assert image.cpu_seconds > 0.0
    assert np.isfinite(image.radiance).all()
    return image.radiance.astype(float)


def scores(image, truth, precision):
    """Standard scores [3] of the mean residual, known to ``precision`` of the mean or better."""
    residual = (image - truth).reshape(-1, 3)
    stderr = residual.std(axis=0, ddof=1) / np.sqrt(len(residual))
    assert np.all(stderr <= precision * np.mean(truth, axis=(0, 1))), f"too noisy to tell: {stderr}"
    return residual.mean(axis=0) / stderr


# ----------------------------------------------------------------------------------------------------- direct light


DISTANCE, CORNER, REFLECTANCE = 3.0, 0.03, (0.2, 0.5, 0.8)
LAMP = {
    "kind": "spot",
    "position": [0.4, 0.0, 0.25],
    "direction": [-0.1, 1.0, 0.05],
    "cone_deg": 40.0,
    "intensity": [10.0, 20.0, 30.0],
}
ABSORPTION = [0.3, 0.1, 0.02]


def plate(right_half=False):
    """A wide plate across the view, or only what of it lies to the right and above the axis, and ends in pixels."""
    low = CORNER if right_half else -50.0
    corners = [[low, DISTANCE, low], [50, DISTANCE, low], [50, DISTANCE, 50], [low, DISTANCE, 50]]
    return Part(
        "plate", np.array(corners, float), np.array([[0, 1, 2], [0, 2, 3]], np.int32), Diffuse(reflectance=REFLECTANCE)
    )


def plate_scene(blend, water="none", **camera):
    view = {"id": "M0", "resolution": [48, 32], "sensor_mm": [4.5, 3.0], "focal_mm": 4.0} | camera
    return Scene(
        vehicle={"lights": [LAMP | {"blend": blend}], "cameras": [view]},
        water=water,
        trajectory={"poses": [{"position": [0, 0, 0]}]},
    )


def plate_truth(scene, right_half=False, cone_deg=40.0, samples=12):
    """Radiance of the plate, the mean over a grid of each pixel and, with a lens, a grid of it; float64 [H, W, 3].

    reflectance / pi * intensity * soft edge * cosine / d^2, through water that absorbs.
    """
    camera, light = scene.vehicle.cameras[0], scene.vehicle.lights[0]
    (width, height), K = camera.resolution, intrinsics(camera)
    sub = (np.arange(samples) + 0.5) / samples
    x = (np.add.outer(np.arange(width), sub).ravel() - K[0, 2]) / K[0, 0]
    z = -(np.add.outer(np.arange(height), sub).ravel() - K[1, 2]) / K[1, 1]
    slopes = np.stack(np.broadcast_arrays(x[None, :], 1.0, z[:, None]), axis=-1)
    total, lens = np.zeros((height * samples, width * samples, 3)), lens_points(camera)
    for point in lens:
        through = camera.focus_m * slopes - point if len(lens) > 1 else slopes
        hit = point + through * (DISTANCE / through[..., 1:2])
        total += shaded(hit, point, scene, light, cone_deg, right_half) / len(lens)
    return total.reshape(height, samples, width, samples, 3).mean(axis=(1, 3))


def lens_points(camera, rings=12, sectors=24):
    """Points of equal weight on the lens, or its centre alone."""
    if not camera.f_stop:
        return np.zeros((1, 3))
    radius = 0.5e-3 * camera.focal_mm / camera.f_stop * np.sqrt((np.arange(rings) + 0.5) / rings)
    angle = 2.0 * np.pi * (np.arange(sectors) + 0.5) / sectors
    points = np.stack([np.outer(radius, np.cos(angle)), np.zeros((rings, sectors)), np.outer(radius, np.sin(angle))])
    return points.reshape(3, -1).T


def shaded(hit, eye, scene, light, cone_deg, right_half):
    to_hit = hit - np.array(light.position)
    d = np.linalg.norm(to_hit, axis=-1, keepdims=True)
    axis = np.array(light.direction) / np.linalg.norm(light.direction)
    size = np.cos(np.radians(cone_deg) / 2)
    x = np.clip(((to_hit @ axis)[..., None] / d - size) / max(light.blend * (1.0 - size), 1e-12), 0.0, 1.0)
    edge = x * x * (3.0 - 2.0 * x)
    sigma_a = np.zeros(3) if scene.water == "none" else np.array(scene.water.coefficients.sigma_a)
    path = d + np.linalg.norm(hit - eye, axis=-1, keepdims=True)
    radiance = np.array(REFLECTANCE) / np.pi * light.intensity * edge * (DISTANCE / d) / d**2 * np.exp(-sigma_a * path)
    there = (hit[..., 0:1] > CORNER) & (hit[..., 2:3] > CORNER) if right_half else True
    return np.where(there, radiance, 0.0)


def test_a_plate_in_a_hard_cone_is_as_bright_as_it_must_be_where_it_must_be(peer):
    """Absolute radiance, the cone's edge, and the image's right and upper side by what lies only there."""
    scene = plate_scene(blend=0.0)
    image = render(peer, scene, [plate(right_half=True)], spp=64)
    truth = plate_truth(scene, right_half=True)
    assert np.all(np.abs(scores(image, truth, 2e-3)) <= Z)
    assert np.all(np.abs(scores(image, plate_truth(scene, right_half=True, cone_deg=40.5), 1.0)) > Z)
    for wrong in (truth[:, ::-1], truth[::-1], np.roll(truth, 1, 1), np.roll(truth, 1, 0)):
        assert np.std(image - wrong) > 3 * np.std(image - truth)


def test_light_that_a_soft_cone_sends_through_absorbing_water_fades_as_it_must(peer):
    """Channel by channel, over the way to the plate and back; the edge is Blender's, not linear in the angle."""
    scene = plate_scene(0.6, {"coefficients": {"sigma_s": [0, 0, 0], "sigma_a": ABSORPTION}})
    image = render(peer, scene, [plate()], spp=128)
    assert np.all(np.abs(scores(image, plate_truth(scene), 5e-3)) <= Z)
    assert np.all(np.abs(scores(image, plate_truth(scene, cone_deg=41.0), 1.0)) > Z)


def test_mitsuba_takes_water_of_more_than_one_a_metre():
    """Its triples of numbers above 1 are refused; the medium has a scale."""
    scene = plate_scene(0.6, {"coefficients": {"sigma_s": [0, 0, 0], "sigma_a": [1.4, 0.3, 0.02]}})
    image = render("mitsuba", scene, [plate()], spp=256)
    assert np.all(np.abs(scores(image, plate_truth(scene), 2e-2)) <= Z)


def test_a_lens_blurs_what_is_out_of_focus_by_its_aperture(peer):
    """Edges at 3 m, in focus at 1 m: their profile is a disk, convolved, but for the noise of a column's samples."""
    camera = {"focal_mm": 40.0, "sensor_mm": [4.5, 3.0], "f_stop": 1.6, "focus_m": 1.0}
    scene = plate_scene(0.0, **camera)
    image = render(peer, scene, [plate(right_half=True)], spp=256)
    truth = plate_truth(scene, right_half=True, samples=3)
    sharp = plate_truth(plate_scene(0.0, **camera | {"f_stop": 0.0}), right_half=True, samples=3)
    noise = 0.5 * sharp.max(axis=(0, 1)) / np.sqrt(256 * len(image))  # where half of the samples hit the plate
    assert np.all(np.abs((image - truth).mean(axis=0)) <= Z * noise)
    assert np.abs((sharp - truth).mean(axis=0)).max() > 5 * Z * noise.max()


# -------------------------------------------------------------------------------------------------------- scattering


@pytest.mark.parametrize(
    ("position", "axis"),
    [((0.5, 0.0, -0.1), (0.1, 0, 1)), ((0.5, 0.1, 4.0), (0, 0, -1))],
    ids=["backwards", "forwards"],
)
def test_single_scattering_of_an_open_ray_is_its_integral(peer, position, axis):
    """Lamps behind and before what they light; a wrong sign of g would be off by far."""
    water = {"sigma_s": [0.05, 0.2, 0.4], "sigma_a": [0.2, 0.1, 0.0], "phase": {"g": 0.6}}
    scene = one_ray_scene([spot(position, axis)], water, pixels=32)
    image = render(peer, scene, [], spp=256, max_events=1)

    def truth(g):
        sigma_t = np.add(water["sigma_s"], water["sigma_a"])
        how = {"T": np.inf, "axis": axis, "cone_deg": 65.0}
        return np.array(
            [single_scattering(position, s, t, g, **how) for s, t in zip(water["sigma_s"], sigma_t, strict=True)]
        )

    assert np.all(np.abs(scores(image, np.broadcast_to(truth(0.6), image.shape), 0.02)) <= Z)
    assert np.all(np.abs(scores(image, np.broadcast_to(truth(-0.6), image.shape), np.inf)) > 2 * Z)


def test_all_orders_on_the_reference_scene_are_the_reference(peer):
    """The mean over an image does not depend on its pixels: a quarter of the resolution, against the same blocks."""
    bench = SCENES["ref1"]
    camera = bench.camera.model_copy(update={"resolution": (80, 45)})
    spp = {"mitsuba": 64, "cycles": 8}[peer]
    bound = {"max_events": 17} if peer == "cycles" else {"variant": "scalar_rgb"}  # 1e-4 of blue, in half the time
    image = peers.render(peer, bench.scene, bench.parts, camera, bench.T_w_v, spp=spp, **bound).radiance.astype(float)
    truth = references(bench, "cpu")["full"].mean.reshape(45, 4, 80, 4, 3).mean(axis=(1, 3))
    assert np.all(np.abs(scores(image, truth, 0.1)) <= Z)
    bright = truth[..., 2] < 4.0 * np.median(truth[..., 2])
    assert np.corrcoef(image[bright, 0], truth[bright, 0])[0, 1] > 0.9


# ------------------------------------------------------------------------------------------------------ behind a pane


PORT = {"kind": "flat", "distance_m": 0.02, "thickness_m": 0.008, "n_glass": 1.49, "normal": [0.2, -0.1, 1.0]}
N_WATER = 1.342


def behind_pane(water="none", **port):
    """A point light in the water before a camera with a wide view."""
    lamp = {"kind": "point", "position": [0.4, 0.5, 0.25], "intensity": LAMP["intensity"]}
    camera = {"id": "M0", "resolution": [48, 32], "sensor_mm": [4.5, 3.0], "focal_mm": 2.25} | port
    return Scene(
        vehicle={"lights": [lamp], "cameras": [camera]}, water=water, trajectory={"poses": [{"position": [0, 0, 0]}]}
    )


def pane(T_w_c, distance, before, after, **water):
    """A surface of the glass for Mitsuba, a square of 2 m; its normal looks back into the medium before it."""
    import mitsuba

    z = -np.array(PORT["normal"]) / np.linalg.norm(PORT["normal"])
    x = np.cross([0.0, 1.0, 0.0], z) / np.hypot(z[0], z[2])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.column_stack([x, np.cross(z, x), z]), -distance * z
    return {
        "type": "rectangle",
        "to_world": mitsuba.ScalarTransform4f((T_w_c @ T).tolist()),
        **water,
        "bsdf": {"type": "dielectric", "ext_ior": before, "int_ior": after},
    }


def mitsuba_behind_pane(water, part, folder):
    """Paths go through both surfaces to the plate and on to the light: four segments, none reflected in the glass."""
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    plain = view(behind_pane(water), [part])
    made = write_mitsuba(plain, folder, spp=1024)
    made["integrator"]["max_depth"] = 4
    behind = {"interior": made["sensor"].pop("medium")} if plain.sigma_t.any() else {}
    made["inner"] = pane(plain.T_w_c, PORT["distance_m"], 1.0, PORT["n_glass"])
    made["outer"] = pane(plain.T_w_c, PORT["distance_m"] + PORT["thickness_m"], PORT["n_glass"], N_WATER, **behind)
    return np.array(mitsuba.render(mitsuba.load_dict(made), seed=1)).astype(float)


@pytest.mark.parametrize("half", [True, False], ids=["edges in clear water", "all of it in water that absorbs"])
def test_a_flat_port_is_two_dielectrics_of_mitsuba(half, tmp_path):
    """Radiance at angles to the glass up to 30, 45 and 70 degrees, and where the edges of the plate are in the image.

    Light that is reflected within the glass would add 1 / (1 - R1 R2) - 1, 1e-4 on axis, where R of a surface is
    ((n1 - n2) / (n1 + n2))^2. Mitsuba takes the light in the glass for unpolarised: up to 2e-4 less at 60 degrees.
    """
    pytest.importorskip("mitsuba")
    water = "none" if half else {"coefficients": {"sigma_s": [0, 0, 0], "sigma_a": ABSORPTION}}
    image = mitsuba_behind_pane(water, plate(right_half=half), tmp_path)

    def ours(n_water):
        renderer = FrameRenderer(behind_pane(water, port=PORT, n_water=n_water), "cpu", [plate(right_half=half)])
        return renderer.render(
            np.eye(4), outputs="A", spp=256, integrator="path", layers=("direct",), denoise="none"
        ).A.radiance.astype(float)

    expected, n = ours(N_WATER), np.array(PORT["normal"]) / np.linalg.norm(PORT["normal"])
    rays = np.concatenate([(pixel_centres(48, 32) - [24.0, 16.0]) / 24.0, np.ones((32, 48, 1))], -1)
    angle = np.degrees(np.arccos(rays @ n / np.linalg.norm(rays, axis=-1)))
    lit = expected[..., 1] > 0.0
    for low, high in ((0, 30), (30, 45), (45, 70)):
        there = lit & (angle >= low) & (angle < high)
        if there.any():
            assert np.all(np.abs(scores(image[there][None], expected[there][None], 3e-3)) <= Z)
    assert np.all(np.abs(scores(image[lit][None], ours(1.35)[lit][None], 3e-3)) > Z)
    for axis in (0, 1) if half else ():
        slope = (np.roll(expected, -1, axis) - np.roll(expected, 1, axis))[1:-1, 1:-1, 1] / 2.0
        off = (image - expected)[1:-1, 1:-1, 1] * slope
        shift, stderr = np.array([off.sum(), np.sqrt((off**2).sum())]) / np.sum(slope**2)  # pixels
        assert abs(shift) <= Z * stderr < 0.04


# ---------------------------------------------------------------------------------------------------- what is exported


def test_copies_and_smooth_normals_are_exported(peer):
    """Pipes, smooth all around and lit from the camera, where no program needs to mend their terminators.

    What smoothing does to the image, ``smooth - flat``, is found in the other program's image once, not 0 times.
    """
    pipe = {"kind": "pipe", "radius": 0.3, "length": 2.0, "chord_error_m": 0.03}
    scene = Scene(
        objects=[pipe],
        trajectory={"poses": [{"position": [0, 0, 0]}]},
        vehicle={
            "lights": [{"kind": "point", "intensity": [10, 20, 30]}],
            "cameras": [{"id": "M0", "resolution": [48, 32], "sensor_mm": [4.5, 3.0], "focal_mm": 4.0}],
        },
    )
    part, places = build_parts(scene)[0], np.array([np.eye(4)] * 2)
    places[:, :3, 3] = [[-0.6, 3.0, 0.0], [0.7, 3.5, 0.2]]

    def ours(smooth):
        copies = Instances(
            "scatter.0",
            part.vertices,
            part.faces,
            part.material,
            places,
            smooth_angle=part.smooth_angle,
            smooth_shading=smooth,
        )
        how = {"spp": 256, "integrator": "path", "layers": ("direct",)}
        return copies, FrameRenderer(scene, "cpu", [copies]).render(np.eye(4), outputs="A", **how).A.radiance[..., 1]

    (copies, smooth), (_, flat) = ours(True), ours(False)
    image = render(peer, scene, [copies], spp=256, max_scatterings=0, max_bounces=1)[..., 1]
    change = (smooth - flat).astype(float)
    share = np.sum((image - flat) * change) / np.sum(change**2)
    stderr = np.sqrt(np.sum(((image - smooth) * change) ** 2)) / np.sum(change**2)
    assert stderr < 0.05
    assert abs(share - 1.0) <= Z * stderr


IN_BLENDER = """
import sys; from pathlib import Path; import bpy, numpy; from benchmarks.peers import cycles_scene as c
path, out = sys.argv[1:]
bpy.ops.wm.open_mainfile(filepath=path)
c.render_exr(Path(out + ".exr"))
numpy.save(out, c.read_exr(Path(out + ".exr")))
"""


def opened(peer, path, out):
    """What the program makes of a file; a process has one Blender only, in which the tests have scenes of their own."""
    if peer == "mitsuba":
        import mitsuba

        mitsuba.set_variant("scalar_rgb")
        return np.array(mitsuba.render(mitsuba.load_file(str(path)), spp=16, seed=1))
    subprocess.run([sys.executable, "-c", IN_BLENDER, path, out], check=True, capture_output=True, cwd=ROOT)
    return np.load(out)


def test_an_exported_file_opens_elsewhere_and_gives_the_same_image(peer, tmp_path):
    scene, parts = plate_scene(0.5), [plate()]
    path = tmp_path / f"plate{peers.SUFFIXES[peer]}"
    for _ in range(2):  # an export may be repeated
        peers.export(peer, scene, parts, scene.vehicle.cameras[0], np.eye(4), path, spp=16)
    assert {p.name for p in tmp_path.iterdir()} <= {path.name, "plate_files"}
    moved = path.parent.rename(tmp_path.with_name(tmp_path.name + "_moved"))  # what it refers to goes with it
    exported = opened(peer, moved / path.name, moved / "image.npy")
    image = render(peer, scene, parts, spp=16)
    # neither its file formats (six digits and more) nor other random numbers change a smooth image by more
    np.testing.assert_allclose(exported.mean(axis=(0, 1)), image.mean(axis=(0, 1)), rtol=5e-3)


@pytest.mark.parametrize(("half_deg", "blend"), [(32.5, 0.15), (20.0, 0.6), (35.0, 1.0), (60.0, 0.3), (75.0, 0.5)])
def test_a_lamp_mask_is_right_to_what_it_promises(half_deg, blend):
    """Read between its pixels along a radius, as Mitsuba reads it."""
    half, pixels = np.radians(half_deg), mask_pixels(np.radians(half_deg), blend)
    assert MASK_PIXELS[0] <= pixels <= MASK_PIXELS[1]
    at = (2.0 * np.arange(pixels) + 1.0) / pixels - 1.0
    mask = soft_edge(np.cos(np.arctan(np.tan(half) * np.abs(at))), half, blend)
    x = np.linspace(0.0, at[-1], 100_001)
    exact = soft_edge(np.cos(np.arctan(np.tan(half) * x)), half, blend)
    assert np.abs(np.interp(x, at, mask) - exact).max() <= 1e-4


# ------------------------------------------------------------------------------------------------------------ refusals


def view(scene, parts, **bounds):
    return plain_scene(scene, parts, scene.vehicle.cameras[0], np.eye(4), **bounds)


def test_a_material_without_a_counterpart_is_refused_by_its_name():
    part = plate()
    metal = Part("objects.0", part.vertices, part.faces, Metal(kind="metal"))
    with pytest.raises(InputError, match=r"objects\.0\.material.*metal"):
        view(plate_scene(0.0), [metal])


@pytest.mark.parametrize("optics", [{"port": PORT}, {"distortion": {"model": "kannala_brandt"}}])
def test_ports_and_distortions_that_peers_have_not_are_refused(optics):
    with pytest.raises(InputError, match=r"cameras.*port"):
        view(behind_pane(**optics), [plate()])


def test_phase_functions_that_peers_have_not_are_refused():
    water = {"coefficients": {"sigma_s": [0.1] * 3, "sigma_a": [0.2] * 3, "phase": {"kind": "petzold"}}}
    with pytest.raises(InputError, match=r"water.*phase function petzold.*Henyey"):
        view(plate_scene(0.0, water), [plate()])


@pytest.mark.parametrize(
    "bounds",
    [
        {"max_scatterings": 2},
        {"max_bounces": 2},
        {"max_scatterings": 2, "max_bounces": 3},
        {"max_scatterings": 0, "max_bounces": 0},
        {"max_events": 0},
    ],
)
def test_bounds_that_peers_cannot_count_are_refused(bounds):
    with pytest.raises(InputError, match="together"):
        view(plate_scene(0.0), [plate()], **bounds)


def test_bounds_that_peers_can_count_become_events():
    water = {"coefficients": {"sigma_s": [0.1] * 3, "sigma_a": [0.2] * 3}}
    scene, parts = plate_scene(0.0, water), [plate()]
    assert view(scene, parts).max_events is None
    dark = view(scene, parts, max_scatterings=3, max_bounces=0)
    assert dark.max_events == 3
    assert dark.meshes[0].reflectance == (0.0, 0.0, 0.0)
    clear = view(scene, parts, max_scatterings=0, max_bounces=2)
    assert clear.max_events == 2
    np.testing.assert_allclose(clear.sigma_a, 0.3)
    assert not clear.sigma_s.any()


def test_a_scene_far_from_the_origin_is_exported_near_it():
    far = np.array([5e5, 7e6, -80.0])
    part = plate()
    moved = Part(part.name, part.vertices + far, part.faces, part.material)
    T_w_v = np.eye(4)
    T_w_v[:3, 3] = far
    scene = plate_scene(0.0)
    plain, here = plain_scene(scene, [moved], scene.vehicle.cameras[0], T_w_v), view(scene, [part])
    np.testing.assert_allclose(plain.meshes[0].vertices, here.meshes[0].vertices, atol=1e-8)
    np.testing.assert_allclose(plain.lights[0].position, here.lights[0].position, atol=1e-8)
    np.testing.assert_allclose(plain.T_w_c, camera_pose(scene.vehicle.cameras[0], np.eye(4)), atol=1e-8)


def test_pixels_that_are_not_square_are_refused_by_mitsuba():
    if "mitsuba" not in peers.available():
        pytest.skip("mitsuba is not installed")
    with pytest.raises(InputError, match="square"):
        render("mitsuba", plate_scene(0.0, sensor_mm=[4.5, 4.5]), [plate()], spp=1)


def test_pixels_that_are_not_square_are_rendered_by_cycles():
    if "cycles" not in peers.available():
        pytest.skip("bpy is not installed")
    scene = plate_scene(0.0, sensor_mm=[4.5, 4.5])
    image = render("cycles", scene, [plate(right_half=True)], spp=64)
    assert np.all(np.abs(scores(image, plate_truth(scene, right_half=True), 2e-3)) <= Z)


def test_an_unknown_peer_is_refused():
    scene = plate_scene(0.0)
    with pytest.raises(InputError, match="no such peer"):
        peers.render("povray", scene, [plate()], scene.vehicle.cameras[0], np.eye(4), spp=1)


def test_importing_the_peers_loads_none_of_them():
    code = "import sys, benchmarks.peers as p; p.available(); assert not {'bpy', 'mitsuba', 'drjit'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
