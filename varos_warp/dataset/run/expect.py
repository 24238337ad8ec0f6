"""What a dataset of a scene will take, before anything of it is made: by what others took.

Right within a factor of two or three; `varos-warp plan` measures on the scene itself.
"""

from typing import TYPE_CHECKING

import numpy as np

from varos_warp.device.devices import resolve_device, usable_cores
from varos_warp.products.images.protocol import Source
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.render.decisions import open_questions, planner_is_here
from varos_warp.scene.description import Scene
from varos_warp.scene.description.render import sees_water
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.frames import camera_pose
from varos_warp.scene.optics.camera import camera_model
from varos_warp.scene.optics.shutter import in_ns

if TYPE_CHECKING:
    from varos_warp.sim.trajectory import Simulation

EXR_BYTES = {"linear_exr": 16.0, "depth_exr": 6.0}
"""Bytes per pixel of A, and of D, with these keys of ``render``."""
SAMPLE_S = {"cpu": 30e-6, "cuda": 35e-9}
"""Seconds for a sample of a pixel of A and its denoising: on one core, and on a large GPU."""
SAMPLE_B_S = {"cpu": 4e-6, "cuda": 5e-9}
"""Seconds for a sample of a pixel of B."""
PIXEL_S = {
    Source.FIRST_HITS: {"cpu": 0.5e-6, "cuda": 5e-9},
    Source.NEXT_FRAME: {"cpu": 1.5e-6, "cuda": 30e-9},
    Source.PARTICLES: {"cpu": 8e-6, "cuda": 25e-9},
}
"""Seconds for a pixel of what first hits tell, all such images together, of F, and of bodies in the water: on one core
(3dab77d; bodies later); beside a GPU, where encoding takes longest, what that takes on 16 such cores."""
RAY_S = {"cpu": 0.5e-6, "cuda": 1e-9}
"""Seconds for each of the rays over a pixel that an image has of its own: on one core, and on a large GPU."""
COMPILE_S = {
    Source.WATER: 24.0,
    Source.AMBIENT: 5.0,
    Source.FIRST_HITS: 4.0,
    Source.NEXT_FRAME: 4.0,
    Source.PARTICLES: 10.0,
}
"""Seconds to compile what each image needs, which is done side by side, and for A to solve for the field: on one
device, however many cores."""
LOAD_S = 1.5
"""Seconds to load a small scene."""
TEST_SPP, COMPARED_SPP = 20, 16
"""Samples by which the planner often finds the samples of A: of a pixel of all test images; and of the small images by
which two integrators are compared."""
USUAL_SPP = 4
"""Samples of A that the planner often chooses."""
MOST_FRAMES = 50
"""Most frames at which streaks are looked for."""


def exposure_facts(scene: Scene, parts: list, simulation: "Simulation") -> list[dict]:
    """Exposures that last: ``id``, ``time_s``, ``readout_s``, ``streak_px``, ``skew_px`` of each, as plain types.

    The last two are how far what the middle of the image sees moves in it at most, of some frames, while a row is
    exposed, and while the rows are read out.
    """
    found = []
    for camera in scene.vehicle.cameras:
        if not camera.exposure.is_instant:
            about = {"time_s": camera.exposure.time_s, "readout_s": camera.exposure.readout_s}
            streak, skew = _longest_moves_px(scene, parts, simulation, camera, list(about.values()))
            found.append({"id": camera.id, **about, "streak_px": streak, "skew_px": skew})
    return found


def _longest_moves_px(
    scene: Scene, parts: list, simulation: "Simulation", camera: Camera, times_s: list[float]
) -> list[float]:
    """How far at most what the middle of an image sees moves in each of some times [px]."""
    from varos_warp.scene.geometry.query import ranges

    frames, model = simulation.frames, camera_model(camera)
    frames = frames.rows(np.unique(np.linspace(0, len(frames) - 1, MOST_FRAMES).astype(int)))
    T_w_c = camera_pose(camera, frames.poses())
    ray, reach = model.rays(model.K[:2, 2]), scene.render.depth_range_m[1]
    start, along = T_w_c[:, :3, :3] @ ray.origin + T_w_c[:, :3, 3], T_w_c[:, :3, :3] @ ray.direction
    points = start + np.minimum(ranges(parts, start, along, reach), reach)[:, None] * along
    moves = np.zeros((len(frames), len(times_s)))
    for k, (point, time_ns) in enumerate(zip(points, frames.time_ns.tolist(), strict=True)):
        motion = simulation.motion(time_ns)
        for i, seconds in enumerate(times_s):
            T = camera_pose(camera, motion(in_ns(seconds * np.array([-0.5, 0.5]))))
            begin, end = (model.project((point - pose[:3, 3]) @ pose[:3, :3]) for pose in T)
            moves[k, i] = np.hypot(*(end - begin))
    return np.nan_to_num(moves).max(0).round(2).tolist()


def dataset_facts(scene: Scene, frames: int) -> dict:
    """Frames, cameras, images, bytes on disk, and seconds on the device at hand, as plain JSON types.

    ``seconds`` are from nothing; ``plan_seconds`` and ``compile_seconds`` of them are spent once.
    """
    render, device = scene.render, resolve_device("auto").partition(":")[0]
    pixels = frames * sum(camera.resolution[0] * camera.resolution[1] for camera in scene.vehicle.cameras)
    images = [OUTPUTS[letter] for letter in render.outputs]
    per_pixel = sum(image.bytes_a_pixel for image in images)
    per_pixel += sum(size for key, size in EXR_BYTES.items() if getattr(render, key))
    cores = usable_cores() if device == "cpu" else 1
    planning = _samples_to_plan(scene, frames) * SAMPLE_S[device] / cores
    compiling = max(COMPILE_S[image.source] for image in images)
    seconds = LOAD_S + compiling + planning + pixels * _pixel_seconds(scene, device) / cores
    return {
        "frames": frames,
        "cameras": len(scene.vehicle.cameras),
        "images": frames * len(scene.vehicle.cameras) * len(render.outputs),
        "bytes": round(pixels * per_pixel),
        "seconds": round(seconds, 1),
        "plan_seconds": round(planning, 1),
        "compile_seconds": compiling,
        "device": device,
        "cores": cores,
        **_samples(scene),
    }


def _samples(scene: Scene) -> dict:
    """Samples per pixel of images of light in water, and whether a plan chooses them; None where there are none."""
    if not sees_water(scene.render.outputs):
        return {"spp": None, "spp_is_planned": False}
    return {"spp": scene.render.spp or USUAL_SPP, "spp_is_planned": scene.render.spp is None}


def _pixel_seconds(scene: Scene, device: str) -> float:
    """Seconds for a pixel of all the images of a frame, on one core or a GPU."""
    sources = [OUTPUTS[letter].source for letter in scene.render.outputs]
    if scene.particles and Source.WATER in sources:
        sources.append(Source.PARTICLES)
    of_water = sources.count(Source.WATER) * (_samples(scene)["spp"] or 0) * SAMPLE_S[device]
    of_b = sources.count(Source.AMBIENT) * scene.render.spp_b * SAMPLE_B_S[device]
    rays = sum(OUTPUTS[letter].rays for letter in scene.render.outputs)
    of_hits = sum(seconds[device] for source, seconds in PIXEL_S.items() if source in sources)
    return of_water + of_b + rays * RAY_S[device] + of_hits


def _samples_to_plan(scene: Scene, frames: int) -> int:
    """Samples of pixels that a plan often takes, where it is not kept from before; none where the scene says all."""
    asked, cameras = open_questions(scene), scene.vehicle.cameras
    if not asked or not planner_is_here():
        return 0
    from varos_warp.render.planner import by_frame
    from varos_warp.render.planner.pilot import SMALL, SMALL_SPP, pilot_frames, pixels_tried

    views = 2 * len(pilot_frames(frames)) * len(cameras) * SMALL * SMALL_SPP
    whole = int(np.prod(cameras[0].resolution))
    tried = min(pixels_tried(cameras[0], frames), whole)
    poses = len(by_frame.tried_frames(frames, tried / whole)) * len(cameras)
    tests = TEST_SPP + round(poses * USUAL_SPP * by_frame.A_POSE)
    return views + COMPARED_SPP * SMALL * ("integrator" in asked) + tests * tried * ("samples" in asked)
