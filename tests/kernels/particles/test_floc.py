"""Images of flocs: their light, however they lie, are blurred or move; their places, and what they hide."""

import numpy as np
import pytest
import warp as wp

from varos_warp.kernels.particles.bodies import Body, Grain, Particles
from varos_warp.kernels.particles.floc import Floc, lies_along, looseness, shape_of, share_of_floc
from varos_warp.render.particles.cells import grains_on
from varos_warp.scene.water.flocs import SHAPES, flocs

STEP = 0.25
"""Distance of the places at which images are sampled [pixels]: four to a pixel, for each of which sums are the same."""


@wp.kernel(enable_backward=False)
def shares_of(
    flocs: wp.array(dtype=Floc),
    grains: wp.array2d(dtype=Grain),
    along: wp.vec2,
    half: float,
    out: wp.array3d(dtype=float),
):
    i, row, col = wp.tid()
    at = wp.vec2(wp.static(STEP) * float(col) - half, wp.static(STEP) * float(row) - half)
    out[i, row, col] = share_of_floc(flocs[i], grains, along, at)


@wp.kernel(enable_backward=False)
def poses_of(
    u: wp.array(dtype=wp.vec4),
    turn: float,
    directions: wp.array(dtype=wp.vec3),
    e: wp.array2d(dtype=wp.vec3),
    shape: wp.array(dtype=int),
):
    i = wp.tid()
    body, particles = Body(), Particles()
    body.u = u[i]
    particles.turn = turn
    shape[i] = shape_of(body, wp.static(SHAPES))
    for k in range(directions.shape[0]):
        e[i, k] = lies_along(particles, body, directions[k])


@wp.kernel(enable_backward=False)
def loosenesses(extent: wp.array(dtype=float), blur: float, length: float, out: wp.array(dtype=float)):
    out[wp.tid()] = looseness(extent[wp.tid()], blur, length)


def lying(u, turn=0.0, directions=np.eye(3)):
    """Directions of the world as bodies [N] of these numbers see them, [N, direction, 3], and their shapes [N]."""
    directions = wp.array(np.asarray(directions, np.float32), dtype=wp.vec3, device="cpu")
    e, shape = (
        wp.empty((len(u), len(directions)), dtype=wp.vec3, device="cpu"),
        wp.empty(len(u), dtype=int, device="cpu"),
    )
    wp.launch(poses_of, len(u), [wp.array(u, dtype=wp.vec4, device="cpu"), turn, directions], [e, shape], device="cpu")
    return e.numpy(), shape.numpy()


def some_flocs(size, blur=0.0, loose=1.0, count=24, seed=1):
    """Records of flocs that lie anyhow."""
    e, shape = lying(np.random.default_rng(seed).random((count, 4), dtype=np.float32))
    made = []
    for own, which in zip(e, shape, strict=True):
        floc = Floc()
        floc.shape, floc.loose, floc.size, floc.blur = int(which), loose, size, blur
        floc.across, floc.down = (wp.vec3(*(loose * size * own[k]).tolist()) for k in (0, 1))
        made.append(floc)
    return made


def images_of(made, along=(0.0, 0.0)):
    """Shares of light at places `STEP` apart, [floc, row, column], and the places along an axis."""
    half = 5.2 * made[0].size + 2.0 * float(np.hypot(made[0].blur, 1)) + float(np.linalg.norm(along)) + 2.0
    half = float(np.ceil(half))
    side = int(2 * half / STEP)
    out = wp.empty((len(made), side, side), dtype=float, device="cpu")
    wp.launch(
        shares_of,
        out.shape,
        [wp.array(made, dtype=Floc, device="cpu"), grains_on("cpu"), wp.vec2(*along), half],
        [out],
        device="cpu",
    )
    return out.numpy().astype(float), STEP * np.arange(side) - half


CASES = {
    "sharp": (6.0, 0.0, 1.0, (0.0, 0.0)),
    "small": (0.5, 0.0, 1.0, (0.0, 0.0)),
    "half apart": (0.4, 0.0, 0.5, (0.0, 0.0)),
    "out of focus": (2.0, 4.0, 1.0, (0.0, 0.0)),
    "moving": (1.5, 0.5, 1.0, (5.0, 2.0)),
}


@pytest.mark.parametrize("name", CASES)
def test_the_light_of_a_floc_is_that_of_a_round_body(name):
    """All of it: in the mean over places in a pixel to 1e-4, where a sum is an integral, and at any place to 1 %."""
    size, blur, loose, along = CASES[name]
    images, _ = images_of(some_flocs(size, blur, loose), along)
    fine = round(1 / STEP)
    sums = np.array([images[:, i::fine, j::fine].sum((1, 2)) for i in range(fine) for j in range(fine)])
    np.testing.assert_allclose(sums.mean(0), 1.0, rtol=2e-4)
    np.testing.assert_allclose(sums, 1.0, rtol=0.01)


@pytest.mark.parametrize("name", ["sharp", "out of focus", "half apart"])
def test_its_image_has_the_place_and_the_spread_of_its_grains(name):
    """The middle is the body's; second moments are those of the grains' places and of their discs, by numpy."""
    size, blur, loose, along = CASES[name]
    made = some_flocs(size, blur, loose)
    images, x = images_of(made, along)
    images /= images.sum((1, 2), keepdims=True)
    at, radius, share = flocs()
    for floc, image in zip(made, images, strict=True):
        middle = np.array([(image.sum(0) * x).sum(), (image.sum(1) * x).sum()])
        np.testing.assert_allclose(middle, 0.0, atol=1e-3 * size + 2e-3)
        spread = np.array(
            [[(image.sum(0) * x * x).sum(), (x[:, None] * x * image).sum()], [0.0, (image.sum(1) * x * x).sum()]]
        )
        spread[1, 0] = spread[0, 1]
        axes, own = np.array([floc.across, floc.down], float), at[floc.shape]
        places = own @ axes.T
        sizes = size * (1 + loose * (radius[floc.shape] - 1))
        discs = [variance_of_disc(s, blur) for s in sizes]
        expected = np.einsum("g,gi,gj->ij", share[floc.shape], places, places) + np.eye(2) * (share[floc.shape] @ discs)
        np.testing.assert_allclose(spread, expected, atol=3e-3 * np.trace(expected))


def variance_of_disc(size, blur):
    """Along an axis, of a disc with a soft edge: that of two boxes beside that of a step."""
    radius = np.sqrt(size**2 + blur**2 + 1)
    edge = np.sqrt((0.9 * size) ** 2 + (0.5 * blur) ** 2 + 4)
    long = max(edge / 2, 1.0)
    fine = (np.arange(4000) + 0.5) * (radius + edge) / 4000
    boxes = np.convolve(np.ones(round(2000 * long / edge) + 1), np.ones(round(2000 * (edge - long) / edge) + 1))
    fall = 1 - np.interp(fine - radius, np.linspace(-edge / 2, edge / 2, len(boxes)), np.cumsum(boxes) / boxes.sum())
    return 0.5 * (fall * fine**3).sum() / (fall * fine).sum()


def test_flocs_are_not_round_even_when_moderately_out_of_focus():
    """Of as large a blur as a floc's own cross section is wide, most are longer than wide by a tenth and more."""
    images, x = images_of(some_flocs(2.0, 2.0, count=64))
    images /= images.sum((1, 2), keepdims=True)
    xx, yy = (images.sum(1) * x * x).sum(-1), (images.sum(2) * x * x).sum(-1)
    xy = np.einsum("irc,r,c->i", images, x, x)
    ratio = np.sqrt((xx + yy + np.hypot(xx - yy, 2 * xy)) / (xx + yy - np.hypot(xx - yy, 2 * xy)))
    assert np.median(ratio) > 1.5
    assert np.percentile(ratio, 10) > 1.1


@pytest.mark.parametrize("size", [1.0, 3.0, 12.0])
def test_flocs_hide_what_their_cross_section_is(size):
    """No pixel can lose more than all of its light: that takes away less than a fiftieth of what they hide."""
    images, _ = images_of(some_flocs(size, count=64))
    hidden = np.pi * size**2 * images
    assert np.minimum(hidden, 1.0).sum() > 0.98 * hidden.sum()


def test_all_lies_are_as_likely_whenever_it_is():
    """Directions are uniform on the sphere: each coordinate is uniform; right and down stay at right angles."""
    u = np.random.default_rng(2).random((4000, 4), dtype=np.float32)
    for turn in (0.0, 2.0):
        e, _ = lying(u, turn)
        np.testing.assert_allclose(np.einsum("nij,nkj->nik", e, e), np.broadcast_to(np.eye(3), (4000, 3, 3)), atol=1e-5)
        for values in e.reshape(4000, 9).T:
            assert abs(values.mean()) < 4 * np.sqrt(1 / 3 / 4000)
            assert abs((values**2).mean() - 1 / 3) < 4 * np.sqrt(4 / 45 / 4000)


def test_a_body_turns_as_time_goes_by_and_looks_the_same_from_a_camera_that_turns_with_it():
    u = np.random.default_rng(3).random((50, 4), dtype=np.float32)
    rolled = np.array([[np.cos(0.4), np.sin(0.4), 0], [-np.sin(0.4), np.cos(0.4), 0]])
    (still, shape), (turned, same), (seen, _) = lying(u), lying(u, 0.3), lying(u, 0.0, rolled)
    assert np.array_equal(shape, same)
    angle = np.arccos(np.clip((np.einsum("nij,nij->n", still, turned) - 1) / 2, -1, 1))
    np.testing.assert_allclose(angle, 0.3, atol=2e-3)
    np.testing.assert_allclose(
        seen, np.einsum("ki,nij->nkj", rolled, still), atol=1e-6
    )  # one body, seen from two sides


def test_all_shapes_are_as_likely():
    _, shape = lying(np.random.default_rng(4).random((64 * 200, 4), dtype=np.float32))
    counts = np.bincount(shape, minlength=SHAPES)
    assert len(counts) == SHAPES
    assert ((counts - 200) ** 2 / 200).sum() < SHAPES + 4 * np.sqrt(2 * SHAPES)


def test_bodies_become_round_as_they_get_small_or_blurred_or_leave_long_streaks():
    extent = np.array([0.4, 0.5, 0.75, 1.0, 5.0], np.float32)

    def looks(blur, length):
        out = wp.empty(len(extent), dtype=float, device="cpu")
        wp.launch(
            loosenesses, len(extent), [wp.array(extent, dtype=float, device="cpu"), blur, length], [out], device="cpu"
        )
        return out.numpy()

    np.testing.assert_allclose(looks(0.0, 0.0), [0, 0, 0.5, 1, 1], atol=1e-6)
    np.testing.assert_allclose(looks(float(np.sqrt(24.0)), 0.0), [0, 0, 0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(looks(0.0, 22.5), [0, 0, 0, 0, 0.5], atol=1e-6)
    assert looks(0.0, 40.0).max() == 0
