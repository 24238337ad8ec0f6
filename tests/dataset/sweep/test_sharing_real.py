"""Datasets of a sweep have the bytes of runs of their own, whichever key differs; rendered, without stand-ins."""

import json

import pytest
import yaml
from standins import tree

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.fleet import produce_each
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.run.shared import images_of
from varos_warp.dataset.sweep.run import prepare
from varos_warp.products.images.registry import OUTPUTS as OUTPUTS_BY_LETTER
from varos_warp.scene.description import Scene
from varos_warp.scene.description.looks import LOOKS, LOOKS_OF_WATER, without
from varos_warp.scene.file.load import load_scene, scene_to_dict
from varos_warp.scene.file.schema import find_key

OUTPUTS = ["B", "C", "D", "S", "F", "T", "U"]
LAMP = {"kind": "spot", "position": [0.2, 0.0, 0.1], "direction": [0, 1, -0.3], "cone_deg": 90}
FLASH = LAMP | {"strobe": {"on_s": 0.004, "delay_s": 0.01}}
BASE = {
    "seed": 3,
    "surface_depth_m": 20.0,
    "current": {"velocity": [0.1, 0.0, 0.0]},
    "terrain": {"kind": "procedural", "size_m": 12.0, "resolution": 17, "relief_m": 0.5, "material": "ground"},
    "objects": [
        {"kind": "pipe", "radius": 0.2, "length": 2.0, "position": [0.3, 3.0, 1.2], "material": "steel"},
        {
            "kind": "boulder",
            "diameter": 0.5,
            "material": "steel",
            "path": [{"time_s": 0.0, "position": [-0.6, 2.5, 1.0]}, {"time_s": 1.0, "position": [0.4, 2.5, 1.0]}],
        },
    ],
    "scatter": [{"object": {"kind": "boulder", "diameter": 0.4, "material": "steel"}, "count": 8, "circle": [0, 3, 2]}],
    "growth": [{"on": ["terrain"], "kind": "pebble", "per_m2": 3, "cluster": 0, "size_m": [0.1, 0.2], "seed": 2}],
    "materials": {
        "ground": {"kind": "diffuse", "reflectance": [0.4, 0.35, 0.3]},
        "steel": {"kind": "diffuse", "reflectance": [0.2, 0.3, 0.5]},
    },
    "water": {"jerlov": {"type": "II"}},
    "vehicle": {
        "lights": [FLASH],
        "cameras": [
            {
                "id": "M0",
                "position": [0, 0.2, 0],
                "rotation_euler_deg": [-15, 0, 0],
                "resolution": [32, 18],
                "exposure": {"time_s": 0.03, "readout_s": 0.02},
            }
        ],
        "dvl": {"position": [0, 0, -0.1]},
    },
    "trajectory": {"waypoints": [{"position": [0, 0, 2.0]}, {"position": [0, 0.6, 2.0]}], "duration_s": 0.5},
    "render": {"outputs": OUTPUTS, "spp": 1, "spp_b": 1, "denoise": "none", "denoise_b": "none"},
}
BLOCKS = {
    "name": "other",
    "sequence": "07",
    "seed": 4,
    "terrain.seed": 2,
    "objects.0.radius": 0.3,
    "scatter.0.seed": 2,
    "growth.0.seed": 3,
    "materials.steel.reflectance": [0.6, 0.3, 0.1],
    "water.jerlov.type": "3C",
    "particles": [{"share": 0.0005}],
    "surface_depth_m": 30.0,
    "gravity": 9.7,
    "current.velocity": [0.3, 0.1, 0.0],
    "vehicle.lights": [LAMP],
    "trajectory.speed": 0.4,
    "render.depth_range_m": [0.0, 9.0],
}
"""A key in every block of a scene with one vehicle."""
OF_LIGHT = {
    "name": "seen otherwise",
    "water": "none",
    "particles": [],
    "vehicle.lights": [LAMP, LAMP],
    "render.tolerance": 0.5,
    "render.max_seconds_per_frame": 3.0,
    "render.spp": 2,
    "render.max_scatterings": 1,
    "render.max_bounces": 2,
    "render.layers": ["direct"],
    "render.integrator": "path",
    "render.denoise": "nlm",
    "render.exposure.A": 2.0,
    "render.exposure.white_balance": "lamps",
    "vehicle.cameras.0.exposure.gain": 3.0,
    "vehicle.cameras.0.exposure.white_balance": "grey_world",
    "render.noise": "machine_vision",
    "render.linear_exr": True,
}
"""Another value of every key from which light in water follows; `OF_B` has those of light without water."""
OF_B = {"render.spp_b": 2, "render.denoise_b": "nlm", "render.exposure.B": 0.3, "render.dither": "tpdf"}
KEPT = {"name": "BCDSFU", "water.jerlov.type": "BCDSFU", "particles": "BCDSFU", "vehicle.lights": "BCDSF"}
"""Of blocks what versions that differ there share; all others have nothing in common with the first."""


@pytest.fixture
def stand_ins():
    """None here."""


LIT = [
    "render.outputs=[A,B,C,D,S,F]",
    "render.integrator=path",
    "render.layers=[direct, single]",
    "vehicle.lights.0.strobe=null",
    "vehicle.cameras.0.exposure={}",
    "particles=[]",
]
"""Of images whose kernels are soon compiled."""


@pytest.fixture(scope="module")
def swept(tmp_path_factory, request):
    """A sweep of all of these versions, and what it says of them."""
    folder = tmp_path_factory.mktemp("swept")
    (folder / "scene.yaml").write_text(yaml.safe_dump(BASE | {"particles": [{"share": 0.0003}]}))
    versions = {
        "base": {},
        **{key: {key: value} for key, value in BLOCKS.items()},
        "light": OF_LIGHT,
        "looks": OF_LIGHT | OF_B,
    }
    (folder / "waters.yaml").write_text(yaml.safe_dump({"versions": versions}, sort_keys=False))
    job = prepare(
        folder / "scene.yaml", [str(folder / "waters.yaml")], folder / "out", device="cpu", frames=slice(0, 2)
    )
    job.run(quiet=True)
    return job, folder, {entry["name"]: entry["datasets"][0] for entry in job.manifest.content()["versions"]}


def test_every_block_of_a_scene_is_among_those_that_differ():
    assert {key.split(".")[0] for key in BLOCKS} == {*Scene.model_fields} - {
        "vehicles",
        "observer",
        "vehicle",
        "render",
    } | {"vehicle", "render"}


def test_every_key_that_is_said_to_decide_looks_only_is_there_and_differs(swept):
    job, *_ = swept
    scenes = {unit.version.name: scene_to_dict(unit.scene) for unit in job.units}
    for key in LOOKS:
        assert find_key(key.replace("*.", ""))
        assert "*" in key or key in (OF_LIGHT if key in LOOKS_OF_WATER else OF_B), key
        looks, base = (without(scenes[name], {*LOOKS} - {key}) for name in ("looks", "base"))
        assert "*" in key or looks != base, key


@pytest.mark.parametrize("name", ["base", *BLOCKS, "light", "looks"])
def test_a_version_has_the_bytes_of_a_run_of_its_own(swept, tmp_path, name):
    job, *_ = swept
    unit = next(unit for unit in job.units if unit.version.name == name)
    produce(unit.scene, tmp_path / "alone", device="cpu", frames=slice(0, 2), quiet=True)
    assert tree(unit.root) == tree(tmp_path / "alone")


def test_versions_share_what_does_not_follow_from_what_differs_and_no_more(swept):
    _, _, told = swept
    kept = {name: "".join(entry["shared"]) for name, entry in told.items() if name not in ("light", "looks")}
    assert kept == {name: "".join(KEPT.get(name, "")) for name in kept}
    assert "".join(told["light"]["shared"]) == "BCDSF"
    assert told["looks"]["shared"] == {**dict.fromkeys("CDSF", "base"), "U": "light"}  # whose lights are the same


def images(unit, letter):
    return [path.read_bytes() for path in images_of(unit.layout, unit.scene, letter, range(2))]


def test_what_differs_can_be_seen(swept):
    """So that equal bytes say something: of strobes in U, of water in T, of surfaces in all others."""
    job, *_ = swept
    units = {unit.version.name: unit for unit in job.units}
    for letter, name in {
        "U": "vehicle.lights",
        "T": "water.jerlov.type",
        "B": "materials.steel.reflectance",
        **dict.fromkeys("CDSF", "objects.0.radius"),
    }.items():
        assert images(units["base"], letter) != images(units[name], letter), letter
    assert Dataset(units["base"].root).frame(0).D.min() < 5.0


def test_what_a_product_says_wrongly_of_itself_is_noticed_and_made_anew(swept, tmp_path, monkeypatch, capsys):
    """Were T said not to follow from the water, its first frame would tell that it does."""
    _, folder, _ = swept
    monkeypatch.setattr(type(OUTPUTS_BY_LETTER["T"]), "beside", LOOKS)
    job = prepare(
        folder / "scene.yaml",
        ["water.jerlov.type=II,3C"],
        tmp_path / "out",
        ["render.outputs=[D,T]"],
        device="cpu",
        frames=slice(0, 3),
    )
    job.run()
    _, second = job.units
    assert "T of 3C are not those of other versions" in capsys.readouterr().err
    produce(second.scene, tmp_path / "alone", device="cpu", frames=slice(0, 3), quiet=True)
    assert tree(second.root) == tree(tmp_path / "alone")
    told = {entry["name"]: entry["datasets"][0]["shared"] for entry in job.manifest.content()["versions"]}
    assert told == {"II": {}, "3C": {"D": "II"}}


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def test_a_is_that_of_a_run_alone_though_all_else_is_that_of_another_water(swept, tmp_path, device):
    _, folder, _ = swept
    job = prepare(
        folder / "scene.yaml",
        ["water={jerlov: {type: 3C}},none"],
        tmp_path / "out",
        LIT,
        device=device,
        frames=slice(0, 3),
    )
    job.run(quiet=True)
    for unit in job.units:
        alone = tmp_path / f"alone_{unit.version.name}"
        produce(unit.scene, alone, device=device, frames=slice(0, 3), quiet=True)
        assert tree(unit.root) == tree(alone)
    assert job.manifest.content()["versions"][1]["datasets"][0]["shared"] == dict.fromkeys("BCDSF", "0")


def test_several_vehicles_have_a_dataset_each_in_every_version(tmp_path):
    own = {key: BASE[key] for key in ("vehicle", "trajectory")}
    fleet = {key: value for key, value in BASE.items() if key not in own}
    fleet["vehicles"] = [
        {
            "id": each,
            **own["vehicle"],
            "trajectory": own["trajectory"],
            "body": {"kind": "boulder", "diameter": 0.4, "material": "steel"},
        }
        for each in "12"
    ]
    fleet["vehicles"][1]["trajectory"] = {"poses": [{"position": [0.3, 2.0, 2.0], "rotation_euler_deg": [0, 0, 150]}]}
    fleet["render"] = fleet["render"] | {"outputs": ["C", "D", "S"]}
    (tmp_path / "fleet.yaml").write_text(yaml.safe_dump(fleet))
    over = ["vehicles.1.lights=[],[{kind: point}]", "water.jerlov.type=II,3C"]
    job = prepare(tmp_path / "fleet.yaml", over, tmp_path / "out", device="cpu", frames=slice(0, 2))
    job.run(quiet=True)
    scene = load_scene(tmp_path / "fleet.yaml", ["vehicles.1.lights=[{kind: point}]", "water.jerlov.type=3C"])
    produce_each(scene, tmp_path / "alone", device="cpu", frames=slice(0, 2), quiet=True)
    assert tree(tmp_path / "out/1-3C") == tree(tmp_path / "alone")
    told = {
        each["folder"]: "".join(each["shared"])
        for version in job.manifest.content()["versions"]
        for each in version["datasets"]
    }
    assert told == {
        f"{name}/veh{each}": "" if name == "0-II" else "CDS"
        for each in "12"
        for name in ("0-II", "0-3C", "1-II", "1-3C")
    }


def test_workers_make_the_bytes_of_one_process(swept, tmp_path, ready_workers):
    _, folder, _ = swept
    options = ["render.outputs=[D,T]", "vehicle.cameras.0.exposure={}", "growth=[]"]
    made = {}
    for name, workers in {"alone": None, "workers": 2}.items():
        job = prepare(
            folder / "scene.yaml",
            ["water.jerlov.type=II,3C"],
            tmp_path / name,
            options,
            device="cpu",
            frames=slice(0, 4),
        )
        job.run(quiet=True, workers=workers)
        made[name] = tree(tmp_path / name)
    assert made["alone"] == made["workers"]


SPECTRAL = {
    "water": {"spectral": {"jerlov": "IB"}},
    "terrain": {"kind": "procedural", "size_m": 20, "resolution": 17},
    "vehicle": {
        "lights": [{"spectrum": "led_b4", "power_W": 50}],
        "cameras": [{"id": "M0", "resolution": [32, 18], "response": "nikon_5100"}],
    },
    "trajectory": {"poses": [{"position": [0, 0, 2]}]},
    "render": {"outputs": ["A", "B", "D"], "spp": 1, "spp_b": 1, "integrator": "path"},
}


def test_waters_by_wavelength_have_a_b_of_their_own_as_it_is_of_their_bands(tmp_path, capsys):
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(SPECTRAL))
    job = prepare(tmp_path / "scene.yaml", ["water.spectral.jerlov=IB,1C"], tmp_path / "out", device="cpu")
    made = job.run()
    assert [summary.rendered for summary in made.values()] == [3, 3]
    assert "made anew" not in capsys.readouterr().out
    produce(load_scene(tmp_path / "scene.yaml", ["water.spectral.jerlov=1C"]), tmp_path / "alone", device="cpu")
    assert tree(tmp_path / "out/1C") == tree(tmp_path / "alone")
    assert "".join(json.loads((tmp_path / "out/sweep.json").read_text())["versions"][1]["datasets"][0]["shared"]) == "D"
