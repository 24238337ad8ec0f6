"""A vehicle on an exact course over a flat floor, rendered by ray casting in numpy: quick, and every truth is known."""

from contextlib import nullcontext
from dataclasses import fields
from types import SimpleNamespace

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.products.images.flow import FlowImage
from varos_warp.products.sensors.registry import ASKED_FOR, mounted
from varos_warp.render.decisions import Decision, Plan
from varos_warp.render.image.flow import flow_of
from varos_warp.render.options import RenderOptions
from varos_warp.scene.description.optics import twin
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import camera_pose, inverse, pose_matrix
from varos_warp.scene.optics.camera import camera_model, pixel_centres
from varos_warp.scene.optics.shutter import open_ns
from varos_warp.sim.clock import TICK_NS
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.sensors.suite import measured
from varos_warp.sim.sensors.surroundings import Around

FLOOR_Z = -3.0
OPTIONS = {field.name for field in fields(RenderOptions)}


def scene_dict(**changes):
    """A scene of one second with a stereo pair; ``changes`` replace whole blocks."""
    return {
        "name": "test",
        "seed": 3,
        "surface_depth_m": 80.0,
        "water": {"coefficients": {"sigma_s": [0.01, 0.02, 0.04], "sigma_a": [0.1, 0.04, 0.0]}},
        "vehicle": {
            "lights": [{"kind": "spot", "position": [0.15, -0.1, 0.0], "direction": [0, 1, -0.2], "blend": 0.15}],
            "cameras": [
                {"id": name, "position": [x, 0, 0], "rotation_euler_deg": [-15, 0, 0], "resolution": [48, 27]}
                for name, x in (("L0", -0.1), ("R0", 0.1))
            ],
            "imu": {"position": [0.1, 0.2, 0.05], "rotation_euler_deg": [5, 10, 15]},
            "depth_gauge": {"position": [0.0, 0.3, 0.1]},
        },
        "trajectory": {"poses": [{"position": [0, 0, 0]}]},
        "render": {"frame_rate_hz": 10, "spp": 8, "denoise": "nlm"},
    } | changes


def make_scene(render=None, **changes):
    """A scene; ``render`` adds to its block."""
    data = scene_dict(**changes)
    data["render"] |= render or {}
    return scene_from_dict(data)


def simulate(scene, parts=None, *, progress=None):
    """A vehicle that sways and turns, with closed forms for every derivative (world axes, small yaw only)."""
    seconds, rate = 1.0, 200
    ticks = np.arange(int(seconds * rate) + 1 + -(-open_ns(scene.vehicle.cameras) // TICK_NS))
    t = ticks / rate
    w = 2.0
    position = np.column_stack([0.3 * np.sin(w * t), 0.5 * t, 0.1 * np.cos(w * t)])
    velocity = np.column_stack([0.3 * w * np.cos(w * t), np.full_like(t, 0.5), -0.1 * w * np.sin(w * t)])
    acceleration = np.column_stack([-0.3 * w**2 * np.sin(w * t), np.zeros_like(t), -0.1 * w**2 * np.cos(w * t)])
    yaw = 0.4 * np.sin(t)
    rotation = Rotation.from_rotvec(yaw[:, None] * [0.0, 0.0, 1.0])
    omega = np.column_stack([np.zeros_like(t), np.zeros_like(t), 0.4 * np.cos(t)])
    alpha = np.column_stack([np.zeros_like(t), np.zeros_like(t), -0.4 * np.sin(t)])
    time_ns = ticks.astype(np.int64) * 5_000_000

    imu = SimpleNamespace(time_ns=time_ns)
    R_v_s = pose_matrix(scene.vehicle.imu)[:3, :3]
    lever = np.array(scene.vehicle.imu.position)
    body = rotation.inv().apply(acceleration + [0, 0, scene.gravity])
    body = body + np.cross(omega, np.cross(omega, lever)) + np.cross(alpha, lever)
    imu.acceleration, imu.angular_velocity = body @ R_v_s, omega @ R_v_s
    imu.true_acceleration, imu.true_angular_velocity = imu.acceleration, imu.angular_velocity
    imu.acceleration_bias = imu.angular_velocity_bias = np.zeros_like(body)
    if scene.vehicle.imu.noise is not None:
        imu.acceleration_bias = np.full_like(body, 0.3)
        white = scene.vehicle.imu.noise.accelerometer_noise_density * np.sqrt(rate)
        white = white * np.random.default_rng(scene.seed).standard_normal(body.shape)
        imu.acceleration = imu.acceleration + imu.acceleration_bias + white
    trajectory = Trajectory(
        time_ns, position, velocity, acceleration, rotation.as_quat(canonical=True, scalar_first=True), omega, alpha
    )
    gauge = rotation.apply(scene.vehicle.depth_gauge.position) + position
    return SimpleNamespace(
        trajectory=trajectory,
        frames=trajectory.at(time_ns[:200:20]),
        imu=imu,
        motion=lambda at_ns: lambda offset_ns: trajectory.from_before(at_ns + offset_ns).poses(),
        depth_gauge=SimpleNamespace(time_ns=time_ns, depth=scene.surface_depth_m - gauge[:, 2]),
        messages=[],
        **{
            sensor.key: measured(sensor, trajectory, block, Around(parts=parts or ()))
            for sensor, block in mounted(scene.vehicle)
            if sensor.key in ASKED_FOR
        },
    )


def course_facts(simulation, scene):
    """Of any course the same."""
    return {"length_m": 12.0, "duration_s": 34.0, "heads_for": None}


def path_samples(simulation):
    """Where the vehicle is every 25 ms, and was meant to be."""
    trajectory = simulation.trajectory
    return (
        trajectory.time_ns[::5],
        trajectory.position[::5],
        trajectory.position[::5],
        np.zeros(len(trajectory.time_ns[::5]), int),
    )


class FlatFloorRenderer:
    """Stands in for a FrameRenderer: a floor at z = -3 with a checker pattern and noise keyed as the real one's."""

    device, device_name, compile_seconds = "cpu", "numpy", 0.0
    segments = ({"id": 1, "key": "terrain", "kind": "terrain", "material": "checker", "material_id": 1},)

    def __init__(self, scene, device="auto", parts=None):
        self.scene, self.calls, self.stop_after = scene, [], None

    def compiling(self, outputs, integrator=None):
        return nullcontext()

    def relit(self, scene):
        return type(self)(scene)

    def render(self, T_w_v, camera, outputs, *, spp, frame, following=None, motion=None, time_ns=0, **options):
        assert options.keys() <= OPTIONS
        if self.stop_after is not None and len(self.calls) >= self.stop_after:
            raise KeyboardInterrupt
        if isinstance(camera, str):
            self.calls.append((frame, camera, outputs))
            camera = next(c for c in self.scene.vehicle.cameras if c.id == camera)
        view = camera
        T_w_c, model = camera_pose(view, T_w_v), camera_model(view)
        width, height = view.resolution
        col, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        if model.is_pinhole:
            start, ray = np.zeros(3), np.stack([col, row, np.ones_like(col)], -1) @ np.linalg.inv(model.K).T
        else:
            start, ray, _ = model.rays(np.stack([col, row], -1))
        down = (ray @ T_w_c[:3, :3].T)[..., 2]
        with np.errstate(divide="ignore"):
            t = np.where(down < 0, (FLOOR_Z - T_w_c[2, 3] - start @ T_w_c[2, :3]) / down, np.inf)
            z = np.where(np.isfinite(t), start[..., 2] + t * ray[..., 2], np.inf)
        hit = np.isfinite(z)
        point = np.where(hit[..., None], start + ray * np.where(hit, t, 0)[..., None], 0)
        point = point @ T_w_c[:3, :3].T + T_w_c[:3, 3]
        tone = np.where(hit, 0.3 + 0.3 * (np.floor(point[..., 0]) + np.floor(point[..., 1])) % 2, 0.02)
        plain = dict.fromkeys(("albedo", "normal", "correction", "denoised", "snow"))
        plain |= {"spp": float(spp), "lost_samples": 0}
        A = None
        if "A" in outputs:
            light = tone / np.where(hit, np.maximum(z, 1), 1) ** 2
            clean = light[..., None] * np.array([0.4, 0.7, 1.0])
            error = (clean / np.sqrt(spp)).astype(np.float32)
            rng = np.random.default_rng([self.scene.seed, frame, *view.id.encode()])
            noisy = (clean * rng.gamma(spp, 1 / spp, clean.shape)).astype(np.float32)
            A = SimpleNamespace(
                **plain, radiance=noisy, stderr=error, layers={"direct": noisy / 2, "single": noisy / 2}
            )
        B = C = D = S = None
        if "B" in outputs:
            grey = (tone[..., None] * np.ones(3)).astype(np.float32)
            B = SimpleNamespace(**plain, radiance=grey, stderr=grey * 0, layers={})
        if "C" in outputs:
            C = SimpleNamespace(normal=np.where(hit[..., None], [0.0, 0.0, 1.0], 0.0).astype(np.float32))
        if {"D", "F"} & {*outputs}:
            D = SimpleNamespace(depth=z.astype(np.float32), range=(t * np.linalg.norm(ray, axis=-1)).astype(np.float32))
        if "S" in outputs:
            S = SimpleNamespace(instance=hit.astype(np.int32), material=hit.astype(np.int32))
        P = self.render(T_w_v, twin(view), "A", spp=spp, frame=frame).A if "P" in outputs else None
        F = None
        if "F" in outputs:  # a floor hides nothing
            points = pixel_centres(*view.resolution)
            T_next_c = inverse(camera_pose(view, following.T_w_v)) @ T_w_c
            moved = flow_of(model, points, model.rays(points), D.range, T_next_c)
            F = FlowImage(moved.flow.astype(np.float32), np.zeros(z.shape, bool), moved.motion.astype(np.float32))
        made = {"A": A, "B": B, "C": C, "D": D, "S": S, "P": P, "F": F}
        return SimpleNamespace(**{k: v for k, v in made.items() if k in outputs})


def plan_render(scene, renderer, poses, **options):
    """As the planner: where A is not among the outputs, it does not look for samples."""
    what, spp = ("spp", 8) if {"A", "P"} & set(scene.render.outputs) else ("A", 1)
    return Plan(
        scene.render.spp or spp,
        scene.render.max_scatterings,
        scene.render.max_bounces,
        decisions=[Decision(what, str(spp), "a test")],
        models=dict.fromkeys(scene.render.outputs, "a test"),
    )


def compiling_foretold(scene, device, letters, integrator=None):
    """Nothing, for the renderer that stands in launches no kernels; those of so many scenes took minutes to compile."""
    return nullcontext()


PLACES = {
    "render.kinds": {"compiling_foretold": "compiling_foretold"},
    "sim.trajectory": {"simulate": "simulate", "path_samples": "path_samples", "course_facts": "course_facts"},
    "render.planner.plan": {"plan_render": "plan_render"},
    "render.renderer": {"FrameRenderer": "FlatFloorRenderer"},
}
"""Modules of the package, and what here stands in for which of their names."""


def install(monkeypatch, places=tuple(PLACES)):
    """Put them in the place of the simulation, the planner and the renderer, which have tests of their own."""
    for name in places:
        for member, stand_in in PLACES[name].items():
            monkeypatch.setattr(f"varos_warp.{name}.{member}", globals()[stand_in])


def tree(root):
    """Bytes of every file of a dataset by its path, without the log of who rendered when."""
    return {
        p.relative_to(root).as_posix(): p.read_bytes()
        for p in sorted(root.rglob("*"))
        if p.is_file() and "log" not in p.relative_to(root).parts
    }
