"""What a plan costs in time: measured on the device, and of no influence on what is planned."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from varos_warp.render.moments import NextFrame
from varos_warp.render.options import of_scene
from varos_warp.render.planner import pilot
from varos_warp.render.planner.by_frame import mean_spp
from varos_warp.render.planner.pilot import pilot_camera
from varos_warp.scene.description import Scene
from varos_warp.scene.description.optics import has_twin
from varos_warp.scene.description.vehicle import Camera

MOST_COSTED = 16
"""Samples per pixel that are rendered to measure a cost on a CPU."""


def sequence_cost(scene: Scene, renderer, poses, plan) -> dict[str, Any]:
    """Seconds that rendering by a `Plan` takes on this device, without denoising and writing.

    From the pose in the middle, with the samples of an average frame.
    """
    asked = scene.render.outputs
    groups = ("".join(letter for letter in group if letter in asked) for group in ("A", "P", "B", "CDSF"))
    free = [camera for camera in scene.vehicle.cameras if "A" in asked and not has_twin(camera)]  # P is A
    seconds = {letters: sum(_seconds(scene, renderer, camera, poses, letters, plan) for camera in scene.vehicle.cameras
                            if letters != "P" or camera not in free) for letters in groups if letters}
    a_frame = sum(seconds.values())
    return {"device": f"{renderer.device} ({renderer.device_name})", "frames": len(poses),
            "cameras": len(scene.vehicle.cameras), "seconds_per_frame": float(f"{a_frame:.3g}"),
            "seconds_by_output": {letters: float(f"{value:.3g}") for letters, value in seconds.items()},
            "seconds_in_all": float(f"{a_frame * len(poses):.3g}")}


def timed(renderer, make: Callable[[], Any]) -> tuple[Any, float]:
    """What is made, and the seconds that it took, compiling aside."""
    start, compiled = time.perf_counter(), renderer.compile_seconds
    made = make()
    return made, time.perf_counter() - start - (renderer.compile_seconds - compiled)


def _seconds(scene: Scene, renderer, camera: Camera, poses, letters: str, plan) -> float:
    """Seconds for one image. On a CPU, of a large one: from two small ones, as a constant and so much a pixel."""
    spp, T_w_v = round(mean_spp(plan.to_dict(), camera.id, len(poses))), poses[len(poses) // 2]

    def measured(view: Camera, factor: float) -> float:
        few = {"spp": max(1, round(spp * factor)), "spp_b": max(1, round(scene.render.spp_b * factor))}
        how = of_scene(scene) | plan.options | few | ({"following": NextFrame(T_w_v)} if "F" in letters else {})
        return timed(renderer, lambda: renderer.render(T_w_v, view, letters, **how))[1]

    large, small = (pilot_camera(camera, pixels) for pixels in (pilot.PIXELS, pilot.PIXELS // 4))
    measured(small, 0.0)  # compiles, and solves for the field
    if renderer.device != "cpu":  # a GPU is not full with a small image
        return measured(camera, 1.0)
    samples = {"A": spp, "P": spp, "B": scene.render.spp_b}.get(letters, 1)
    factor = min(1.0, MOST_COSTED / samples)
    at_large = measured(large, factor)
    if large.resolution == camera.resolution:
        return at_large / factor
    pixels = [np.prod(view.resolution) for view in (camera, large, small)]
    a_pixel = max(at_large - measured(small, factor), 0.0) / (pixels[1] - pixels[2])
    return (at_large + a_pixel * (pixels[0] - pixels[1])) / factor
