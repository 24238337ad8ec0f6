"""How lights shine: profiles from files, what a port makes of them, and what kernels make of both."""

import numpy as np
import pytest
import warp as wp
from scipy.integrate import quad

from varos_warp.dataset.write.texts import sources
from varos_warp.errors import InputError
from varos_warp.kernels.world.lights.light import falloff
from varos_warp.kernels.world.lights.record import Light
from varos_warp.render.field.open_water import CONES_DEG
from varos_warp.scene.checks import check_scene
from varos_warp.scene.description.lights import LampPort
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.lights.distribution import NODES, Distribution, behind_port, distribution, of_profile, of_table
from varos_warp.scene.lights.profiles import read_profile
from varos_warp.scene.lights.records import light_axes, light_record
from varos_warp.scene.optics.ports import snell, transmitted

IES = """IESNA:LM-63-2002
[TEST] none
TILT=NONE
1 -1 2.5 5 {planes} 1 2 0.1 0.1 0
1 1 20
0 15 30 60
90
{horizontal}
{rows}
"""


def ies(*rows):
    horizontal = " ".join(str(90 * i) for i in range(len(rows)))
    return IES.format(planes=len(rows), horizontal=horizontal, rows="\n".join(rows))


ROW = "100, 80 40 2 0"


def power(shape: Distribution) -> float:
    """Integral over the sphere, in units of 2 pi and of the light's own peak; Gauss-Legendre between the nodes."""
    x, w = np.polynomial.legendre.leggauss(4)
    low, high = shape.angles[:-1, None], shape.angles[1:, None]
    at = 0.5 * (low + high) + 0.5 * (high - low) * x
    return shape.gain * float((0.5 * (high - low) * w * shape.at(at) * np.sin(at)).sum())


# ------------------------------------------------------------------------------------------------------------- files


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", "angle_deg,intensity\n0,100\n15,80\n30,40\n60,2\n90,0\n"),
        ("scaled.csv", "# measured\nintensity,angle_deg,note\n5,0,x\n4,15\n2,30\n0.1,60\n0,90\n"),
        ("one.ies", ies(ROW)),
        ("planes.IES", ies(ROW, "100 81 40 2 0", "100 79 40 2 0")),
    ],
)
def test_files_of_one_lamp_are_one_distribution(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    shape = of_profile(read_profile(tmp_path / name, "file"))
    angle = np.radians([0.0, 7.5, 15.0, 40.0, 80.0, 95.0])
    step = 2.0 * np.sin(np.pi / 4) / NODES  # of the profile, in radians near the axis: a kink is off by a slope of it
    np.testing.assert_allclose(shape.at(angle), [1.0, 0.9, 0.8, 0.4 - 0.38 / 3, 0.02 / 3, 0.0], atol=2.0 * step)
    assert shape.gain == 1.0
    assert np.degrees(shape.half_angle) == pytest.approx(90.0)


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("a.csv", "angle_deg,candela\n0,1\n9,1\n", "no column intensity"),
        ("a.csv", "angle_deg,intensity\n0,1\n10,-1\n", "intensity is negative"),
        ("a.csv", "angle_deg,intensity\n0,0\n10,0\n", "0 everywhere"),
        ("a.csv", "angle_deg,intensity\n10,1\n0,1\n", "does not increase"),
        ("a.ies", "IESNA\n1 2 3", "no line TILT=NONE"),
        ("a.ies", "TILT=NONE\n1 2 3", "ends within"),
        ("a.ldt", "x", "not read, EULUMDAT. Convert it to IES LM-63"),
        ("a.XML", "<x/>", "not read, XML"),
        (None, "", "there is no such"),
    ],
)
def test_files_that_are_no_profile_are_refused(tmp_path, name, text, why):
    if name:
        (tmp_path / name).write_text(text)
    light = {"kind": "profile", "file": name or "none.csv"}
    poses = [{"position": [0, 0, 0]}]
    scene = scene_from_dict({"vehicle": {"lights": [light]}, "trajectory": {"poses": poses}}, tmp_path)
    with pytest.raises(InputError, match=why) as refused:
        check_scene(scene, [])
    assert refused.value.key == "vehicle.lights.0.file"


@pytest.mark.parametrize(
    ("file", "says"),
    [("led-flood", "Did you mean 'led_flood'?"), ("torch", "a lamp that comes with the package: led_flood.")],
)
def test_names_that_are_no_lamp_of_the_package_are_told_which_there_are(tmp_path, file, says):
    scene = scene_from_dict(
        {
            "vehicle": {"lights": [{"kind": "profile", "file": file}]},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
        },
        tmp_path,
    )
    with pytest.raises(InputError) as refused:
        check_scene(scene, [])
    assert says in refused.value.message


def test_a_light_that_equals_another_is_named_by_its_own_key():
    two = [{"kind": "spot"}, {"kind": "spot"}]
    scene = scene_from_dict(
        {
            "vehicles": [
                {"id": vehicle, "lights": two, "trajectory": {"poses": [{"position": [0, 0, 0]}]}} for vehicle in "ab"
            ]
        }
    ).observed_by("b")
    assert [scene.key_of_light(light) for light in scene.lights] == [
        f"vehicles.{vehicle}.lights.{i}" for vehicle in (1, 0) for i in (0, 1)
    ]


# -------------------------------------------------------------------------------------------------------------- ports


def test_a_cone_behind_a_port_is_narrower_and_brighter():
    """Sea notes 2.3: 65 degrees become 47.28, 1.796 on the axis and 1.950 at the edge, before Fresnel's losses."""
    cone = Distribution(np.radians(32.5))
    shape = behind_port(cone, LampPort(n_glass=1.34, n_water=1.34))
    T = transmitted(np.array([0.0, np.radians(32.5)]), (1.0, 1.34))
    assert np.degrees(2.0 * shape.half_angle) == pytest.approx(47.28, abs=0.005)
    assert shape.gain * shape.profile[0] == pytest.approx(1.7956 * T[0])
    assert shape.gain * shape.profile[-1] == pytest.approx(1.9503 * T[1], rel=1e-4)


def test_what_an_interface_lets_through():
    """Air to water of 1.333 at 0, 30 and 45 degrees, and nothing at 90."""
    np.testing.assert_allclose(
        1.0 - transmitted(np.radians([0.0, 30.0, 45.0, 90.0]), (1.0, 1.333)),
        [0.02037318784, 0.02143646586, 0.0278983646, 1.0],
        atol=1e-9,
    )
    assert np.degrees(snell(np.pi / 2, 1.0, 1.333)) == pytest.approx(48.6066263917)


@pytest.mark.parametrize(
    "own",
    [
        Distribution(np.radians(32.5)),
        Distribution(np.radians(32.5), 0.15),
        Distribution(np.radians(60.0), 1.0),
        of_table(np.radians([0.0, 10.0, 40.0, 70.0]), np.array([1.0, 0.7, 0.1, 0.0])),
    ],
)
@pytest.mark.parametrize("n_glass", [1.0, 1.49, 1.9])
def test_a_port_keeps_the_power_but_for_what_it_reflects(own, n_glass):
    shape = behind_port(own, LampPort(n_glass=n_glass))
    kinks = np.radians([10.0, 40.0, 70.0]) if own.has_profile else None
    sent = quad(
        lambda a: own.at(a) * np.sin(a) * transmitted(a, (1.0, n_glass, 1.34)),
        0.0,
        own.half_angle,
        points=kinks,
        limit=500,
        epsrel=1e-9,
    )[0]
    assert power(shape) == pytest.approx(sent, rel=4.0 / NODES**2 + (1e-4 if own.has_profile else 0.0))


def test_a_light_for_all_directions_lights_a_cone_of_the_critical_angle_behind_a_port():
    """Its intensity falls to the edge like a root, on which linear steps lose half a thousandth of the power."""
    shape = behind_port(Distribution(), LampPort(n_glass=1.49, n_water=1.34))
    assert shape.half_angle == pytest.approx(np.arcsin(1.0 / 1.34))
    sent = quad(lambda a: np.sin(a) * transmitted(a, (1.0, 1.49, 1.34)), 0.0, np.pi / 2, limit=500)[0]
    assert power(shape) == pytest.approx(sent, rel=1e-3)


def test_n_water_of_one_changes_nothing_but_what_the_glass_reflects():
    own = Distribution(np.radians(32.5), 0.15)
    shape = behind_port(own, LampPort(n_glass=1.0, n_water=1.0))
    angle = np.linspace(0.0, 0.6, 50)
    curvature = 6.0 * (2.0 / 0.15) ** 2 + 1.5 * 2.0 / 0.15  # of the soft edge, at most: linear steps lose an eighth
    np.testing.assert_allclose(shape.gain * shape.at(angle), own.at(angle), atol=curvature / 8.0 / NODES**2)


# ------------------------------------------------------------------------------------------------------------- kernels


@wp.kernel
def fall(light: Light, cosine: wp.array(dtype=float), out: wp.array(dtype=float)):
    i = wp.tid()
    out[i] = falloff(light, cosine[i])


@pytest.mark.parametrize(
    "shape",
    [
        Distribution(),
        Distribution(np.radians(32.5)),
        Distribution(np.radians(32.5), 0.15),
        of_table(np.radians([0.0, 20.0, 180.0]), np.array([1.0, 0.3, 0.2])),
        behind_port(Distribution(np.radians(32.5), 0.15), LampPort()),
    ],
)
def test_kernels_see_the_distribution(shape):
    """To float32's rounding of cosines; near the edge of a cone that decides whether a direction is inside."""
    angle = np.linspace(1e-3, np.pi - 1e-3, 997)
    angle = angle[np.abs(angle - shape.half_angle) > 1e-5]
    profile = wp.array(shape.profile, dtype=float, device="cpu")
    light = light_record(shape, np.ones(3), profile=profile)
    got = wp.zeros(len(angle), dtype=float, device="cpu")
    wp.launch(fall, len(angle), [light, wp.array(np.cos(angle), dtype=float, device="cpu")], [got], device="cpu")
    steepest = 3.0 / (1.0 - np.cos(min(shape.half_angle, np.pi))) / max(shape.blend, 0.1)  # over the cosine
    np.testing.assert_allclose(got.numpy(), shape.at(angle), atol=1e-6 + 4e-7 * steepest * NODES)


def scene_of_lights(*lights):
    return scene_from_dict({"vehicle": {"lights": list(lights)}, "trajectory": {"poses": [{"position": [0, 0, 0]}]}})


def test_the_flood_light_of_the_package_has_a_field_and_half_its_peak_at_30_degrees():
    scene = scene_of_lights({"kind": "profile", "file": "led_flood"})
    shape = distribution(scene.vehicle.lights[0], scene)
    np.testing.assert_allclose(shape.at(np.radians([0, 30, 86])), [1.0, 0.5, 0.0], atol=0.01)
    assert np.degrees(2 * shape.half_angle) < CONES_DEG[1]
    assert sources(scene)["led_flood"]


def test_lights_of_one_distribution_share_it():
    scene = scene_of_lights(*({"kind": "spot", "position": [x, 0, 0], "port": {"kind": "flat"}} for x in (-1, 1)))
    one, other = (distribution(light, scene) for light in scene.vehicle.lights)
    assert one == other
    assert len({one, other}) == 1


def test_a_spot_without_a_port_is_written_as_before_there_were_ports():
    """dataset.json of a scene without one, and without disks, has the bytes that it had."""
    scene = scene_of_lights({"kind": "spot"}, {"kind": "spot", "port": {}}, {"kind": "profile", "file": "x.csv"})
    plain, behind, profile = (light.model_dump(mode="json") for light in scene.vehicle.lights)
    assert list(plain) == ["kind", "position", "direction", "cone_deg", "blend", "intensity"]
    assert behind["port"] == {"kind": "flat", "n_glass": 1.49, "n_water": 1.34}
    assert list(profile) == ["kind", "file", "position", "direction", "intensity", "port"]


SHEET = {"kind": "sheet", "normal": [0, 0, 1], "fan_deg": 60.0, "thickness_deg": 0.1}


@pytest.mark.parametrize(
    ("light", "key", "words"),
    [
        ({"kind": "spot", "radius_m": -0.1}, "radius_m", "greater than 0"),
        ({"kind": "spot", "radius_m": 0.0}, "radius_m", "greater than 0"),
        ({"kind": "point", "radius_m": 0.1}, "radius_m", "unknown key"),
        (SHEET | {"radius_m": 0.1}, "radius_m", "unknown key"),
        (SHEET | {"port": {"kind": "flat"}}, "port", "unknown key"),
        (SHEET | {"fan_deg": 0.0}, "fan_deg", "at least 0.1"),
        (SHEET | {"fan_deg": 180.0}, "fan_deg", "at most 170"),
        (SHEET | {"thickness_deg": 0.0}, "thickness_deg", "at least 0.01"),
        ({"kind": "sheet", "normal": [0, 0, 1], "fan_deg": 60.0}, "thickness_deg", "missing"),
        (SHEET | {"normal": [0.0, 0.0, 0.0]}, "normal", "not lie along"),
        (SHEET | {"direction": [0.0, 0.0, -2.0]}, "normal", "not lie along"),
        (SHEET | {"direction": [0.0, 0.0, 0.0]}, "direction", "1e-6 long"),
    ],
)
def test_disks_and_sheets_that_cannot_be_are_refused_with_the_key(light, key, words):
    with pytest.raises(InputError) as error:
        scene_of_lights(light)
    assert f"vehicle.lights.0.{key}" in str(error.value)
    assert words in str(error.value)


def test_the_axes_of_a_sheet_are_its_fan_its_normal_and_its_direction():
    """The normal is made perpendicular; a light of another kind has the axes that it had."""
    sheet, spot = scene_of_lights(
        SHEET | {"direction": [0, 2, 0], "normal": [0.5, 7.0, 0.5]}, {"kind": "spot", "direction": [0, 0, -1]}
    ).vehicle.lights
    half = np.sqrt(0.5)
    np.testing.assert_allclose(light_axes(sheet), [[-half, half, 0], [0, 0, 1], [half, half, 0]], atol=1e-12)
    np.testing.assert_allclose(light_axes(spot)[:, 2], [0, 0, -1], atol=1e-12)
