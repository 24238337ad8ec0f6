"""What renders a dataset: here, one device of this process; in cluster.py, many workers. Both have the same methods."""

import contextlib
import threading
from collections.abc import Callable, Sequence

import numpy as np

from varos_warp.dataset.run.pipeline import AT_ONCE, Rendered, render_frames
from varos_warp.dataset.run.timing import Clock
from varos_warp.dataset.write.images import ImageJob, Store
from varos_warp.render.image.denoise import available_method


class Stopped(Exception):
    """The run has ended: an image that waited for the device is not begun."""


class Places:
    """Room on a device for a few images at a time, until it is ``stopped``."""

    def __init__(self, count: int):
        self._free, self.stopped = threading.Semaphore(count), False

    def __enter__(self) -> None:
        self._free.acquire()
        if self.stopped:
            self._free.release()
            raise Stopped

    def __exit__(self, *_) -> None:
        self._free.release()


class Engine:
    """Renders in this process.

    Args:
        device: ``auto``, ``cpu`` or ``cuda:N``.
        renderer: A `FrameRenderer` of the scene, where there is one already.
        cores: That rendering on a CPU, and writing, may use; absent: all that the process may.

    Raises:
        InputError: If there is no such device.
    """

    def __init__(self, device: str = "auto", renderer=None, cores: int | None = None):
        from varos_warp.scene.device import kind_of, resolve_device

        self.device = resolve_device(device) if renderer is None else renderer.device
        self.renderer, self.cores = renderer, cores
        self.at_once = AT_ONCE[kind_of(self.device)]
        """Images that may be under way on the device."""
        self._places = Places(self.at_once)
        self._turn = threading.Lock()

    def __enter__(self) -> "Engine":
        return self

    def __exit__(self, *_) -> None:
        self.renderer = None

    def start(self, root, say=None) -> None:
        """Nothing is to be started; see `Cluster.start`."""

    def available_method(self, asked: str) -> str:
        """The denoiser that stands in for another one, or this one itself."""
        return available_method(asked)

    def load(self, scene, poses: Sequence[np.ndarray], path=None) -> list[str]:
        """Bring the scene onto the device.

        Args:
            scene: The scene.
            poses: T_w_v [4, 4] of every frame of the sequence.
            path: Where the vehicle comes, as `path_samples` has it; absent: the scene is not looked at for errors.

        Returns:
            What looks wrong in the scene.
        """
        self.scene, self.poses = scene, poses
        if self.renderer is not None:
            return []
        from varos_warp.render.renderer import FrameRenderer
        from varos_warp.scene.checks import check_scene
        from varos_warp.scene.geometry.build import build_parts

        parts = build_parts(scene)
        warnings = [] if path is None else check_scene(scene, parts, path)
        threads = {"threads": self.cores} if self.cores else {}
        self.renderer = FrameRenderer(scene, self.device, parts, **threads)
        return warnings

    @property
    def devices(self) -> list[dict[str, str]]:
        """Name and model of every device that renders; the first is the one that plans."""
        return [{"name": self.renderer.device, "model": self.renderer.device_name}]

    @property
    def segments(self) -> Sequence[dict]:
        """What the numbers of S stand for."""
        return self.renderer.segments

    @property
    def compile_seconds(self) -> float:
        """Spent so far on compiling kernels."""
        return self.renderer.compile_seconds

    def plan(self):
        """The `Plan` of the sequence."""
        from varos_warp.render.planner.plan import plan_render

        return plan_render(self.scene, self.renderer, self.poses)

    def render(self, store: Store, plan: dict, jobs: Sequence[ImageJob], *, made: Rendered, clock: Clock,
               done: Callable[[], None] = lambda: None, say: Callable[[str], None] = lambda message: None,
               turn: Callable[[], contextlib.AbstractContextManager] | None = None) -> None:
        """Render images and write their files; the arguments are those of `render_frames`.

        Several threads may call it: no more of their images are under way than the device takes at once.
        """
        render_frames(self.renderer, store, plan, jobs, self.poses.__getitem__, made=made, clock=clock, done=done,
                      say=say, turn=turn or (lambda: self._turn), place=self._places, cores=self.cores,
                      at_once=min(self.at_once, len(jobs)))

    def stop(self) -> None:
        """Begin no more images, whichever threads wait for the device with some."""
        self._places.stopped = True
