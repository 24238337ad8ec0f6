"""A stand-in with relief: hills and an albedo that tell one frame from another, in A, B, C and D."""

from types import SimpleNamespace

import numpy as np
import standins

from varos_warp.products.images.flow import FlowImage
from varos_warp.render.image.flow import flow_by_rows
from varos_warp.scene.frames import camera_pose, intrinsics
from varos_warp.scene.optics.camera import camera_model, pixel_centres
from varos_warp.scene.optics.shutter import in_ns, is_rolling, row_offsets_s

EXPOSED = 5
"""Instants of an exposure that B of `ShutterRenderer` is the mean of."""


def height(x, y):
    return -3.0 + 0.25 * np.sin(3.0 * x + 1.0) * np.cos(2.5 * y) + 0.1 * np.sin(7.0 * y + x)


HIGHEST = -2.6
"""No hill reaches so high."""


def depth_of_hills(origin, rays):
    """Where rays [H, W, 3] meet the ground, in lengths of their vectors [H, W]; infinite for those that do not."""
    x, y, z = rays.reshape(-1, 3).T
    start = np.broadcast_to(origin, rays.shape).reshape(-1, 3).T

    def above(t, at):
        return start[2, at] + t * z[at] - height(start[0, at] + t * x[at], start[1, at] + t * y[at])

    low, on = np.full(len(z), np.inf), np.arange(len(z))
    for step in np.arange(2.05, 12.0, 0.05):
        near = np.flatnonzero(start[2, on] + step * z[on] < HIGHEST)
        under = near[above(step, on[near]) < 0.0]
        low[on[under]], on = step - 0.05, np.delete(on, under)
    hit = np.isfinite(low)
    high = low + 0.05
    for _ in range(26):  # to a nanometre
        middle = (low[hit] + high[hit]) / 2
        below = above(middle, hit) < 0.0
        low[hit], high[hit] = np.where(below, low[hit], middle), np.where(below, middle, high[hit])
    return ((low + high) / 2).reshape(rays.shape[:2])


class HillsRenderer(standins.FlatFloorRenderer):
    """Rays marched to a height field; B is its albedo, A falls off with the distance, S parts light from dark."""

    segments = tuple(
        {"id": i + 1, "key": f"objects.{i}", "kind": "boulder", "material": key, "material_id": i + 1}
        for i, key in enumerate(("dark", "light"))
    )

    @staticmethod
    def second(x, tone):
        """Where the second object is seen, bool [H, W]."""
        return tone > 0.5

    def pose(self, view, T_w_v, motion):
        """From where rays start: [4, 4], or of each row [H, 1, 4, 4]."""
        return camera_pose(view, T_w_v)

    def render(self, T_w_v, camera, outputs, *, spp, frame, motion=None, **_):
        view = next(c for c in self.scene.vehicle.cameras if c.id == camera)
        T, (width, rows) = self.pose(view, T_w_v, motion), view.resolution
        col, row = np.meshgrid(np.arange(width) + 0.5, np.arange(rows) + 0.5)
        ray = np.stack([col, row, np.ones_like(col)], -1) @ np.linalg.inv(intrinsics(view)).T
        world = np.einsum("...ij,...j", T[..., :3, :3], ray)

        z = depth_of_hills(T[..., :3, 3], world)
        found = np.isfinite(z)
        point = np.where(found[..., None], world * np.where(found, z, 0)[..., None], 0.0) + T[..., :3, 3]
        x, y, h = point[..., 0], point[..., 1], 1e-6
        n = np.stack(
            [height(x - h, y) - height(x + h, y), height(x, y - h) - height(x, y + h), np.full_like(x, 2 * h)], -1
        )
        n /= np.linalg.norm(n, axis=-1, keepdims=True)
        tone = np.where(found, 0.5 + 0.2 * np.sin(4 * x) * np.sin(5 * y) + 0.1 * np.sin(9 * x), 0.02)
        grey = (tone[..., None] * np.ones(3)).astype(np.float32)
        light = (grey / np.where(found, z, 3.0)[..., None] ** 2).astype(np.float32)
        plain = dict.fromkeys(("albedo", "normal", "correction", "denoised", "snow"))
        plain |= {"spp": float(spp), "lost_samples": 0, "layers": {}}
        images = {
            "A": SimpleNamespace(**plain, radiance=light, stderr=light * 0.01),
            "B": SimpleNamespace(**plain, radiance=grey, stderr=grey * 0),
            "C": SimpleNamespace(normal=np.where(found[..., None], n, 0.0).astype(np.float32)),
            "D": SimpleNamespace(
                depth=z.astype(np.float32), range=(z * np.linalg.norm(ray, axis=-1)).astype(np.float32)
            ),
            "S": SimpleNamespace(instance=np.where(found, 1 + self.second(x, tone), 0).astype(np.int32), material=None),
        }
        return SimpleNamespace(**{k: v for k, v in images.items() if k in outputs})


class ShutterRenderer(HillsRenderer):
    """B is the mean over the exposure; rows of a rolling shutter are of times of their own, between which F goes."""

    def pose(self, view, T_w_v, motion):
        T = camera_pose(view, motion(in_ns(row_offsets_s(view))))
        return T[:, None] if is_rolling(view) else T[0]

    def render(self, T_w_v, camera, outputs, *, motion, following=None, **how):
        view = next(c for c in self.scene.vehicle.cameras if c.id == camera)
        made = super().render(T_w_v, camera, outputs, motion=motion, following=following, **how)
        exposure_ns = in_ns(view.exposure.time_s * (np.arange(EXPOSED) + 0.5 - EXPOSED / 2) / EXPOSED).tolist()
        if "B" in outputs and any(exposure_ns):
            made.B.radiance = np.mean(
                [
                    super(ShutterRenderer, self)
                    .render(T_w_v, camera, "B", motion=lambda offset_ns, later=later: motion(offset_ns + later), **how)
                    .B.radiance
                    for later in exposure_ns
                ],
                axis=0,
            )
        if "F" in outputs:
            model, points = camera_model(view), pixel_centres(*view.resolution)
            here, there = (camera_pose(view, moved(in_ns(row_offsets_s(view)))) for moved in (motion, following.motion))
            moved = flow_by_rows(model, points, model.rays(points), made.D.range, here, there)
            made.F = FlowImage(
                moved.flow.astype(np.float32), np.zeros(points.shape[:2], bool), moved.motion.astype(np.float32)
            )
        return made


class SidesRenderer(HillsRenderer):
    """S parts left from right."""

    segments = tuple(row | {"kind": "pipe"} for row in HillsRenderer.segments)

    @staticmethod
    def second(x, tone):
        return x > 0.0


SIDES = [{"kind": "pipe", "radius": 30.0, "length": 60.0, "position": [x, 0, -30]} for x in (-30, 30)]
"""Two objects, left and right, of which `SidesRenderer` sees the surface."""


def hills_scene(outputs="ABCDS", objects=None, **camera_keys):
    """The scene; ``camera_keys`` replace those of its camera. By default its objects enclose all that is seen."""
    about = {"kind": "boulder", "diameter": 100.0, "position": [0, 0, -3]}
    vehicle = standins.scene_dict()["vehicle"]
    camera = {"id": "M0", "position": [0, 0, 0], "rotation_euler_deg": [-40, 0, 0], "resolution": [144, 80]}
    tones = {"dark": 0.3, "light": 0.6}
    return standins.make_scene(
        vehicle=vehicle | {"cameras": [camera | camera_keys]},
        materials={key: {"kind": "diffuse", "reflectance": [x] * 3} for key, x in tones.items()},
        objects=[block | {"material": key} for block, key in zip(objects or [about, about], tones, strict=True)],
        render={"denoise": "none", "denoise_b": "none", "depth_exr": True, "outputs": list(outputs)},
    )
