"""What kernels are compiled for, of the materials of parts: nothing that is there may be left out."""

import numpy as np
import pytest

from varos_warp.scene.description.surfaces import Layered
from varos_warp.scene.description.world import Diffuse, Dirt, Metal, Rust, SlopeBlend
from varos_warp.scene.geometry.parts import Page, Part, Skin
from varos_warp.scene.materials.records import features

SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]], np.int32)
COLOURS = Skin(np.full((2, 3, 3), 0.4, np.float32))
IMAGES = Skin(np.zeros((2, 3, 2), np.float32), (Page(np.zeros((4, 4, 3), np.uint8)),))
METAL, RUST = Metal(kind="metal"), Rust(kind="rust")


def part(material, skin=None):
    return Part("x", *SQUARE, material, skin=skin)


@pytest.mark.parametrize(
    ("some", "present"),
    [
        ([part(Diffuse())], set()),
        ([part(Diffuse()), part(Diffuse(), COLOURS)], {"textures"}),
        ([part(Diffuse(), IMAGES)], {"textures", "patterns"}),
        ([part(SlopeBlend(kind="slope_blend"))], {"textures", "patterns"}),
        ([part(Dirt(kind="dirt"))], {"textures", "patterns"}),
        ([part(METAL), part(Diffuse())], {"textures", "metals"}),
        ([part(METAL, COLOURS)], {"textures"}),  # colours of its own take the place of the material
        ([part(RUST)], {"textures", "patterns"} | ({"metals"} if RUST.roughness is not None else set())),
        ([part(Rust(kind="rust", roughness=0.3))], {"textures", "patterns", "metals"}),
        ([part(Layered(kind="layered", relief="rock"), COLOURS)], {"textures", "grain", "rough"}),
        ([part(Layered(kind="layered", relief="rock", grain=0), COLOURS)], {"textures", "rough"}),
        ([part(Layered(kind="layered", relief="zinc"), COLOURS)], {"textures", "rough"}),
    ],
)
def test_what_materials_need_is_found(some, present):
    assert {name for name, there in features(some).items() if there} == present
