"""Scene files: what is read, and what is said about files that cannot be."""

import warnings
from pathlib import Path

import pytest
import yaml

from varos_warp.errors import InputError
from varos_warp.scene.file.load import demo_scene_path, load_scene, scene_from_dict, scene_to_dict

ROOT = Path(__file__).parents[3]
CONTRACT = Path(__file__).parent / "contract.yaml"
"""Every block of a scene file, in the names that scene files keep."""

SMALL = """\
name: small
objects:
  - {kind: pipe, radius: 0.15, length: 2.0, material: steel}
  - {kind: bolt, size: M24}
materials:
  steel: {reflectance: [0.4, 0.4, 0.4]}
water:
  principled: {density: 0.125, color: [0.1, 0.2, 0.3], absorption_color: [0, 0.4, 1], anisotropy: 0.8}
vehicle:
  mass_kg: 40
trajectory:
  waypoints:
    - {position: [0, 0, 0], look_at: [0, 5, 0]}
render: {spp: 8, denoise: none}
"""


def write(tmp_path, text) -> Path:
    path = tmp_path / "scene.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refusal(tmp_path, text, overrides=()) -> InputError:
    with pytest.raises(InputError) as caught:
        load_scene(write(tmp_path, text), overrides)
    return caught.value


def test_relative_files_are_relative_to_the_scene_file(tmp_path):
    scene = load_scene(write(tmp_path, SMALL))
    assert scene.resolve("a/b.ply") == tmp_path.resolve() / "a" / "b.ply"
    assert scene.resolve("/a/b.ply") == Path("/a/b.ply")


def test_a_resolved_scene_reads_back_to_an_equal_scene(tmp_path):
    scene = load_scene(write(tmp_path, SMALL.replace("vehicle:\n", "vehicle:\n  imu: null\n")))
    assert scene.vehicle.imu is None
    assert scene_from_dict(scene_to_dict(scene), tmp_path) == scene
    (tmp_path / "again.yaml").write_text(yaml.safe_dump(scene_to_dict(scene)))
    assert load_scene(tmp_path / "again.yaml") == scene


@pytest.mark.parametrize(("given", "kept"), [("8", "8"), ("8.0", "8"), ("1.5", "1.5")])
def test_samples_may_be_a_fraction_and_are_written_as_people_write_them(tmp_path, given, kept):
    scene = load_scene(write(tmp_path, SMALL.replace("spp: 8", f"spp: {given}")))
    assert str(scene.render.spp) == str(scene_to_dict(scene)["render"]["spp"]) == kept


@pytest.mark.parametrize(
    "path",
    [ROOT / "examples/munkholmen/scene.yaml", demo_scene_path(), CONTRACT],
    ids=["munkholmen", "demo", "contract"],
)
def test_the_scenes_that_come_with_us_load_and_read_back(path):
    scene = load_scene(path)
    assert scene_from_dict(scene_to_dict(scene), path.parent) == scene


# ------------------------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("old", "new", "key", "line", "says"),
    [
        ("name: small", "nmae: small", "nmae", 1, "Did you mean 'name'?"),
        ("density: 0.125", "densty: 0.125", "water.principled.densty", 8, "Did you mean 'density'?"),
        ("radius: 0.15", "raduis: 0.15", "objects.0.raduis", 3, "Did you mean 'radius'?"),
        ("spp: 8", "zzz: 8", "render.zzz", 14, "Known here: frame_rate_hz, outputs"),
        ("density: 0.125", "density: -0.1", "water.principled.density", 8, "-0.1"),
        ("anisotropy: 0.8", "anisotropy: 1.0", "water.principled.anisotropy", 8, "at most 0.999"),
        ("anisotropy: 0.8", "anisotropy: -1", "water.principled.anisotropy", 8, "at least -0.99"),
        ("mass_kg: 40", "mass_kg: .nan", "vehicle.mass_kg", 10, "finite"),
        ("mass_kg: 40", "mass_kg: heavy", "vehicle.mass_kg", 10, "Give a number"),
        ("mass_kg: 40", "dvl: {range_m: [5, 1]}", "vehicle.dvl.range_m", 10, "0 <= least < most"),
        ("mass_kg: 40", "dvl: {beam_angle_deg: 0}", "vehicle.dvl.beam_angle_deg", 10, "at least 1"),
        ("mass_kg: 40", "magnetometer: {field_T: [0, 20, -50]}", "vehicle.magnetometer.field_T.1", 10, "at most 1"),
        ("length: 2.0", "length: 0", "objects.0.length", 3, "at least 0.0001"),
        (", length: 2.0", "", "objects.0.length", 3, "is missing"),
        ("kind: pipe", "kind: pip", "objects.0", 3, "Did you mean 'pipe'?"),
        ("material: steel", "material: stel", "objects.0.material", 3, "no material named 'stel'"),
        ("size: M24", "size: 24", "objects.1.size", 4, "quotes"),
        ("denoise: none", "denoise: oind", "render.denoise", 14, "Did you mean 'oidn'?"),
        ("    - {position: [0, 0, 0], look_at: [0, 5, 0]}", "    []", "trajectory", 11, "at least one waypoint"),
        ("look_at: [0, 5, 0]", "look_at: [0, 0, 0]", "trajectory.waypoints.0", 13, "must differ"),
        (
            "look_at: [0, 5, 0]",
            "look_at: [0, 5, 0], rotation_euler_deg: [0, 0, 9]",
            "trajectory.waypoints.0",
            13,
            "not both",
        ),
        ("position: [0, 0, 0]", "position: [0, 0]", "trajectory.waypoints.0.position.2", 13, "is missing"),
        # names of other tools
        ("density: 0.125", "scattering: 0.1", "water.principled.scattering", 8, "Known here: density"),
        (
            "mass_kg: 40",
            "cameras: [{K: [[900, 0, 640], [0, 900, 360], [0, 0, 1]]}]",
            "vehicle.cameras.0.K",
            10,
            "fx = focal_mm / sensor_mm[0] x width",
        ),
        ("mass_kg: 40", "cameras: [{fx: 900, fy: 900}]", "vehicle.cameras.0.fx", 10, "intrinsics: {fx, fy, cx, cy}"),
        (
            "mass_kg: 40",
            "cameras: [{principal_point: [318.2, 271.9]}]",
            "vehicle.cameras.0.principal_point",
            10,
            "intrinsics: {fx, fy, cx, cy} in pixels, or calibration",
        ),
        (
            "mass_kg: 40",
            "cameras: [{intrinsics: [543.3, 542.4, 318.2, 271.9]}]",
            "vehicle.cameras.0.intrinsics",
            10,
            "such as {fx: 543.3, fy: 542.4, cx: 318.2, cy: 271.9}",
        ),
        (
            "mass_kg: 40",
            "cameras: [{distortion: {model: brown_conrady, k: [4, 3, 0, 0, 0.1, 5, 4, 1]}}]",
            "vehicle.cameras.0.distortion.k",
            10,
            "of OpenCV's rational model; give model: rational",
        ),
        (
            "mass_kg: 40",
            "cameras: [{distortion: {model: rational, k: [4, 3, 0, 0, 0.1, 5, 4, 1, 0, 0, 0, 0]}}]",
            "vehicle.cameras.0.distortion.k",
            10,
            "thin prisms and tilted sensors",
        ),
        (
            "mass_kg: 40",
            "cameras: [{distortion: {model: radtan, k: [0.1, 0.2, 0]}}]",
            "vehicle.cameras.0.distortion.k",
            10,
            "has 3 coefficients; give k1, k2, p1, p2 and perhaps k3",
        ),
        (
            "mass_kg: 40",
            "cameras: [{distortion: {model: radtan, k: [0.1, 0.2, 0, x]}}]",
            "vehicle.cameras.0.distortion.k.3",
            10,
            "Give a number",
        ),
        (
            "mass_kg: 40",
            "cameras: [{distortion: {model: double_sphere, k: [-0.2, 0.59]}}]",
            "vehicle.cameras.0.distortion.k",
            10,
            "xi",
        ),
        (
            "mass_kg: 40",
            "cameras: [{distortion: {model: omni, k: [1.2]}}]",
            "vehicle.cameras.0.distortion",
            10,
            "double_sphere",
        ),
        (
            "mass_kg: 40",
            "cameras: [{image_size: [640, 480]}]",
            "vehicle.cameras.0.image_size",
            10,
            "Here it is resolution: Width and height of the image [pixels].",
        ),
        ("mass_kg: 40", "lights: [{power_w: 100}]", "vehicle.lights.0.power_w", 10, "Here it is intensity: Radiant"),
        ("spp: 8", "samples: 8", "render.samples", 14, "Here it is spp: "),
        ("kind: pipe, radius: 0.15, length: 2.0", "mesh: a.ply", "objects.0.mesh", 3, "Here it is file: "),
        ("material: steel", "material: steal", "objects.0.material", 3, "(there are: steel). Did you mean 'steel'?"),
        (
            "mass_kg: 40",
            "lights: [{kind: led_flood}]",
            "vehicle.lights.0",
            10,
            "led_flood is a file: give kind: profile and file: led_flood",
        ),
        (
            "mass_kg: 40",
            "lights: [{kind: led-flood}]",
            "vehicle.lights.0",
            10,
            "led-flood is a file: give kind: profile and file: led_flood",
        ),
        ("kind: pipe, radius: 0.15, length: 2.0", "file: a.ply, unit: mm", "objects.0.unit", 3, "Give scale: 0.001"),
        (
            "kind: pipe, radius: 0.15, length: 2.0",
            "file: a.ply, units: feet",
            "objects.0.units",
            3,
            "Give scale: 0.3048",
        ),
        (
            "kind: pipe, radius: 0.15, length: 2.0",
            "file: a.ply, unit: px",
            "objects.0.unit",
            3,
            "Give scale, metres in one unit of the file",
        ),
        (
            "kind: pipe, radius: 0.15, length: 2.0",
            "file: a.ply, up_axis: -y",
            "objects.0.up_axis",
            3,
            "Give y and turn it upside down: rotation_euler_deg: [180, 0, 0]",
        ),
        (
            "kind: pipe, radius: 0.15, length: 2.0",
            "file: a.ply, up_axis: Y",
            "objects.0.up_axis",
            3,
            "Did you mean 'y'?",
        ),
        (
            "kind: pipe, radius: 0.15, length: 2.0",
            "file: a.ply, up_axis: w",
            "objects.0.up_axis",
            3,
            "Known here: x, y, z",
        ),
        (
            "  principled: {density: 0.125, color: [0.1, 0.2, 0.3], absorption_color: [0, 0.4, 1], anisotropy: 0.8}",
            "  jerlov: 3c",
            "water.jerlov",
            8,
            "Give {type: 3C}.",
        ),
        (
            "  principled: {density: 0.125, color: [0.1, 0.2, 0.3], absorption_color: [0, 0.4, 1], anisotropy: 0.8}",
            "  jerlov: 2C",
            "water.jerlov",
            8,
            "Give {type: I}, or one of IA, IB, II, III, 1C",
        ),
        (
            "  principled: {density: 0.125, color: [0.1, 0.2, 0.3], absorption_color: [0, 0.4, 1], anisotropy: 0.8}",
            "  jerlov: {type: ic}",
            "water.jerlov.type",
            8,
            "Did you mean 'IC'?",
        ),
        (
            "  waypoints:\n    - {position: [0, 0, 0], look_at: [0, 5, 0]}",
            "  file: a.txt\n  frame: nwu",
            "trajectory.frame",
            13,
            "Give enu, which leaves the axes as they are",
        ),
        # what a value should be, by its key
        (
            "mass_kg: 40",
            "cameras: [{id: right}]",
            "vehicle.cameras.0.id",
            10,
            "'right': should be two letters or digits. Such as M0: Type (M mono",
        ),
        (
            "mass_kg: 40",
            "mass_kg: 18 kg",
            "vehicle.mass_kg",
            10,
            "'18 kg': should be a number from 0.001 to 1e+09. Give the number alone; the unit is kg.",
        ),
        (
            "mass_kg: 40",
            "lights: [{kind: point, intensity: 5}]",
            "vehicle.lights.0.intensity",
            10,
            "5: should be a list of 3 numbers from 0 to 1e+20. Such as [100.0, 100.0, 100.0]: Radiant intensity in "
            "every direction for red, green and blue [W/sr].",
        ),
        (
            "look_at: [0, 5, 0]",
            "look_at: ahead",
            "trajectory.waypoints.0.look_at",
            13,
            "'ahead': should be a list of 3",
        ),
        ("look_at: [0, 5, 0]", "look_at: [0, x, 0]", "trajectory.waypoints.0.look_at.1", 13, "'x': should be a number"),
        (
            "mass_kg: 40",
            "cameras: [{port: {kind: flat, distance_m: 1}, n_water: sea}]",
            "vehicle.cameras.0.n_water",
            10,
            "'sea': should be a number from 1 to 3 or list of 3 numbers from 1 to 3 or block",
        ),
        ("density: 0.125", "density: [1]", "water.principled.density", 8, "should be a number from 0 to 1e+06"),
        (
            "steel: {reflectance: [0.4, 0.4, 0.4]}",
            "steel: {kind: metal, roughness: rough}",
            "materials.steel.roughness",
            6,
            "should be a number from 0 to 1. Give a number.",
        ),
        (
            "steel: {",
            "steel: {roughness: 0.1, ",
            "materials.steel.roughness",
            6,
            "Blocks of kind metal or rust have it: give the kind.",
        ),
        (
            "steel: {",
            "steel: {kind: diffuse, roughness: 0.1, ",
            "materials.steel.roughness",
            6,
            "those of kind diffuse do not. Did you mean 'diffuse_roughness'?",
        ),
        (
            "steel: {reflectance: [0.4, 0.4, 0.4]}",
            "steel: red",
            "materials.steel",
            6,
            "should be a block. Give a block",
        ),
        ("mass_kg: 40", "lights: {kind: spot}", "vehicle.lights", 10, "should be a list of blocks. Begin each"),
        ("mass_kg: 40", "lights: [{cone: 60}]", "vehicle.lights.0.cone", 10, "Did you mean 'cone_deg'?"),
        (
            "mass_kg: 40",
            "body: {kind: boulder}",
            "vehicle.body",
            10,
            "body is a key of vehicles. Known here: id, mass_kg",
        ),
        ("spp: 8", "current: {}", "render.current", 14, "current is a key at the top of the file. Known here: "),
        (
            "objects:",
            "terrain: {heightmap: a.tif}\nobjects:",
            "terrain.heightmap",
            2,
            "Heights on a grid are given as kind: heights and file; docs/terrain.md tells of their keys.",
        ),
        ("kind: pipe, ", "kind: pipe, faces: 2, ", "objects.0.faces", 3, "Known here: "),
    ],
)
def test_a_bad_value_is_named_with_file_line_key_and_remedy(tmp_path, old, new, key, line, says):
    assert SMALL.count(old) == 1
    error = refusal(tmp_path, SMALL.replace(old, new))
    assert Path(error.file).name == "scene.yaml"
    assert (error.key, error.line) == (key, line)
    assert says in error.message
    assert "\n" not in error.message


def test_three_forms_of_water_at_once_are_refused(tmp_path):
    error = refusal(tmp_path, SMALL.replace("water:\n", "water:\n  jerlov: {type: II}\n"))
    assert error.key == "water"
    assert "exactly one" in error.message


def test_the_first_problem_is_told_and_the_others_are_counted(tmp_path):
    error = refusal(tmp_path, SMALL.replace("0.125", "-1").replace("mass_kg: 40", "mass_kg: 0"))
    assert "(1 more problem: vehicle.mass_kg)" in error.message


def test_heights_on_a_grid_are_not_asked_for_the_file_that_the_remedy_speaks_of(tmp_path):
    words = refusal(tmp_path, SMALL.replace("objects:", "terrain: {dem: a.tif}\nobjects:")).message
    assert words.endswith("of their keys.")


def test_keys_that_are_missing_are_told_as_missing(tmp_path):
    """Beside a key with the name of another tool they would else seem to be wrong, too."""
    start = SMALL.index("  principled")
    other = "  coefficients:\n    absorption: [0.1, 0.1, 0.1]\n    b: [0.1, 0.1, 0.1]\n"
    error = refusal(tmp_path, SMALL[:start] + other + SMALL[SMALL.index("vehicle:") :])
    assert error.key == "water.coefficients.absorption"
    assert "unknown key. Here it is sigma_a: Absorption coefficients for red, green and blue [1/m]" in error.message
    assert "(1 more problem: water.coefficients.b; missing: sigma_s, sigma_a)" in error.message


def test_a_key_given_twice_is_refused_since_yaml_would_drop_one(tmp_path):
    error = refusal(tmp_path, SMALL + "render: {spp: 9}\n")
    assert (error.key, error.line) == ("render", 15)
    assert "line 14" in error.message


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("# nothing\n", "is empty"),
        ("- 1\n- 2\n", "is a list"),
        ("hello", "is a str"),
        ("a: [1, 2", "not valid YAML"),
        ("a: b: c", "not valid YAML"),
        ("\ta: 1", "not valid YAML"),
        (b"\x89PNG\r\n\x1a\n\xff\xfe", "not a text file"),
        (b"a: \x00", "not valid YAML"),
        ("a: 2021-13-45", "not valid YAML"),
        ("a: !!python/object:os.system {}", "not valid YAML"),
        ("a: &x [*x]", "an alias stands for a block that it lies in"),
    ],
)
def test_what_is_no_scene_file_is_refused_in_one_line(tmp_path, text, says):
    error = refusal(tmp_path, text)
    assert says in error.message
    assert "\n" not in error.message


def test_a_missing_scene_file_and_a_folder_are_refused(tmp_path):
    for path in (tmp_path / "nowhere.yaml", tmp_path):
        with pytest.raises(InputError, match="scene file"):
            load_scene(path)


# ------------------------------------------------------------------------------------------------------- overrides


def test_overrides_reach_into_blocks_and_lists_and_make_blocks(tmp_path):
    scene = load_scene(
        write(tmp_path, SMALL),
        [
            "objects.0.scale=2",
            "render.exposure.A=constant",
            "water=none",
            "vehicle.cameras=[{id: L0}, {id: R0, position: [0.1, 0, 0]}]",
        ],
    )
    assert scene.objects[0].scale == 2.0
    assert scene.render.exposure.A == "constant"
    assert scene.water == "none"
    assert [camera.id for camera in scene.vehicle.cameras] == ["L0", "R0"]


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("vehicle.camera.0.resolution=[96, 54]", "vehicle.camera: unknown key. Did you mean 'cameras'?"),
        ("render.spp", "key.path=value"),
        ("=3", "key.path=value"),
        ("render..spp=3", "key.path=value"),
        ("objects.7.scale=2", "0 to 1"),
        ("objects.x.scale=2", "0 to 1"),
        ("objects.7=2", "0 to 1"),
        ("name.x=1", "no block"),
        ("name.x.y=1", "no block"),
        ("render.spp=[1", "not valid YAML"),
        ("render.ssp=3", "Did you mean 'spp'?"),
        ("render.spp=0", "at least 0.25"),
        ("seed=-1", "at least 0"),
    ],
)
def test_a_bad_override_is_blamed_itself(tmp_path, override, says):
    error = refusal(tmp_path, SMALL, [override])
    assert str(error.file) == f"--set {override}"
    assert says in error.message


def test_an_override_of_a_block_leaves_what_an_alias_takes_from_it(tmp_path):
    left = "&left {id: L0, vignetting: {kind: polynomial, coefficients: [-0.3]}}"
    text = SMALL.replace("mass_kg: 40", f"cameras: [{left}, {{<<: *left, id: R0}}]")
    scene = load_scene(write(tmp_path, text), ["vehicle.cameras.0.vignetting.coefficients.0=-0.1"])
    assert [camera.vignetting.coefficients for camera in scene.vehicle.cameras] == [(-0.1,), (-0.3,)]


def test_an_override_is_blamed_and_not_the_line_of_the_file_that_it_replaced(tmp_path):
    """Items of a list that was replaced had lines; and a block may be wrong only together with what was set in it."""
    text = SMALL.replace("{spp: 8, denoise: none}", "{outputs: [A, B, C], denoise: none}")
    error = refusal(tmp_path, text, ["render.outputs=[A,Q]"])
    assert (str(error.file), error.line) == ("--set render.outputs=[A,Q]", None)
    error = refusal(tmp_path, text, ["vehicle.cameras=[{id: L0}]", "vehicle.cameras.0.focal_mm=0"])
    assert (str(error.file), error.line) == ("--set vehicle.cameras.0.focal_mm=0", None)
    error = refusal(tmp_path, text, ["water.jerlov={type: II}"])
    assert (Path(error.file).name, error.line) == ("scene.yaml", 7)
    assert "(with --set water.jerlov={type: II}). To replace the whole block" in error.message
    told = refusal(tmp_path, text, ["water.jerlov.type=II"]).message  # which makes the block jerlov, too
    assert told.count("water.jerlov.type=II") == 1


def test_a_unit_in_a_value_is_told(tmp_path):
    error = refusal(tmp_path, SMALL, ["trajectory.speed=0.5 m/s"])
    assert error.message.endswith(
        "trajectory.speed = '0.5 m/s': should be a number above 0. Give the number alone; the unit is m/s."
    )


@pytest.mark.parametrize("tolerance", ["0", "-1", "-0.0", ".nan", "1.5"])
def test_a_tolerance_that_nothing_can_keep_is_refused(tmp_path, tolerance):
    assert refusal(tmp_path, SMALL, [f"render.tolerance={tolerance}"]).key == "render.tolerance"
    assert refusal(tmp_path, SMALL.replace("spp: 8", f"tolerance: {tolerance}")).line == 14


@pytest.mark.parametrize("value", ["{}", "{tolerance_px: 1, depth_steps: null}"])
def test_a_key_without_effect_loads_and_a_note_says_so(tmp_path, value):
    with pytest.warns(UserWarning, match="render.level_of_detail has no effect any more: every triangle") as noted:
        scene = load_scene(write(tmp_path, SMALL), [f"render.level_of_detail={value}"])
    assert noted[0].filename == __file__
    plain = scene_to_dict(load_scene(write(tmp_path, SMALL)))
    assert scene_to_dict(scene) == plain
    with warnings.catch_warnings(action="error"):  # datasets of old keep such scenes, and are read without a word
        old = scene_from_dict(plain | {"render": plain["render"] | {"level_of_detail": {"depth_steps": None}}})
    assert scene_to_dict(old) == plain


def test_values_may_be_anchored_and_merged(tmp_path):
    text = SMALL.replace("{kind: bolt, size: M24}", "&bolt {kind: bolt, size: M24}\n  - {<<: *bolt, size: M30}")
    assert [o.size for o in load_scene(write(tmp_path, text)).objects[1:]] == ["M24", "M30"]
    assert yaml.safe_load(text)["objects"][2]["kind"] == "bolt"
