"""A stand-in over a flat floor with a texture of many scales, for features, and water of any turbidity."""

from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import standins

from varos_warp.dataset.run.produce import produce
from varos_warp.scene.frames import camera_pose, intrinsics

_RNG = np.random.default_rng(5)
_ANGLE, _PHASE = _RNG.uniform(0, 2 * np.pi, (2, 60))
_LENGTH = np.geomspace(0.06, 1.5, 60)
"""Of the waves that make the texture [m]; over 3 m and 225 pixels of focal length, 4.5 pixels and more."""
_WAVES = (2 * np.pi / _LENGTH * [np.cos(_ANGLE), np.sin(_ANGLE)]).T.astype(np.float32)


def texture(x, y):
    """Albedo in 0 to 1, right to a hundredth of a level: sines of float32 take a tenth of the time."""
    x, y = x.astype(np.float32), y.astype(np.float32)
    total = sum(np.sin(x * u + y * v + p) for (u, v), p in zip(_WAVES, _PHASE.astype(np.float32), strict=True))
    return (0.5 + 0.08 * total).clip(0.02, 0.98)


@lru_cache(maxsize=64)
def floor_seen(resolution, K, T_w_c):
    """Distance [H, W] to the floor in units of planar depth, inf beside it, and the texture there.

    Kept, for datasets of several waters have the same course: nearly all of the time goes into the texture.
    """
    K, T = (np.frombuffer(matrix).reshape(n, n) for matrix, n in ((K, 3), (T_w_c, 4)))
    width, height = resolution
    col, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    world = np.stack([col, row, np.ones_like(col)], -1) @ np.linalg.inv(K).T @ T[:3, :3].T
    with np.errstate(divide="ignore"):
        t = np.where(world[..., 2] < 0, (standins.FLOOR_Z - T[2, 3]) / world[..., 2], np.inf)
    point = world * np.where(np.isfinite(t), t, 0.0)[..., None] + T[:3, 3]
    return t, texture(point[..., 0], point[..., 1])


class TexturedRenderer(standins.FlatFloorRenderer):
    """A is exp(-2 c d) times the texture, and a veil of 1 - exp(-2 c d), with a little noise of the pixels."""

    c, noise = 0.0, 0.002

    def render(self, T_w_v, camera, outputs, **how):
        made = super().render(T_w_v, camera, [letter for letter in outputs if letter != "A"], **how)
        view = next(c for c in self.scene.vehicle.cameras if c.id == camera)
        matrices = (np.asarray(m, float).tobytes() for m in (intrinsics(view), camera_pose(view, T_w_v)))
        t, albedo = floor_seen(tuple(view.resolution), *matrices)
        hit = np.isfinite(t)
        left = np.where(hit, np.exp(-2 * self.c * np.where(hit, t, 0.0)), 0.0)
        direct = left * albedo
        rng = np.random.default_rng([how["frame"], *camera.encode()])
        veil = 1.0 - left + rng.normal(0.0, self.noise, left.shape)
        layers = {
            name: np.repeat(layer[..., None], 3, -1).astype(np.float32)
            for name, layer in (("direct", direct), ("single", veil))
        }
        if "A" in outputs:
            made.A = SimpleNamespace(
                **dict.fromkeys(("albedo", "normal", "correction", "denoised", "snow")),
                spp=1.0,
                lost_samples=0,
                radiance=layers["direct"] + layers["single"],
                stderr=0 * layers["direct"],
                layers=layers,
            )
        return made


def textured_scene(outputs="ADF", resolution=(240, 180), cameras=("L0", "R0"), **render):
    """A stereo pair that looks at the floor, obliquely, and moves along a bent line for two seconds; or one of it."""
    vehicle = standins.scene_dict()["vehicle"]
    vehicle["cameras"] = [
        {"id": name, "position": [x, 0, 0], "rotation_euler_deg": [-60, 0, 0], "resolution": [*resolution]}
        for name, x in (("L0", -0.15), ("R0", 0.15))
        if name in cameras
    ]
    course = [
        {"time_s": t, "position": [0.6 * t, 0.2 * np.sin(2.0 * t), 0.1 * t], "rotation_euler_deg": [0, 0, 6.0 * t]}
        for t in np.linspace(0.0, 2.0, 21).tolist()
    ]
    return standins.make_scene(
        vehicle=vehicle,
        trajectory={"poses": course},
        render={
            "denoise": "none",
            "spp": 1,
            "integrator": "path",
            "outputs": list(outputs),
            "frame_rate_hz": 10,
            "exposure": {"A": 0.9},
            **render,
        },
    )


def write(out, c=0.0, noise=0.002, frames=slice(None), **scene_keys):
    """A dataset of the floor through water with an attenuation c [1/m]."""
    scene = textured_scene(**scene_keys)
    scene = scene.model_copy()
    renderer = TexturedRenderer(scene)
    renderer.c, renderer.noise = c, noise
    produce(scene, out, quiet=True, renderer=renderer, frames=frames)
    return out
