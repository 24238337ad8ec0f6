"""N is the layer of bodies in the water: files, shards, damage, what A is without it, and what is refused."""

import shutil

import numpy as np
import pytest

from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.errors import InputError
from varos_warp.products.images.radiance import RadianceImage
from varos_warp.products.images.snow import Snow
from varos_warp.render.image.denoise import denoise_image
from varos_warp.render.options import LAYERS
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict

SCENE = {
    "water": {"jerlov": {"type": "1C", "phase": {"kind": "fournier_forand", "n": 1.10, "mu": 3.5835}}},
    "particles": [{"share": 0.01, "radius_m": [0.001, 0.004]}],
    "surface_depth_m": 10,
    "vehicle": {
        "lights": [
            {
                "kind": "spot",
                "position": [0.4, 0.0, 0.2],
                "direction": [-0.1, 1, 0],
                "intensity": [50, 50, 50],
                "cone_deg": 100,
                "blend": 0.5,
            }
        ],
        "cameras": [
            {
                "id": "M0",
                "resolution": [48, 27],
                "sensor_mm": [8, 4.5],
                "focal_mm": 6,
                "exposure": {"time_s": 0.02, "readout_s": 0.01},
            }
        ],
    },
    "trajectory": {"poses": [{"position": [0, 0, 0], "time_s": 0}, {"position": [0.03, 0.1, 0.0], "time_s": 0.1}]},
    "render": {"outputs": ["A", "N"], "integrator": "path", "spp": 1, "linear_exr": True, "denoise": "nlm"},
}


def scene_of(**changes):
    return scene_from_dict({**SCENE, **changes})


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A complete dataset of two frames; read it, do not change it."""
    out = tmp_path_factory.mktemp("snow") / "out"
    produce(scene_of(), out, quiet=True)
    return out


def test_a_dataset_with_it_is_sound_and_read_back(whole):
    data = Dataset(whole)
    assert validate(whole, quiet=True).problems == []
    snow = data.snow(0)
    covered = data.pixels("N", 0) > 0
    assert covered.any()
    assert not covered.all()
    assert snow.added[covered].max() > 0.0 > snow.added[~covered].min()
    assert np.isfinite(snow.flow).all()
    assert "IMAGES N" in (whole / "README.txt").read_text()
    assert data.meta["water"]["particles"][0]["share"] == 0.01


def test_a_is_the_water_let_through_plus_the_bodies(whole):
    """In float32: rounding of a sum and a product of a few terms."""
    data = Dataset(whole)
    channels = files.read_exr(data.layout.linear("M0", 0, "A"))
    total = np.stack([channels[c] for c in "RGB"], -1)
    layers = {name: np.stack([channels[f"{name}.{c}"] for c in "RGB"], -1) for name in (*LAYERS, "snow")}
    water = sum(layers[name] for name in LAYERS)
    np.testing.assert_allclose(data.snow(0).over(water), total, atol=4e-6 * total.max())
    np.testing.assert_allclose(layers["snow"], total - water, atol=4e-6 * total.max())


def test_shards_have_the_bytes_of_one_run(whole, tmp_path):
    for shard in ((1, 2), (0, 2)):
        produce(scene_of(), tmp_path / "out", quiet=True, shard=shard)
    for letter, folder in (("N", "_exr"), ("N", ""), ("A", "_exr")):
        for frame in range(2):
            paths = [
                Dataset(root).layout.image_files("M0", letter, frame, {})[folder] for root in (whole, tmp_path / "out")
            ]
            assert paths[0].read_bytes() == paths[1].read_bytes(), paths[0].name


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda channels: channels.pop("passed"), "has no channel passed"),
        (lambda channels: channels["G"].fill(np.nan), "not finite"),
        (lambda channels: channels["passed"].fill(-0.5), "negative share of light that passes"),
    ],
)
def test_damage_within_it_is_named(whole, tmp_path, change, said):
    copy = shutil.copytree(whole, tmp_path / "copy")
    (copy / "checksums").unlink()
    path = Dataset(copy).layout.exr("M0", "N", 1)
    channels = {name: plane.copy() for name, plane in files.read_exr(path).items()}
    change(channels)
    files.write_exr(path, channels)
    problems = validate(copy, quiet=True).problems
    assert any(path.name in problem and said in problem for problem in problems), problems


def test_no_denoiser_touches_bodies():
    """Of an image that is denoised on the host later, as of none: what is added is added after it."""
    rng = np.random.default_rng(1)
    plain = RadianceImage(rng.uniform(0.5, 1.5, (24, 32, 3)).astype(np.float32), np.full((24, 32, 3), 0.3, np.float32))
    added = np.zeros((24, 32, 3), np.float32)
    added[5, 7] = 3.0
    snow = Snow(added, np.full((24, 32), 1.25, np.float32))
    shown = RadianceImage(snow.over(plain.radiance), plain.stderr, snow=snow)
    np.testing.assert_allclose(denoise_image(shown, "nlm"), snow.over(denoise_image(plain, "nlm")), rtol=1e-5)


def test_without_bodies_a_is_that_of_a_scene_that_has_none():
    """To the byte."""
    how = {"outputs": "A", "spp": 1}
    with_bodies, none = (
        FrameRenderer(scene_of(**changes), "cpu")
        for changes in ({}, {"particles": [], "render": SCENE["render"] | {"outputs": ["A"]}})
    )
    plain = none.render(np.eye(4), **how).A.radiance
    np.testing.assert_array_equal(with_bodies.render(np.eye(4), snow=False, **how).A.radiance, plain)
    assert np.abs(with_bodies.render(np.eye(4), **how).A.radiance - plain).max() > 0.0
    # what bodies take from A is light scattered once: an image without it shows none
    direct = [renderer.render(np.eye(4), layers=["direct"], **how).A.radiance for renderer in (with_bodies, none)]
    np.testing.assert_array_equal(*direct)


def test_what_cannot_be_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"at most 0\.01346 of the scattering"):
        produce(scene_of(particles=[{"share": 0.05}]), tmp_path / "out", quiet=True)
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match="beside the blocks before it"):
        produce(scene_of(particles=[{"share": 0.01}, {"share": 0.01, "seed": 2}]), tmp_path / "out", quiet=True)
    with pytest.raises(InputError, match="the water does not scatter"):
        produce(scene_of(water="none"), tmp_path / "out", quiet=True)
    for block, said in (
        ({"radius_m": [0.003, 0.001]}, "does not ascend"),
        ({"radius_m": [0, 0.001]}, "radius_m"),
        ({"radius_m": [-0.001, 0.001]}, "radius_m"),
        ({"slope": 1.9}, "slope"),
        ({"slope": 6.1}, "slope"),
        ({"share": 0}, "share"),
        ({"preset": "blizzard"}, "preset"),
    ):
        with pytest.raises(InputError, match=said):
            scene_of(particles=[block])
    with pytest.raises(InputError, match="N shows bodies in the water"):
        scene_of(particles=[])
    with pytest.raises(InputError, match="none of the light scattered once"):
        scene_of(render=SCENE["render"] | {"layers": ["direct", "multiple"]})
    camera = {"id": "M0", "resolution": [1280, 720], "sensor_mm": [8, 4.5], "focal_mm": 6}
    many = scene_of(
        vehicle=SCENE["vehicle"] | {"cameras": [camera]},
        particles=[{"share": 0.013, "radius_m": [2e-5, 1e-4], "least_px": 0.005}],
    )
    with pytest.raises(InputError, match=r"particles\.0\.least_px = 0\.005.*cells of water"):
        produce(many, tmp_path / "out", quiet=True)
    assert not (tmp_path / "out").exists()
