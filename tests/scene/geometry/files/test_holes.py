"""Which triangles a mask may cut: none that it cuts is missed, and few others are named."""

import numpy as np
import pytest
import warp as wp
from chance import run

from varos_warp.kernels.world.texture import Layer, page_alpha
from varos_warp.scene.geometry.files.holes import may_cut
from varos_warp.scene.geometry.parts import Page
from varos_warp.scene.materials.records import WRAPS

RNG = np.random.default_rng(7)
TEXELS = np.zeros((1, 1, 3), np.uint8)


@wp.kernel(enable_backward=False)
def alpha_at(layer: Layer, uv: wp.array(dtype=wp.vec2), out: wp.array(dtype=float)):
    i = wp.tid()
    out[i] = page_alpha(layer, uv[i][0], uv[i][1])


def seen(page, uv):
    """Least alpha 0..1 that kernels find at 400 places of each triangle [F]."""
    share = RNG.dirichlet([0.5] * 3, 400)
    at = np.einsum("pk,fkj->fpj", share, uv)
    layer = Layer()
    layer.wrap_u, layer.wrap_v = (WRAPS[how] for how in page.wrap)
    layer.alpha = wp.array(page.alpha, dtype=wp.uint8, device="cpu")
    return run(alpha_at, [layer, at.reshape(-1, 2).astype(np.float32)], [float]).reshape(len(uv), -1).min(axis=1)


def page_with_spots(wrap, spots=60, shape=(37, 50)):
    alpha = np.full(shape, 255, np.uint8)
    alpha[RNG.integers(0, shape[0], spots), RNG.integers(0, shape[1], spots)] = 0
    return Page(TEXELS, wrap=wrap, alpha=alpha, cutoff=0.5)


@pytest.mark.parametrize("wrap", [("repeat", "repeat"), ("clamp", "mirror"), ("mirror", "repeat")])
@pytest.mark.parametrize("size", [0.02, 0.3, 2.5])
def test_no_triangle_with_a_hole_is_missed(wrap, size):
    page = page_with_spots(wrap)
    uv = RNG.uniform(-1.5, 2.5, (500, 1, 2)) + size * RNG.uniform(-0.5, 0.5, (500, 3, 2))
    cut = seen(page, uv) < page.cutoff
    assert cut.any()
    assert may_cut(page, uv, None)[cut].all()


def test_a_triangle_two_texels_from_a_hole_is_whole():
    alpha = np.full((40, 40), 255, np.uint8)
    alpha[20, 20] = 0  # its centre is at u = 20.5 / 40, v = 1 - 20.5 / 40
    uv = np.array([20.5, 19.5]) / 40 + np.array([[0.0, 0], [0.02, 0], [0, 0.02]])
    steps = 2.1 / 40 * np.array([[0, 0], [1, 0], [-1.5, 0], [0, 1], [0, -1.5], [1, 1]])
    found = may_cut(Page(TEXELS, alpha=alpha, cutoff=0.5), uv + steps[:, None], None)
    assert found.tolist() == [True, False, False, False, False, False]


def test_the_alpha_of_corners_counts():
    page = Page(TEXELS, alpha=np.full((4, 4), 200, np.uint8), cutoff=0.5)
    fade = np.array([[1.0, 1, 1], [1, 1, 0.7], [1, 1, 0.6]])  # 200 / 255 x 0.6 < 0.5
    assert may_cut(page, np.zeros((3, 3, 2)), fade).tolist() == [False, False, True]
