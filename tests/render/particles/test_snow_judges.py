"""Marine snow before judges that know nothing of splats: meshes of the bodies, and two cameras."""

import numpy as np
import trimesh
from flakes import CAMERA, LAMP, WATER, Snowing, snow_scene
from scipy.optimize import least_squares

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry.parts import Part, Skin
from varos_warp.scene.optics.camera import camera_model

FOCAL, WIDTH, HEIGHT = 240.0, 320, 180
"""Of the camera that meshes are seen by [pixels]."""
VIEW = {"resolution": [WIDTH, HEIGHT]}
HALF = 2.0
"""Reflectances of meshes are bodies' over this, for bright ones exceed 1."""


def drawn(law, t, r, lamp_distance):
    """Share of a body that is drawn, by docs/snow.md and kernels/particles/bodies.py."""
    near = np.clip((t - 0.05) / 0.05, 0, 1) * np.clip((lamp_distance - 0.05) / 0.05, 0, 1)
    small = np.clip((r / (law.block.least_px / FOCAL * t) - 1) / 0.5, 0, 1)
    reach = min(8.0, 4.0 / law.water.sigma_t.min())
    return near * small * np.clip(4 * (1 - t / reach), 0, 1)


def crossed(p, end, r):
    """Whether some other ball of radii ``r`` around ``p`` reaches into the way from each to a point."""
    way = end - p
    length = np.linalg.norm(way, axis=1)
    d = way / length[:, None]
    offset = p[None] - p[:, None]
    along = np.einsum("ijk,ik->ij", offset, d)
    across = np.linalg.norm(offset - along[..., None] * d[:, None], axis=-1)
    hit = (along > 0) & (along < length[:, None]) & (across < r[None] + r[:, None])
    np.fill_diagonal(hit, False)
    return hit.any(1)


def test_meshes_of_the_bodies_look_alike_by_a_plain_path_tracer():
    """Balls with Lambert's law in water of the same extinction that does not scatter, in one reflection."""
    scene = snow_scene(VIEW, {"share": 0.01, "radius_m": [0.003, 0.006], "wander_m_s": 0, "least_px": 0.4})
    snowing = Snowing(scene)
    S = snowing().light.astype(float)
    law, (p, r, u) = snowing.snow.laws[0], snowing.bodies()
    t, lamp = np.linalg.norm(p, axis=1), np.linalg.norm(p - LAMP["position"], axis=1)
    share = drawn(law, t, r, lamp)
    x, y = WIDTH / 2 + FOCAL * p[:, 0] / p[:, 1], HEIGHT / 2 - FOCAL * p[:, 2] / p[:, 1]
    size = FOCAL * r / p[:, 1]
    seen = (share > 0) & (p[:, 1] > 0)
    seen &= (np.abs(x - WIDTH / 2) < WIDTH / 2 + 9) & (np.abs(y - HEIGHT / 2) < HEIGHT / 2 + 9)
    p, r, u, x, y, size, share, t = (values[seen] for values in (p, r, u, x, y, size, share, t))
    assert 150 < len(p) < 2000
    bright = share * (1 + 0.3 * np.sin(2 * np.pi * u[:, 3])) / HALF
    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.apply_scale(np.sqrt(4 * np.pi / ball.area))  # its mean projected area is that of the sphere
    vertices = (p[:, None] + r[:, None, None] * ball.vertices).reshape(-1, 3)
    faces = (np.arange(len(p))[:, None, None] * len(ball.vertices) + ball.faces).reshape(-1, 3).astype(np.int32)
    colours = np.repeat(bright[:, None] * law.albedo, len(ball.faces), 0)
    skin = Skin(np.repeat(colours[:, None], 3, 1).astype(np.float32))
    part = Part("bodies", vertices, faces, Diffuse(reflectance=(0.5, 0.5, 0.5)), skin=skin)
    sigma_t = np.add(WATER["coefficients"]["sigma_s"], WATER["coefficients"]["sigma_a"])
    dark = snow_scene(VIEW, water={"coefficients": {"sigma_s": [0, 0, 0], "sigma_a": sigma_t.tolist()}}, bodies=False)
    image = (
        FrameRenderer(dark, "cpu", parts=[part])
        .render(np.eye(4), outputs="A", integrator="reference", spp=64, max_bounces=1, denoise="none")
        .A
    )
    # windows of bodies that stand alone, are not close by, in a shadow or behind another
    reach = np.ceil(size + 2.0).astype(int)
    apart = np.maximum(np.abs(x - x[:, None]), np.abs(y - y[:, None])) > reach + reach[:, None] + 2
    np.fill_diagonal(apart, True)
    fits = (np.minimum(x, y) > reach + 1) & (x < WIDTH - reach - 1) & (y < HEIGHT - reach - 1)
    good = (
        apart.all(1)
        & fits
        & (t > 0.3)
        & ~crossed(p, np.zeros(3), r)
        & ~crossed(p, np.array(LAMP["position"], float), r)
    )
    sums, made = [], []
    for i in np.nonzero(good)[0]:
        window = np.s_[int(y[i]) - reach[i] : int(y[i]) + reach[i] + 1, int(x[i]) - reach[i] : int(x[i]) + reach[i] + 1]
        sums.append(S[window].sum((0, 1)))
        made.append(HALF * image.radiance[window].sum((0, 1), dtype=float))
    sums, made = np.array(sums), np.array(made)
    lit = sums.max(1) > 0
    assert lit.sum() >= 50
    # by the scatter between bodies: errors of pixels that few samples hit are not known
    off = (sums - made)[lit]
    error = np.sqrt((off**2).sum(0))
    assert (np.abs(off.sum(0)) < 3 * error).all()
    assert (error < 0.03 * sums[lit].sum(0)).all()


def centroid(image, at):
    """Of the light around a place [pixels]; None where there is other light beside it."""
    row, col = (np.arange(int(c) - 5, int(c) + 6) for c in (at[1], at[0]))
    window = image[np.ix_(row, col)].astype(float)
    rim = np.concatenate([window[[0, 1, -2, -1]].ravel(), window[:, [0, 1, -2, -1]].ravel()])
    if rim.max() > 0.01 * window.max() or window.max() <= 0:
        return None
    return [window.sum(0) @ (col + 0.5) / window.sum(), window.sum(1) @ (row + 0.5) / window.sum()]


def test_two_cameras_triangulate_the_same_bodies():
    """Bright ones that stand alone in both images, by their brightest places; the cells tell where they are."""
    view = {"resolution": [192, 108]}
    pair = [CAMERA | view | {"id": name, "position": [x, 0, 0]} for name, x in (("L0", -0.06), ("R0", 0.06))]
    scene = snow_scene(particles={"share": 0.001, "radius_m": [0.001, 0.0015], "wander_m_s": 0, "least_px": 0.15})
    scene = scene.model_copy(
        update={
            "vehicle": scene.vehicle.model_copy(
                update={"cameras": tuple(type(scene.vehicle.cameras[0])(**camera) for camera in pair)}
            )
        }
    )
    snowing = Snowing(scene)
    images, found = [], []
    for camera in scene.vehicle.cameras:
        images.append(snowing(camera=camera.id).light[..., 1])
        found.append(snowing.splats)
    p, _, _ = snowing.bodies()
    models = [camera_model(camera) for camera in scene.vehicle.cameras]
    offset = [np.array([x, 0, 0]) for x in (-0.06, 0.06)]

    def projected(points, k):
        local = points - offset[k]
        return models[k].project(np.stack([local[..., 0], -local[..., 2], local[..., 1]], -1))

    places = np.stack([projected(p, k) for k in range(2)], 1)
    checked = 0
    for i in np.argsort(p[:, 1]):
        at = places[i]
        if not (0.4 < p[i, 1] < 2 and (at > 12).all() and (at < np.array([180, 96])).all()):
            continue
        away = [np.sort(np.hypot(s["x"] - at[k, 0], s["y"] - at[k, 1])) for k, s in enumerate(found)]
        if not all(one[0] < 0.05 and one[1] > 8 for one in away):
            continue
        seen = [centroid(images[k], at[k]) for k in range(2)]
        if any(c is None for c in seen):
            continue
        solved = least_squares(
            lambda q, seen=seen: (np.stack([projected(q, k) for k in range(2)]) - seen).ravel(), p[i] * 1.05
        )
        assert np.abs(solved.fun).max() < 0.3, (p[i], solved.fun)
        back = np.stack([projected(solved.x, k) for k in range(2)])
        assert np.abs(back - at).max() < 0.3, (p[i], solved.x)
        checked += 1
    assert checked >= 10
