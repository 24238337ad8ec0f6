"""What a dataset of a scene will take, before anything of it is made: by what others took.

Right within a factor of two or three; `varos-warp plan` measures on the scene itself.
"""

from varos_warp.scene.description import Scene
from varos_warp.scene.device import resolve_device
from varos_warp.scene.launch import usable_cores

BYTES = {"A": 4.0, "B": 5.0, "C": 0.6, "D": 0.6, "S": 0.05, "P": 4.0, "F": 12.0}
"""Of a pixel of each image type, PNG and EXR, in the template harbour_wall; F's EXR hardly compresses."""
EXR_BYTES = {"linear_exr": 16.0, "depth_exr": 6.0}
"""Of a pixel of A, and of D, with these keys of ``render``."""
SAMPLE_S = {"cpu": 50e-6, "cuda": 35e-9}
"""For a sample of a pixel of A and its denoising: on one core, and on a large GPU."""
SAMPLE_B_S = {"cpu": 8e-6, "cuda": 5e-9}
"""For a sample of a pixel of B."""
START_S = {"cpu": 40.0, "cuda": 30.0}
"""To compile, load and plan: seconds on one device, however many cores."""
USUAL_SPP = 8
"""Samples of A that the planner often chooses."""


def dataset_facts(scene: Scene, frames: int) -> dict:
    """Frames, images, bytes on disk, and seconds on the device at hand, as plain JSON types."""
    render, device = scene.render, resolve_device("auto").partition(":")[0]
    pixels = frames * sum(camera.resolution[0] * camera.resolution[1] for camera in scene.vehicle.cameras)
    per_pixel = sum(BYTES[letter] for letter in render.outputs)
    per_pixel += sum(size for key, size in EXR_BYTES.items() if getattr(render, key))
    of_a = sum(letter in render.outputs for letter in "AP") * (render.spp or USUAL_SPP) * SAMPLE_S[device]
    of_b = ("B" in render.outputs) * render.spp_b * SAMPLE_B_S[device]
    cores = usable_cores() if device == "cpu" else 1
    return {"frames": frames, "images": frames * len(scene.vehicle.cameras) * len(render.outputs),
            "bytes": round(pixels * per_pixel), "seconds": round(START_S[device] + pixels * (of_a + of_b) / cores, 1),
            "device": device, "cores": cores, "spp": render.spp or USUAL_SPP, "spp_is_planned": render.spp is None}
