"""Distorted lenses: OpenCV's image points, the double sphere's published formulas, exact inverses, where they end."""

import cv2
import numpy as np
import pytest

from varos_warp.scene.optics.camera import CameraModel
from varos_warp.scene.optics.distortion import Lens, canonical, lens_of

BARREL = Lens("brown_conrady", (-0.3, 0.1, 0.001, -0.002, -0.01))
PINCUSHION = Lens("brown_conrady", (0.4, 0.2, -0.003, 0.001, 0.05))
RATIONAL = Lens("rational", (4.1, 2.7, 0.0001, -0.0002, 0.1, 4.5, 4.0, 0.9))
CANCELLING = Lens("rational", (-3.475, -38.57, 0.00034, -0.000094, 286.4, -3.641, -36.69, 279.05))
"""Of a camera as sold: large coefficients above and below that nearly cancel."""
FISHEYE = Lens("kannala_brandt", (-0.02, 0.003, -0.001, 0.0002))
EQUIDISTANT = Lens("kannala_brandt", (0.0, 0.0, 0.0, 0.0))
SPHERE = Lens("double_sphere", (-0.2, 0.59))
WIDE_SPHERE = Lens("double_sphere", (0.3, 0.45))
LENSES = [BARREL, PINCUSHION, RATIONAL, CANCELLING, FISHEYE, EQUIDISTANT, SPHERE, WIDE_SPHERE]


def opencv(lens, d):
    """Points of the image plane of directions [N, 3] by OpenCV."""
    no_turn, k = np.zeros(3), np.array(lens.k)
    if lens.model == "kannala_brandt":
        return cv2.fisheye.projectPoints(d[:, None], no_turn, no_turn, np.eye(3), k)[0][:, 0]
    return cv2.projectPoints(d, no_turn, no_turn, np.eye(3), k)[0][:, 0]


@pytest.mark.parametrize("lens", [BARREL, PINCUSHION, RATIONAL, CANCELLING, FISHEYE, EQUIDISTANT])
def test_directions_are_seen_where_opencv_sees_them(lens):
    xy = np.random.default_rng(1).uniform(-0.8, 0.8, (1000, 2))
    d = np.column_stack([xy, np.ones(1000)])
    seen = np.hypot(*xy.T) < (np.inf if lens.model == "kannala_brandt" else lens.limit)
    assert seen.mean() > 0.2
    np.testing.assert_allclose(lens.image_plane(d)[seen], opencv(lens, d)[seen], atol=1e-13, rtol=0)
    assert np.isnan(lens.image_plane(d)[~seen]).all()
    np.testing.assert_allclose(lens.image_plane(7.0 * d), lens.image_plane(d), atol=1e-13, rtol=0)


def usenko(d, xi, alpha):
    """Eqs. 40 to 45 of Usenko et al. (2018), for f = 1, c = 0; NaN outside of the domain that they give."""
    x, y, z = d.T
    d1 = np.sqrt(x**2 + y**2 + z**2)
    d2 = np.sqrt(x**2 + y**2 + (xi * d1 + z) ** 2)
    m = np.stack([x, y], -1) / (alpha * d2 + (1.0 - alpha) * (xi * d1 + z))[:, None]
    w1 = alpha / (1.0 - alpha) if alpha <= 0.5 else (1.0 - alpha) / alpha
    w2 = (w1 + xi) / np.sqrt(2.0 * w1 * xi + xi**2 + 1.0)
    return np.where((z > -w2 * d1)[:, None], m, np.nan)


def usenko_back(m, xi, alpha):
    """Eqs. 46 to 51."""
    r2 = (m**2).sum(-1)
    z = (1.0 - alpha**2 * r2) / (alpha * np.sqrt(1.0 - (2.0 * alpha - 1.0) * r2) + 1.0 - alpha)
    scale = (z * xi + np.sqrt(z**2 + (1.0 - xi**2) * r2)) / (z**2 + r2)
    return scale[:, None] * np.column_stack([m, z]) - [0.0, 0.0, xi]


@pytest.mark.parametrize("k", [(-0.2, 0.59), (0.3, 0.45), (-0.27, 0.51), (0.0, 0.7), (0.9, 0.3)])
def test_the_double_sphere_is_the_published_one(k):
    """Its domain holds theirs, and is that of their inverse: both agree within a band of the square of xi."""
    lens, rng = Lens("double_sphere", k), np.random.default_rng(2)
    d = rng.normal(size=(4000, 3)) * 3.0
    published, ours = usenko(d, *k), lens.image_plane(d)
    inside = np.isfinite(published).all(-1)
    np.testing.assert_allclose(ours[inside], published[inside], atol=1e-12, rtol=1e-12)
    more = np.isfinite(ours).all(-1) & ~inside
    assert more.mean() < 0.5 * k[0] ** 2 + 1e-9
    u = d / np.linalg.norm(d, axis=-1, keepdims=True)
    both = np.isfinite(ours).all(-1) & (np.abs(ours).max(-1) < 100.0)
    np.testing.assert_allclose(usenko_back(ours[both], *k), u[both], atol=1e-7, rtol=0)
    np.testing.assert_allclose(lens.directions(ours[both]), usenko_back(ours[both], *k), atol=1e-12, rtol=0)


def test_a_double_sphere_magnifies_the_middle_by_one_over_one_plus_xi():
    at = SPHERE.image_plane(np.array([1e-6, 0.0, 1.0]))
    assert at[0] == pytest.approx(1e-6 / 0.8, rel=1e-9)
    assert SPHERE.central_scale == pytest.approx(1.0 / 0.8, rel=1e-15)


@pytest.mark.parametrize("lens", [Lens(), *LENSES])
def test_the_inverse_is_exact(lens):
    """Within 1e-9 px of a focal length of 1000 px: over the whole image, with its centre, as far as the lens sees."""
    xy = np.stack(np.meshgrid(np.linspace(-0.7, 0.7, 41), np.linspace(-0.5, 0.5, 41)), -1)
    d = lens.directions(xy)
    seen = np.isfinite(d).all(-1)
    assert seen.mean() > 0.2
    np.testing.assert_allclose(np.linalg.norm(d[seen], axis=-1), 1.0, atol=1e-14)
    np.testing.assert_allclose(lens.image_plane(d)[seen], xy[seen], atol=1e-12, rtol=0)


def test_a_fisheye_sees_behind_itself():
    d = EQUIDISTANT.directions(np.array([[np.radians(100.0), 0.0]]))
    np.testing.assert_allclose(d, [[np.sin(np.radians(100.0)), 0.0, np.cos(np.radians(100.0))]], atol=1e-14)
    np.testing.assert_allclose(EQUIDISTANT.image_plane(d), [[np.radians(100.0), 0.0]], atol=1e-14)


# --------------------------------------------------------------------------------------------------- where lenses end


def test_a_lens_sees_no_further_than_it_folds():
    """X (1 - 0.4 x^2) rises to x = sqrt(1 / 1.2), and takes the values below its largest again beyond."""
    lens, fold = Lens("brown_conrady", (-0.4, 0.0, 0.0, 0.0, 0.0)), np.sqrt(1.0 / 1.2)
    assert lens.limit == pytest.approx(fold, rel=1e-12)
    assert np.isfinite(lens.image_plane(np.array([0.99 * fold, 0.0, 1.0]))).all()
    assert np.isnan(lens.image_plane(np.array([1.01 * fold, 0.0, 1.0]))).all()
    highest = fold * (1.0 - 0.4 * fold**2)
    np.testing.assert_allclose(lens.directions(np.array([0.5 * highest, 0.0]))[1], 0.0, atol=0)
    assert np.isnan(lens.directions(np.array([1.01 * highest, 0.0]))).all()


def test_a_rational_lens_ends_where_its_radius_is_largest():
    """X / (1 + x^2) rises to x = 1, where it is a half."""
    lens = Lens("rational", (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0))
    assert lens.limit == pytest.approx(1.0, rel=1e-12)
    assert np.isfinite(lens.directions(np.array([0.4999, 0.0]))).all()
    assert np.isnan(lens.directions(np.array([0.5001, 0.0]))).all()
    assert np.isnan(lens.image_plane(np.array([1.001, 0.0, 1.0]))).all()


def test_a_rational_lens_ends_before_its_pole():
    """X / (1 - x^2) rises to infinity at 1, and is negative beyond: what is there is not seen on the other side."""
    lens = Lens("rational", (0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0))
    assert lens.limit == pytest.approx(1.0, rel=1e-8)
    d = lens.directions(np.array([5.0, 0.0]))
    assert d[0] / d[2] == pytest.approx((np.sqrt(101.0) - 1.0) / 10.0, rel=1e-12)
    assert np.isnan(lens.image_plane(np.array([1.1, 0.0, 1.0]))).all()


@pytest.mark.parametrize("p", [1e-4, 0.02, 0.2, 3.0])
def test_tangential_distortion_ends_the_cone_where_a_jacobian_is_first_singular(p):
    """By brute force: the least determinant of OpenCV's map, differentiated numerically, on circles about the axis."""
    k = (-0.4, 0.03, 0.6 * p, -0.8 * p, 0.0)
    lens, azimuth, h = Lens("brown_conrady", k), np.linspace(0.0, 2.0 * np.pi, 361), 1e-6

    def least(r):
        xy = r * np.stack([np.cos(azimuth), np.sin(azimuth)], -1)

        def seen(dx, dy):
            return opencv(lens, np.column_stack([xy + [dx, dy], np.ones(len(xy))]))

        across, down = (seen(h, 0) - seen(-h, 0)) / (2 * h), (seen(0, h) - seen(0, -h)) / (2 * h)
        return (across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0]).min()

    assert min(map(least, np.linspace(0.01, 0.999, 50) * lens.limit)) > 0.0
    assert least(1.001 * lens.limit) < 0.0


def test_strong_tangential_distortion_is_undone_to_the_edge():
    """All directions of the cone come back, where p1 and p2 are a hundred times those of real lenses."""
    lens = Lens("rational", (-0.171, -0.034, -0.107, -0.127, 0.103, 0.476, -0.669, 0.177))
    rng = np.random.default_rng(3)
    r, azimuth = 0.9999 * lens.limit * np.sqrt(rng.uniform(size=4000)), rng.uniform(0.0, 2.0 * np.pi, 4000)
    d = np.column_stack([r * np.cos(azimuth), r * np.sin(azimuth), np.ones(4000)])
    at = lens.image_plane(d)
    back = lens.directions(at)
    np.testing.assert_allclose(lens.image_plane(back), at, atol=1e-11, rtol=1e-11)
    np.testing.assert_allclose(back[:, :2] / back[:, 2:], d[:, :2], atol=1e-5)


@pytest.mark.parametrize(
    "lens",
    [
        Lens("double_sphere", (-0.3, 0.95)),
        Lens("double_sphere", (0.4, 0.8)),
        Lens("double_sphere", (1.5, 0.4)),
        Lens("double_sphere", (0.2, 1.0)),
    ],
)
def test_a_double_sphere_ends_where_its_radius_is_largest(lens):
    """A turning point of the radius by angle; for alpha above a half at 1 / sqrt(2 alpha - 1)."""
    angle = lens.half_angle + np.array([-1e-3, -1e-6, 1e-6])
    at = lens.image_plane(np.column_stack([np.sin(angle), 0.0 * angle, np.cos(angle)]))[:, 0]
    assert np.isnan(at[2])
    xi, alpha = lens.k
    slope = np.diff(at[:2])[0] / np.diff(angle[:2])[0]
    assert 0.0 < slope < 2e-3 * at[1]
    if xi <= 1.0:
        assert at[1] == pytest.approx(1.0 / np.sqrt(2.0 * alpha - 1.0), rel=1e-5)
    assert np.isnan(lens.directions(np.array([1.001 * at[1], 0.0]))).all()


@pytest.mark.parametrize("lens", [Lens(), BARREL, RATIONAL])
def test_nothing_is_seen_behind_a_flat_image(lens):
    assert np.isnan(lens.image_plane(np.array([[0.1, 0.1, -1.0], [1.0, 0.0, 0.0]]))).all()


@pytest.mark.parametrize(
    "lens",
    [
        Lens("brown_conrady", (-0.7, 0.1, 0.02, -0.03, 0.0)),
        Lens("kannala_brandt", (-0.4, 0.0, 0.0, 0.0)),
        Lens("rational", (-0.6, -0.3, 0.004, -0.003, 0.0, 0.2, 0.1, 0.3)),
    ],
)
def test_the_pixels_that_see_nothing_are_counted(lens):
    """One by one, of an image whose principal point is aside."""
    model = CameraModel(np.array([[200.0, 0.0, 150.0], [0.0, 210.0, 90.0], [0.0, 0.0, 1.0]]), lens)
    end = model.lens_end(320, 240)
    col, row = np.meshgrid(np.arange(320) + 0.5, np.arange(240) + 0.5)
    unseen = np.isnan(model.directions(np.stack([col, row], -1))[..., 0])
    assert end.pixels == unseen.sum() > 1000
    assert end.share == end.pixels / (320 * 240)
    nearest = np.hypot(col - 150.0, row - 90.0)[unseen].min()
    assert nearest - 1.0 < end.radius_px <= nearest
    assert CameraModel(model.K, BARREL).lens_end(320, 240) is None


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ({"model": "radtan", "k": [0.1, 0.2, 0.3, 0.4]}, Lens("brown_conrady", (0.1, 0.2, 0.3, 0.4, 0.0))),
        ({"model": "plumb_bob", "k": [1, 2, 3, 4, 5]}, Lens("brown_conrady", (1, 2, 3, 4, 5))),
        ({"model": "rational_polynomial", "k": range(8)}, Lens("rational", tuple(range(8)))),
        ({"model": "equidistant", "k": [1, 2, 3, 4]}, Lens("kannala_brandt", (1, 2, 3, 4))),
        ({"model": "ds", "xi": 0.1, "alpha": 0.6}, Lens("double_sphere", (0.1, 0.6))),
        ({"model": "pinhole"}, Lens()),
    ],
)
def test_a_lens_is_kept_under_one_name(given, kept):
    assert lens_of(**given) == kept
    assert canonical(given["model"]) == kept.model
