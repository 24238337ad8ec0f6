"""What a plan costs in time: measured on the device, and of no influence on what is planned."""

import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from varos_warp.device.devices import usable_cores
from varos_warp.device.launcher import at_once, timed
from varos_warp.products.images.protocol import Source
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.render.image.denoise import denoise_image, denoisers_of
from varos_warp.render.moments import NextFrame
from varos_warp.render.options import of_run, of_scene
from varos_warp.render.planner import pilot
from varos_warp.render.planner.pilot import Frames, pilot_camera
from varos_warp.scene.description import Scene
from varos_warp.scene.description.image_types import OF_NEXT_FRAME, TWIN, WATER
from varos_warp.scene.description.optics import has_twin
from varos_warp.scene.description.render import LEAST_SPP
from varos_warp.scene.description.vehicle import Camera

MOST_COSTED = 16
"""Samples per pixel that are rendered to measure a cost on a CPU."""
COSTED_POSES = {"cpu": 3, "cuda": 12}
"""Frames of which the mean counts: views take unlike times, by what they see; and on a GPU some are made at once."""


def sequence_cost(scene: Scene, frames: Frames, plan) -> dict[str, Any]:
    """Seconds that rendering by a `Plan` takes on this device.

    From frames along the sequence, with the samples of an average frame and with denoising; writing takes a few per
    cent more. On a CPU as if nothing else ran there; on a GPU several at once, as in a run.
    """
    asked = scene.render.outputs
    groups = _groups(asked)
    free = [camera for camera in scene.vehicle.cameras if WATER in asked and not has_twin(camera)]  # P is A
    renderer, measure = frames.renderer, _on_cpu if frames.renderer.device == "cpu" else _on_gpu
    seconds = {
        letters: sum(
            measure(scene, frames, camera, letters, plan)
            for camera in scene.vehicle.cameras
            if letters != TWIN or camera not in free
        )
        for letters in groups
    }
    a_frame = sum(seconds.values())
    return {
        "device": f"{renderer.device} ({renderer.device_name})",
        "frames": len(frames),
        "cameras": len(scene.vehicle.cameras),
        "seconds_per_frame": float(f"{a_frame:.3g}"),
        "seconds_by_output": {letters: float(f"{value:.3g}") for letters, value in seconds.items()},
        "seconds_in_all": float(f"{a_frame * len(frames):.3g}"),
    }


def _groups(asked: Iterable[str]) -> list[str]:
    """Letters of images that are measured together: radiance each by itself, what follows from first hits at once."""
    order = [*Source]
    images = sorted((OUTPUTS[letter] for letter in OUTPUTS if letter in asked), key=lambda i: order.index(i.source))
    alike = "".join(image.letter for image in images if not image.is_color)
    return [image.letter for image in images if image.is_color] + [alike] * bool(alike)


def _rendered(scene: Scene, frames: Frames, frame: int, view: Camera, letters: str, plan, samples: dict[str, float]):
    """Images of one view, as a run renders them, but for the samples, and for F as if nothing went on."""
    render = scene.render
    of_images = of_run(frames.renderer.device, denoisers_of(render), render.linear_exr)
    how = of_scene(scene) | of_images | plan.options | samples
    if not OF_NEXT_FRAME.isdisjoint(letters):
        how["following"] = NextFrame(frames.poses[frame], motion=frames.motion_at(frame))
    return frames.render(frame, view, letters, **how)


def _samples(scene: Scene, camera: Camera, count: int, plan) -> dict[str, float]:
    """Samples per pixel of an average frame, as options."""
    return {"spp": plan.mean_spp(camera.id, count), "spp_b": scene.render.spp_b}


def _on_gpu(scene: Scene, frames: Frames, camera: Camera, letters: str, plan) -> float:
    """Seconds for one image: of its own size, for a GPU is not full with a small one."""
    samples, places = _samples(scene, camera, len(frames), plan), _places(len(frames), "cuda")
    _rendered(scene, frames, places[0], camera, letters, plan, samples)  # compiles, and learns how to denoise

    def rendered(frame: int):
        return _rendered(scene, frames, frame, camera, letters, plan, samples)

    made, seconds = timed(frames.renderer, lambda: list(at_once(frames.renderer.device, rendered, places)))
    return seconds / len(made)


def _on_cpu(scene: Scene, frames: Frames, camera: Camera, letters: str, plan) -> float:
    """Seconds for one image, of a large one from small ones: a constant, and so much a pixel."""
    samples = _samples(scene, camera, len(frames), plan)
    taken = {Source.WATER: samples["spp"], Source.AMBIENT: samples["spp_b"]}.get(OUTPUTS[letters[0]].source, 1)
    factor = min(1.0, MOST_COSTED / taken)
    few = {"spp": max(LEAST_SPP, factor * samples["spp"]), "spp_b": max(1, round(factor * samples["spp_b"]))}

    def measured(view: Camera, frame: int) -> tuple[float, float]:
        """Seconds of rendering an image of as many samples as an average frame, and of denoising it."""
        image, rendering = _core_seconds(lambda: _rendered(scene, frames, frame, view, letters, plan, few))
        return rendering / factor, _core_seconds(lambda: _denoise(scene, image, letters))[1]

    large, small = (pilot_camera(camera, pixels) for pixels in (pilot.PIXELS, pilot.PIXELS // 4))
    places = _places(len(frames), "cpu")
    measured(small, places[0])  # compiles, and solves for the field
    at_large = np.mean([measured(large, frame) for frame in places], axis=0)
    if large.resolution == camera.resolution:
        return float(at_large.sum())
    at_small = np.mean([measured(small, frame) for frame in places], axis=0)
    pixels = [np.prod(view.resolution) for view in (camera, large, small)]
    a_pixel = np.maximum(at_large - at_small, 0.0) / (pixels[1] - pixels[2])
    return float((at_large + a_pixel * (pixels[0] - pixels[1])).sum())


def _places(count: int, kind: str) -> list[int]:
    """Frames of ``count``, evenly spread, by which a device of a kind is measured."""
    return [(2 * k + 1) * count // (2 * COSTED_POSES[kind]) for k in range(COSTED_POSES[kind])]


def _denoise(scene: Scene, image, letters: str) -> None:
    """What the host does to A, B or P before it writes them."""
    if OUTPUTS[letters[0]].is_color:
        denoise_image(getattr(image, letters), denoisers_of(scene.render)[OUTPUTS[letters].settings])


def _core_seconds(make: Callable[[], Any]) -> tuple[Any, float]:
    """What is made, and the seconds that it keeps all cores busy: those of other programs do not count."""
    start = time.process_time()
    made = make()
    return made, (time.process_time() - start) / usable_cores()
