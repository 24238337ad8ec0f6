"""What takes long to make of a scene is made once: terrains, places of copies, tiles and a table of lobes."""

import numpy as np
import pytest

from varos_warp.scene.description.world import Metal
from varos_warp.scene.device import DeviceScene
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry import placed, scatter
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.procedural import generate_terrain
from varos_warp.scene.geometry.terrain import write_ply
from varos_warp.scene.materials import lobe, textures

BOULDER = {"kind": "boulder", "diameter": 0.4, "chord_error_m": 0.01}
BLOCKS = {
    "trajectory": {"poses": [{"position": [0, 0, 5]}]},
    "terrain": {"file": "floor.ply", "preprocess": {"target_vertices": 100_000}, "material": "ground"},
    "materials": {"ground": {"kind": "slope_blend"}, "steel": {"kind": "metal", "base": [0.5] * 3, "roughness": 0.4}},
    "objects": [{**BOULDER, "position": [0, 0, 1], "material": "steel"}],
    "scatter": [{"object": BOULDER, "count": 5, "seed": seed} for seed in (1, 2)],
}


def never(*_, **__):
    raise AssertionError("made again")


def forget():
    """What the process holds in memory, of this test or of others."""
    textures.ground_tile.cache_clear()
    lobe.lobe_albedo_table.cache_clear()


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """A scene with everything that is kept; the preprocessing of its terrain has something to warn of."""
    forget()
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path / "cache"))
    write_ply(tmp_path / "floor.ply", *generate_terrain(10.0, 33, 0.5))
    return scene_from_dict(BLOCKS, tmp_path)


def made(scene):
    """Arrays of the geometry, of a tile and of the table of lobes."""
    parts = build_parts(scene)
    world = DeviceScene(scene, parts, "cpu")
    assert any(isinstance(part.material, Metal) for part in parts)
    tiles = [image.texels.numpy() for image, _ in world.textures.images.values()]
    poses = [part.T_w_o for part in parts if hasattr(part, "T_w_o")]
    return [parts[0].vertices, parts[0].faces, *poses, *tiles, world.data.lobe_albedo.numpy()]


def test_a_scene_is_made_of_what_is_kept(scene, monkeypatch):
    with pytest.warns(UserWarning, match="decimation adds none"):
        first = made(scene)
    forget()
    for module, name in (
        (placed.terrain, "preprocess"),
        (scatter, "_places"),
        (textures, "tile_pyramid"),
        (lobe, "_table"),
    ):
        monkeypatch.setattr(module, name, never)
    with pytest.warns(UserWarning, match="decimation adds none"):
        again = made(scene)
    assert len(again) == len(first) == 7
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))


@pytest.mark.filterwarnings("ignore:.*decimation adds none")
@pytest.mark.parametrize(
    "change", [{"seed": 5}, {"scatter": [{"object": BOULDER, "count": 5, "seed": 1, "sink_m": 0.01}]}]
)
def test_other_copies_are_not_those_that_are_kept(scene, change, tmp_path, monkeypatch):
    build_parts(scene)
    monkeypatch.setattr(scatter, "_places", never)
    with pytest.raises(AssertionError, match="made again"):
        build_parts(scene_from_dict(BLOCKS | change, tmp_path))
