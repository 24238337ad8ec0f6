"""Small images of a few poses, made before a sequence is rendered: a plan starts from the noisiest view."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from varos_warp.render.image.denoise import denoise_image
from varos_warp.render.moments import Motion
from varos_warp.render.options import of_scene
from varos_warp.render.planner.errors import relative
from varos_warp.scene.description import Scene
from varos_warp.scene.description.image_types import DEPTH, WATER
from varos_warp.scene.description.optics import resized
from varos_warp.scene.description.vehicle import Camera
from varos_warp.sim.clock import times_ns

POSES = 5
SMALL, SMALL_SPP = 160 * 90, 2
"""Pixels of an image that tells where the noise is; smaller ones get more samples per pixel, the same in all."""
PIXELS = 320 * 180
"""Most pixels of a test image of a short sequence. A larger image has more pixels for the same edges and details, so it
needs fewer samples: a third, with eight times the pixels."""
WORTH = 250
"""A sequence of so many frames is worth test images of its own resolution."""
SEED, SECOND_SEED = 1 << 31, 3 << 30
"""Random numbers of test images, and of the second image of each view: a scene's seed is below the first."""
RARE = 1e-3
"""Share of the pixels that are left out where views are compared, those with most noise: one bright sample in one of
two images would else decide, by chance, and it says little of what the other views need."""
DISTANCES = np.linspace(0.01, 0.99, 25)
"""Quantiles that stand for the distances that a camera sees."""


@dataclass(frozen=True)
class Frames:
    """The frames of a sequence, for which a plan is made."""

    renderer: Any
    """The scene's `FrameRenderer`."""
    poses: Sequence[np.ndarray]
    """T_w_v [4, 4] of each."""
    time_ns: Sequence[int]
    """Time of each [ns]."""
    motion: Callable[[int], Motion] | None = None
    """Motion of the vehicle around a time, as `Simulation.motion`; None: it stands still in each frame."""

    @classmethod
    def of(
        cls,
        scene: Scene,
        renderer,
        poses: Sequence[np.ndarray],
        time_ns: Sequence[int] | None = None,
        motion: Callable[[int], Motion] | None = None,
    ) -> "Frames":
        """Frames at these poses; without ``time_ns``, at the times of a scene's frames from its start."""
        if time_ns is None:
            time_ns = times_ns(len(poses), scene.render.frame_rate_hz).tolist()
        return cls(renderer, poses, time_ns, motion)

    def __len__(self) -> int:
        return len(self.poses)

    def motion_at(self, frame: int) -> Motion | None:
        """Motion of the vehicle around a frame."""
        return self.motion(int(self.time_ns[frame])) if self.motion else None

    def render(self, frame: int, camera: Camera, letters: str, /, **how: Any):
        """Images of one of them as a run makes them, blurred and with what moves where it is then."""
        return self.renderer.render(
            self.poses[frame], camera, letters, motion=self.motion_at(frame), time_ns=int(self.time_ns[frame]), **how
        )


@dataclass(frozen=True)
class View:
    """A view of the pilot: two images of A from one place."""

    frame: int
    camera: Camera
    """Camera with the resolution of the scene."""
    images: tuple[Any, Any]
    """`RadianceImage` of A, with independent random numbers."""

    @property
    def label(self) -> str:
        """Frame and camera in words."""
        return f"frame {self.frame}, camera {self.camera.id}"

    def noise(self, method: str, rare: float = RARE) -> np.ndarray:
        """Relative RMS [3] of the noise that a denoiser leaves.

        Views are compared by it, not by that before it: what is noisy in many pixels at once, a denoiser finds easy,
        and rare pixels it does not.

        Args:
            method: Of denoising.
            rare: Share of the pixels, those with most noise, that do not count.
        """
        one, two = (denoise_image(image, method).astype(np.float64) for image in self.images)
        square = np.sort(0.5 * (one - two).reshape(-1, 3) ** 2, axis=0)
        return relative(square[: max(1, int((1.0 - rare) * len(square)))].mean(0), np.array([one, two]))


def pilot_camera(camera: Camera, pixels: int = SMALL) -> Camera:
    """A camera with the same field of view and at most so many pixels."""
    scale = min(1.0, np.sqrt(pixels / np.prod(camera.resolution)))
    return resized(camera, *(max(1, round(scale * side)) for side in camera.resolution))


def pixels_tried(camera: Camera, frames: int) -> int:
    """Pixels of the test images of a sequence of so many frames."""
    return max(PIXELS, round(min(1.0, frames / WORTH) * np.prod(camera.resolution)))


def pilot_frames(count: int) -> list[int]:
    """A few of so many frames, evenly spread and with the first and the last."""
    return np.unique(np.linspace(0, count - 1, POSES).round().astype(int)).tolist()


def pilot_views(scene: Scene, frames: Frames, integrator: str) -> Iterator[View]:
    """A few frames through every camera."""
    for frame in pilot_frames(len(frames)):
        for camera in scene.vehicle.cameras:
            small = pilot_camera(camera)
            how = of_scene(scene) | {
                "spp": round(SMALL_SPP * SMALL / np.prod(small.resolution)),
                "frame": frame,
                "integrator": integrator,
            }
            images = tuple(
                frames.render(frame, small, WATER, seed=seed, snow=False, **how).A for seed in (None, SECOND_SEED)
            )
            yield View(frame, camera, images)


def distances_seen(frames: Frames, camera: Camera) -> np.ndarray:
    """Quantiles of the distances along the rays [m] that a camera sees in a few frames; empty if it sees nothing."""
    seen = [frames.render(frame, pilot_camera(camera), DEPTH).D.range for frame in pilot_frames(len(frames))]
    distance = np.concatenate(seen, axis=None)
    distance = distance[np.isfinite(distance)]
    return np.quantile(distance.astype(np.float64), DISTANCES) if distance.size else distance
