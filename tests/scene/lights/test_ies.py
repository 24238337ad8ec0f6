"""IES LM-63 as people have it: every symmetric form and type, against a second reading; texts; and what is refused."""

import numpy as np
import pytest
import warp as wp
from chance import run
from ies_by_hand import ies_text, intensity_by_hand, measured
from scipy.spatial.transform import Rotation

from varos_warp.cli.facts import print_profiles
from varos_warp.errors import InputError
from varos_warp.kernels.world.lights import light as lights
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import transform
from varos_warp.scene.info import light_info
from varos_warp.scene.lights.distribution import distribution, of_profile
from varos_warp.scene.lights.goniometry import MOST_PLANES, NODES
from varos_warp.scene.lights.profiles import read_profile
from varos_warp.scene.lights.records import Lights
from varos_warp.scene.optics.ports import transmitted

STEP_DEG = 15.0
DOWN, ALL, SIDES = np.arange(0.0, 91.0, STEP_DEG), np.arange(0.0, 181.0, STEP_DEG), np.arange(-90.0, 91.0, STEP_DEG)
FORMS = {
    "C, one plane": ("C", DOWN, [0.0]),
    "C, quadrants": ("C", DOWN, DOWN),
    "C, halves about 0 to 180": ("C", ALL, ALL),
    "C, halves about 90 to 270": ("C", DOWN, np.arange(90.0, 271.0, STEP_DEG)),
    "C, a full turn": ("C", ALL, np.arange(0.0, 361.0, STEP_DEG)),
    "C, steps of 22.5": ("C", DOWN, np.arange(0.0, 361.0, 22.5)),
    "C, upwards only": ("C", np.arange(90.0, 181.0, STEP_DEG), np.arange(0.0, 361.0, STEP_DEG)),
    "B": ("B", SIDES, SIDES),
    "B, left as right": ("B", SIDES, DOWN),
    "B, above as below": ("B", DOWN, DOWN),
    "A": ("A", SIDES, SIDES),
    "A, left as right": ("A", SIDES, DOWN),
}
RESAMPLED = 6.0 * np.radians(STEP_DEG) * np.radians(360.0 / MOST_PLANES + 180.0 / NODES) / 4.0
"""Share of the peak that a table may be off where the file has a kink: its slope jumps by the second derivative times
the file's step, and linear steps across it lose a quarter of that times their length."""


def lamp_scene(folder, text, **keys):
    (folder / "lamp.ies").write_text(text)
    light = {"kind": "profile", "file": "lamp.ies", "intensity": [1.0] * 3, **keys}
    return scene_from_dict({"vehicle": {"lights": [light]}, "trajectory": {"poses": [{"position": [0, 0, 0]}]}}, folder)


def file_of(folder, text, **how):
    (folder / "lamp.ies").write_text(text, **how)
    return read_profile(folder / "lamp.ies", "file")


@wp.kernel(enable_backward=False)
def look(
    records: wp.array(dtype=lights.Light),
    p: wp.array(dtype=wp.vec3),
    sent: wp.array(dtype=float),
    in_beam: wp.array(dtype=float),
):
    i = wp.tid()
    sent[i] = lights.light_sample(records[0], p[i]).L[0]
    in_beam[i] = lights.light_towards(records[0], p[i], wp.length(p[i] - records[0].position))[0]


@pytest.mark.parametrize("form", FORMS)
def test_a_lamp_shines_as_its_file_says(tmp_path, form):
    """Towards 20 directions, in a scene with a tilted lamp on a turned vehicle, through the kernels."""
    kind, vertical, horizontal = FORMS[form]
    text = ies_text(kind, vertical, horizontal, measured(kind, vertical, horizontal))
    direction, up = np.array([0.3, 0.8, -0.4]), np.array([0.1, 0.5, 1.0])
    scene = lamp_scene(tmp_path, text, direction=direction.tolist(), up=up.tolist(), position=[0.2, -0.1, 0.4])
    T_w_v = transform(Rotation.from_euler("xyz", [20, -30, 110], degrees=True).as_matrix(), [3.0, -2.0, 1.0])
    axis = direction / np.linalg.norm(direction)
    up = up - (up @ axis) * axis
    up /= np.linalg.norm(up)
    axes = np.array([axis, up, np.cross(axis, up)])
    towards = np.random.default_rng(3).normal(size=(20, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    p = (2.0 * towards @ axes + [0.2, -0.1, 0.4]) @ T_w_v[:3, :3].T + T_w_v[:3, 3]
    found = Lights(scene, "cpu")
    sent, in_beam = run(look, [found.at(T_w_v, np.zeros(3)), p], [float, float], dim=20)
    expected = intensity_by_hand(text, *towards.T)
    peak = measured(kind, vertical, horizontal).max()
    np.testing.assert_allclose(sent, expected / peak, atol=RESAMPLED)
    lit = expected > 0.0  # in_beam is asked for within the cone only
    np.testing.assert_allclose(in_beam[lit], sent[lit], rtol=1e-4)


def test_a_port_bends_each_half_plane(tmp_path):
    """I_w = I_a T n^2 cos w / cos a in every one, to the linear steps of both tables."""
    kind, vertical, horizontal = FORMS["C, a full turn"]
    text = ies_text(kind, vertical, horizontal, measured(kind, vertical, horizontal))
    plain, behind = lamp_scene(tmp_path, text), lamp_scene(tmp_path, text, port={"kind": "flat"})
    plain, behind = (distribution(scene.vehicle.lights[0], scene) for scene in (plain, behind))
    w, C = np.radians(20.0), np.radians(np.arange(0.0, 360.0, 15.0))
    a = np.arcsin(1.34 * np.sin(w))
    expected = plain.at(a, C) * transmitted(a, (1.0, 1.49, 1.34)) * 1.34**2 * np.cos(w) / np.cos(a)
    np.testing.assert_allclose(behind.gain * behind.at(w, C), expected, rtol=1e-5)


# --------------------------------------------------------------------------------------------------------------- texts


PLAIN = ies_text("C", DOWN, DOWN, measured("C", DOWN, DOWN))
TILTED = "TILT=INCLUDE\n1\n3\n0 45 90\n1 0.95 0.9"


def same(one, other):
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ("polar", "azimuth", "intensity"))


@pytest.mark.parametrize(
    "text",
    [
        PLAIN.replace("IESNA:LM-63-2002", "any lamp"),
        PLAIN.replace("IESNA:LM-63-2002", "IESNA91"),
        PLAIN.replace("IESNA:LM-63-2002", "IES:LM-63-2019"),
        PLAIN.replace("TILT=NONE", "Tilt=None"),
        PLAIN.replace("TILT=NONE", "  tilt = NONE  "),
        PLAIN.replace("[TEST] none", "[OTHER] TILT=none of your business"),
        PLAIN.replace("TILT=NONE", TILTED),
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        PLAIN + "\x1a",
        PLAIN.replace("[TEST] none\n[MANUFAC] none\n", ""),
        PLAIN[: PLAIN.index("TILT")] + PLAIN[PLAIN.index("TILT") :].replace(" ", ",\n"),
        PLAIN[: PLAIN.index("1 -1")] + PLAIN[PLAIN.index("1 -1") :].replace("\n", " "),
    ],
    ids=[
        "1986",
        "1991",
        "2019",
        "Tilt=None",
        "blanks",
        "TILT in a keyword",
        "TILT=INCLUDE",
        "CR LF",
        "CR",
        "ctrl-Z",
        "no keywords",
        "commas and lines",
        "one line",
    ],
)
def test_the_text_of_a_file_may_differ(tmp_path, text):
    assert same(file_of(tmp_path, text, newline=""), file_of(tmp_path, PLAIN))


@pytest.mark.parametrize("encoding", ["latin-1", "utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_a_file_may_be_in_any_usual_encoding(tmp_path, encoding):
    text = PLAIN.replace("[MANUFAC] none", "[MANUFAC] Léuchtenwërk 24°")
    assert same(file_of(tmp_path, text, encoding=encoding), file_of(tmp_path, PLAIN))


def test_nothing_that_only_scales_a_lamp_changes_it(tmp_path):
    """Multiplier, ballast factor, lumens; and the opening is in metres."""
    table = measured("C", DOWN, DOWN)
    scaled = file_of(
        tmp_path, ies_text("C", DOWN, DOWN, table, multiplier=2.5, ballast=0.9, lumens=1200, unit=1, opening="-1 0 0.5")
    )
    plain = file_of(tmp_path, PLAIN)
    assert of_profile(scaled) == of_profile(plain)
    assert scaled.opening_m == pytest.approx((-0.3048, 0.0, 0.1524))


@pytest.mark.parametrize(
    ("header", "edition"),
    [
        ("IESNA:LM-63-2002", "2002"),
        ("IESNA91", "1991"),
        ("own", "1986"),
        ("IESNA:LM-63-1995", "1995"),
        ("IES:LM-63-2019", "2019"),
    ],
)
def test_it_is_told_which_edition_a_file_follows(tmp_path, header, edition):
    profile = file_of(tmp_path, ies_text("C", DOWN, [0.0], measured("C", DOWN, [0.0]), header=header))
    assert profile.describe() == {
        "source": f"IES LM-63-{edition}, type C, 1 horizontal angle",
        "round": True,
        "uneven": 0.0,
        "ends_at_deg": 90.0,
        "opening_m": [0.0, 0.0, 0.0],
        "notes": [],
    }


@pytest.mark.parametrize(
    ("text", "note"),
    [
        (PLAIN.replace("TILT=NONE", TILTED), "factors of tilt"),
        (ies_text("B", DOWN, SIDES, measured("B", DOWN, SIDES)), "shine below as above"),
    ],
)
def test_it_is_told_what_a_file_leaves_to_its_reader(tmp_path, text, note):
    (told,) = file_of(tmp_path, text).describe()["notes"]
    assert note in told


def test_info_tells_by_how_much_a_lamp_changes_around_its_axis(tmp_path, capsys):
    rows = np.array([[1000.0, 800.0, 0.0], [1000.0, 788.0, 0.0]])
    scene = lamp_scene(tmp_path, ies_text("C", [0, 45, 90], [0, 90], rows))
    facts = light_info(scene.vehicle.lights[0], scene)
    assert facts["profile"]["uneven"] == 0.012
    print_profiles([{"kind": "spot"}, facts])
    assert capsys.readouterr().out == (
        "light 1: lamp.ies, IES LM-63-2002, type C, 2 horizontal angles, up to 90 degrees from the axis, changes by up "
        "to 1.2 % of the peak around the axis: round, by the mean\n"
    )


@pytest.mark.parametrize(("off", "is_round"), [(0.019, True), (0.021, False)])
def test_a_lamp_that_hardly_changes_around_its_axis_is_round_and_it_is_told_by_how_much(tmp_path, off, is_round):
    rows = np.array([[1000.0, 800.0, 0.0], [1000.0, 800.0 - 1000.0 * off, 0.0]])
    profile = file_of(tmp_path, ies_text("C", [0, 45, 90], [0, 90], rows))
    assert (profile.is_round, profile.describe()["uneven"]) == (is_round, off)
    if is_round:
        np.testing.assert_allclose(profile.intensity, rows.mean(axis=0)[None])


def test_a_full_turn_may_leave_out_its_end(tmp_path):
    """345 degrees is followed by 0; at 352.5 is the mean of both, to the table's linear steps."""
    horizontal = np.arange(0.0, 346.0, 15.0)
    table = measured("C", DOWN, horizontal)
    profile = file_of(tmp_path, ies_text("C", DOWN, horizontal, table))
    shape = of_profile(profile)
    mean = 0.5 * (table[0, 3] + table[-1, 3]) / table.max()
    assert shape.at(np.radians(45.0), np.radians(352.5)) == pytest.approx(mean, abs=RESAMPLED)


# ------------------------------------------------------------------------------------------------------------- refused


FLAT = np.array([[100.0, 50.0, 0.0], [100.0, 10.0, 0.0]])


def flat(horizontal, vertical=(0, 45, 90), kind="C", rows=FLAT):
    return ies_text(kind, vertical, horizontal, rows)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no line TILT=NONE"),
        ("IESNA\n1 2 3", "no line TILT=NONE"),
        (flat([0, 90]).replace("TILT=NONE", "TILT=my lamp.tlt"), "another file: TILT=my lamp.tlt"),
        ("TILT=INCLUDE\n1 2 3", "ends within the angles and factors of tilt"),
        ("TILT=NONE\n1 2 3", "ends within the number of vertical angles"),
        (flat([0, 90])[:-12], "ends within the intensities: 6 are announced, 5 are there"),
        (flat([0, 90]) + "7\n", "1 more numbers than 2 times 3 intensities"),
        (flat([0, 90]).replace("50.0", "5x.0"), "the intensities: '5x.000000' is not a number"),
        (flat([0, 90]).replace("50.000000", "nan"), "'nan' is not a number"),
        (flat([0, 90]).replace("50.000000", "1e999"), "'1e999' is not a number"),
        (flat([0, 90]).replace("50.000000", "-50"), "not 0 or more"),
        (flat([0, 90], rows=0.0 * FLAT), "not 0 or more"),
        (ies_text("C", [0, 45, 90], [0, 90], FLAT, multiplier=0.0), "candela multiplier is 0"),
        (ies_text("C", [0, 45, 90], [0, 90], FLAT, ballast=-1.0), "ballast factor is -1"),
        (flat([0, 90]).replace("1 -1 1 3 2 1 2", "1 -1 1 3.5 2 1 2"), "number of vertical angles is 3.5"),
        (flat([0, 90]).replace("1 -1 1 3 2 1 2", "1 -1 1 1 2 1 2"), "number of vertical angles is 1"),
        (flat([0, 90]).replace("1 -1 1 3 2 1 2", "1 -1 1 3 0 1 2"), "number of horizontal angles is 0"),
        (flat([0, 90]).replace("1 -1 1 3 2 1 2", "1 -1 1 3 999999999999 1 2"), "ends within the horizontal angles"),
        (flat([0, 90]).replace("1 -1 1 3 2 1 2", "1 -1 1 3 2 4 2"), "type of photometry is 4"),
        (flat([0, 90], (0, 90, 45)), "vertical angles are not increasing"),
        (flat([0, 90], (5, 45, 90)), "vertical angles go from 5 to 90"),
        (flat([0, 90], (0, 45, 190)), "vertical angles go from 0 to 190"),
        (flat([90, 0]), "horizontal angles are not increasing"),
        (flat([0, 45]), "horizontal angles go from 0 to 45"),
        (flat([180, 360]), "horizontal angles go from 180 to 360"),
        (flat([0, 181]), "do not close a full turn"),
        (flat([0, 400]), "do not close a full turn"),
        (flat([0, 360]), "0 and 360 are one, but differ by 40%"),
        (flat([-90, 90], kind="B", vertical=(5, 45, 90)), "vertical angles go from 5 to 90"),
        (flat([0], kind="B", rows=FLAT[:1]), "horizontal angles go from 0 to 0"),
        (flat([-90, 100], kind="B", vertical=(-90, 0, 90)), "horizontal angles go from -90 to 100"),
    ],
)
def test_a_file_that_is_no_lamp_is_refused_with_file_key_and_reason(tmp_path, text, why):
    with pytest.raises(InputError) as refused:
        file_of(tmp_path, text)
    assert why in refused.value.message
    assert refused.value.key == "file"
    assert refused.value.file == tmp_path / "lamp.ies"
    assert refused.value.remedy


def test_a_port_before_a_lamp_that_shines_backwards_only_is_refused(tmp_path):
    kind, vertical, horizontal = FORMS["C, upwards only"]
    text = ies_text(kind, vertical, horizontal, measured(kind, vertical, horizontal))
    scene = lamp_scene(tmp_path, text, port={"kind": "flat"})
    with pytest.raises(InputError, match=r"lights\.0\.port: .* no light leaves"):
        distribution(scene.vehicle.lights[0], scene)


@pytest.mark.parametrize("up", [[0, 0, 0], [0, 2, 0], [0, -1, 1e-4]])
def test_an_up_without_a_part_across_the_direction_is_refused(tmp_path, up):
    with pytest.raises(InputError, match=r"lights\.0\.up"):
        lamp_scene(tmp_path, PLAIN, up=up)


@pytest.mark.parametrize("lit", [(0.0,), (90.0, 0.0, 90.0)])
def test_a_beam_between_the_steps_of_a_table_is_refused_by_file_and_key(tmp_path, lit):
    """Backwards, where steps even in the sine of half the angle are 7 degrees wide."""
    vertical = [0.0, 176.0, 176.1, 176.2, 180.0]
    rows = np.zeros((3, 5))
    rows[: len(lit), 2] = np.array(lit) + 10.0
    planes = [0, 0, 0] if len(lit) == 1 else [0, 1, 2]
    scene = lamp_scene(tmp_path, ies_text("C", vertical, [0.0, 90.0, 180.0], rows[planes]))
    with pytest.raises(InputError, match=r"lights\.0\.file: its brightest beam is so narrow") as refused:
        distribution(scene.vehicle.lights[0], scene)
    assert refused.value.file == tmp_path / "lamp.ies"
