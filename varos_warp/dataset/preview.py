"""A scene while it is edited: a small image A that refines, and is made anew when the scene or a file of it is saved.

Only what a change touches is done again: the course where it depends on the change, geometry and textures likewise.
Lights, water and cameras cost nothing but the image. That is computed by paths alone, for the precomputed field would
have to be solved again for each new water or cone, which takes longer than the samples that it saves here.
"""

import itertools
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from varos_warp.dataset.progress import Console
from varos_warp.dataset.run.steps import simulated
from varos_warp.errors import InputError, require_known
from varos_warp.files import stamp_of
from varos_warp.products.images.radiance import RadianceImage, encode_color, to_half
from varos_warp.render.image import exposure
from varos_warp.render.image.denoise import denoise_image
from varos_warp.render.moments import Motion
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.image_types import AMBIENT, SNOW, WATER
from varos_warp.scene.description.optics import resized
from varos_warp.scene.description.patterns import HullFollowing
from varos_warp.scene.description.surfaces import Layered
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.file.load import load_scene
from varos_warp.scene.file.source import located
from varos_warp.scene.frames import pose_matrix
from varos_warp.scene.geometry.course import local_origin
from varos_warp.scene.optics.shutter import open_ns
from varos_warp.scene.spectra.matrix import color_matrix

MOST_SPP = 64
"""Samples per pixel at which an image is good enough, where the scene names none."""
STEP_SECONDS = 2.0
"""Samples are taken in steps of no more than about this: so long may a change have to wait."""
B_SPP = 4
"""Samples per pixel of B."""
POLL_SECONDS = 0.1
"""Time between two looks at the files [s]."""
KEPT_ORIGIN_M = 100.0
"""A course that moves farther has its geometry uploaded anew, around a nearer origin."""

NOT_SOLID = {
    "name",
    "sequence",
    "water",
    "particles",
    "surface_depth_m",
    "gravity",
    "current",
    "vehicle",
    "trajectory",
    "render",
    "vehicles",
    "observer",
}
"""Blocks that terrain, objects and materials do not depend on."""
NOT_MOVING: dict[str, Any] = dict.fromkeys(
    ("name", "sequence", "terrain", "objects", "scatter", "growth", "materials", "water", "particles"), True
)
NOT_MOVING["vehicle"] = {"lights", "cameras"}
"""Blocks that the course does not depend on."""


def _solid(scene: Scene) -> dict[str, Any]:
    """What terrain, objects and materials depend on."""
    solid = scene.model_dump(exclude=NOT_SOLID)
    if scene.growth or any(isinstance(material, Layered) for material in scene.materials.values()):
        # as fine as the course comes near, and none of what it does not come near to
        solid["max_triangles"], solid["current"] = scene.render.max_triangles, scene.current.velocity
        solid["seen"] = scene.model_dump(
            include={"surface_depth_m": True, "trajectory": True, "vehicles": True, "vehicle": {"cameras"}}
        )
        solid["segments"] = scene.render.segments
    if bodies := [vehicle.body.model_dump() for vehicle in scene.companions.values() if vehicle.body]:
        solid["bodies"] = bodies
    return solid | {"files": files_named(scene, solid)}


@dataclass(frozen=True)
class Viewpoint:
    """Moment, camera and image width of a preview."""

    frame: int = 0
    """Number of a frame of the sequence."""
    time_s: float | None = None
    """Any time of the course instead [s]."""
    camera: str | None = None
    """Id of a camera; absent: the first."""
    width: int = 320
    """Width of the image [pixels]; a camera with a smaller image keeps its own."""


class View(NamedTuple):
    """What is looked at: a scene with small cameras, uploaded, from a pose."""

    renderer: FrameRenderer
    camera: Camera
    T_w_v: np.ndarray
    course: np.ndarray
    """Positions of the vehicle [N, 3] [m]."""
    time_ns: int = 0
    """Time of the image [ns]."""
    motion: Motion | None = None
    """Motion of the vehicle around that time, where the camera has a shutter."""

    def render(self, letter: str, **options) -> Any:
        """An image of some type."""
        return getattr(
            self.renderer.render(self.T_w_v, self.camera, letter, motion=self.motion, time_ns=self.time_ns, **options),
            letter,
        )


def preview(
    path: Path,
    screen,
    viewpoint: Viewpoint = Viewpoint(),
    *,
    spp: int | None = None,
    device: str = "auto",
    overrides: Iterable[str | tuple[str, str]] = (),
    once: bool = False,
    quiet: bool = False,
) -> None:
    """Show a scene, and again whenever one of its files is saved, until the user interrupts it.

    A scene that cannot be loaded any more is told of, and the last image stays.

    Args:
        path: The scene file.
        screen: Where images are shown (screens.py).
        viewpoint: From where.
        spp: Most samples per pixel; absent: the scene's, or 64.
        device: ``auto``, ``cpu`` or ``cuda:N``.
        overrides: As of `load_scene`.
        once: Return when the image is as good as it gets.
        quiet: Nothing on stderr but what is wrong with the scene.

    Raises:
        InputError: If the scene cannot be shown when the preview begins, or an image cannot be written.
    """
    console = Console(quiet)
    edited, shown = _EditedScene(Path(path), viewpoint, device, tuple(overrides), console), False
    while True:
        try:
            view = edited.reload()
        except InputError as error:
            if once or not shown:
                raise
            Console().tell(f"varos-warp: {error.message}")
            screen.tell(error.message)
        else:
            screen.place(view)
            _refine(view, screen, spp or view.renderer.scene.render.spp or MOST_SPP, edited, console)
            shown = True
        if once:
            return
        edited.wait()


def _refine(view: View, screen, most: int, edited: "_EditedScene", console: Console) -> None:
    """Show better and better images until they are good enough, or the scene changes."""
    scene, stage = view.renderer.scene, ""
    snow = view.render(SNOW) if scene.particles else None
    for image in refined(lambda **how: view.render(WATER, integrator="path", snow=False, **how), most):
        shown = denoise_image(image, scene.render.denoise)
        pixels, gain = developed(
            WATER, shown if snow is None else np.maximum(snow.over(shown), 0.0), scene, view.camera
        )
        screen.show(WATER, pixels)
        seconds = time.monotonic() - edited.since
        count = f"{image.spp or 0:g} sample{'' if image.spp == 1 else 's'} per pixel"
        words = f"{count}, exposure gain {exposure.in_words(gain)}, after {seconds:.1f} s"
        if not stage:
            console.tell(f"camera {view.camera.id}, {pixels.shape[1]} x {pixels.shape[0]}: {words}")
            if AMBIENT in screen.outputs:
                without_water = view.render(AMBIENT, spp_b=B_SPP, denoise_b="oidn").denoised
                screen.show(AMBIENT, developed(AMBIENT, without_water, scene, view.camera)[0])
        stage = words
        if edited.changed():
            return
    console.tell(f"{stage}; complete")


def developed(letter: str, radiance: np.ndarray, scene: Scene, camera: Camera) -> tuple[np.ndarray, exposure.FrameGain]:
    """Pixels uint8 [H, W, 3] of an image, exposed as a sequence of this frame alone would be, and the gain."""
    half, _ = to_half(radiance)
    rule = exposure.rule_of(scene, camera.id, letter)
    gain = exposure.as_gain(rule.gains(letter, np.zeros(1), [rule.statistics(half)])[0].tolist())
    return encode_color(half, gain, color_matrix(scene, camera)), gain


def refined(render: Callable[..., RadianceImage], most: int) -> Iterator[RadianceImage]:
    """Images of 1, 2, 4 ... samples per pixel, up to ``most`` or one more; in smaller steps where they are slow.

    The first is not part of the others: one sample does not tell its own error, by which images are denoised. For the
    same reason no step is of one. ``render`` makes an image of ``spp`` samples with the random numbers of a ``frame``.
    """
    mean = render(spp=1, frame=0)
    yield mean
    if mean.spp is None or most <= 1:  # known without samples, or good enough
        return
    taken, step = 0, 2
    for number in itertools.count(1):
        start = time.monotonic()
        image = render(spp=step, frame=number)
        mean, taken = added(mean, image) if taken else image, taken + step
        yield mean
        if taken >= most:
            return
        affordable = int(step * STEP_SECONDS / max(time.monotonic() - start, 1e-3))
        step = max(2, min(taken, affordable, most - taken))


def added(mean: RadianceImage, image: RadianceImage) -> RadianceImage:
    """The mean of all samples of two independent images of one view, without layers and errors of blocks."""
    total = mean.spp + image.spp
    shares = np.float32(mean.spp / total), np.float32(image.spp / total)

    def blended(name: str, power: int = 1) -> np.ndarray:
        return sum(share**power * getattr(part, name) for share, part in zip(shares, (mean, image), strict=True))

    variance = sum((share * part.stderr) ** 2 for share, part in zip(shares, (mean, image), strict=True))
    return replace(
        mean,
        radiance=blended("radiance"),
        stderr=np.sqrt(variance),
        correction=blended("correction"),
        base_variance=blended("base_variance", 2),
        spp=total,
        subpaths=mean.subpaths + image.subpaths,
        layers={},
        block_error=None,
    )


class _EditedScene:
    """A scene file at work, and what was made of it so far."""

    def __init__(
        self,
        path: Path,
        viewpoint: Viewpoint,
        device: str,
        overrides: tuple[str | tuple[str, str], ...],
        console: Console,
    ):
        self.path, self.viewpoint, self.device, self.overrides = path, viewpoint, device, overrides
        self.console = console
        self.since = time.monotonic()
        """Time at which the last change was noticed [s]."""
        self._stamps: dict[Path, tuple | None] = {}
        self._simulation: Any = None
        self._moving: Any = None
        self._renderer: FrameRenderer | None = None
        self._solid: Any = None

    def reload(self) -> View:
        """Load the scene and do again what depends on its changes, or raise what is wrong with it."""
        # before it is read: what is saved meanwhile is a change, also of a file for which it cannot be loaded
        self._stamps = {path: stamp_of(path) for path in (*self._stamps, self.path)}
        scene = load_scene(self.path, self.overrides)
        others = files_named(scene, [scene.model_dump(), scene.calibrations])
        self._stamps = {self.path: self._stamps[self.path]} | others
        with located(scene):
            return self._view(scene)

    def _view(self, scene: Scene) -> View:
        cameras = [smaller(camera, self.viewpoint.width) for camera in scene.vehicle.cameras]
        scene = scene.model_copy(update={"vehicle": scene.vehicle.model_copy(update={"cameras": cameras})})
        camera = _camera(cameras, self.viewpoint.camera)
        simulation = self._simulated(scene)
        time_ns, T_w_v = _pose(self.viewpoint, simulation, open_ns(cameras))
        motion = simulation.motion(time_ns) if not camera.exposure.is_instant else None
        return View(self._uploaded(scene), camera, T_w_v, simulation.trajectory.position, time_ns, motion)

    def _simulated(self, scene: Scene):
        moving = scene.model_dump(exclude=NOT_MOVING) | {"open_ns": open_ns(scene.vehicle.cameras)}
        if isinstance(scene.trajectory.pattern, HullFollowing):
            moving["followed"] = _solid(scene)
        if recorded := [course.file for course in scene.trajectories.values() if course.file]:
            # which may have the poses of a camera
            moving["recorded"] = files_named(scene, recorded), [pose_matrix(c).tolist() for c in scene.vehicle.cameras]
        if moving != self._moving:
            self._simulation = simulated(scene, self.console.quiet, [])  # what a DVL reads is not looked at
            self._moving = moving
        return self._simulation

    def _uploaded(self, scene: Scene) -> FrameRenderer:
        solid = _solid(scene)
        old = self._renderer
        if (
            old is None
            or solid != self._solid
            or np.abs(local_origin(scene, old.parts) - old.world.origin).max() > KEPT_ORIGIN_M
        ):
            self.console.tell("loading terrain, objects and textures ...")
            self._renderer = FrameRenderer(scene, self.device)
            self._solid = solid
        else:
            self._renderer = old.relit(scene)
        return self._renderer

    def changed(self) -> bool:
        """Return whether a file is not as it was when it was read."""
        return self._now() != self._stamps

    def wait(self) -> None:
        """Return once a file has changed, and is no longer being written."""
        while not self.changed():
            time.sleep(POLL_SECONDS)
        self.since = time.monotonic()
        before, now = None, self._now()
        while before != now:
            time.sleep(POLL_SECONDS)
            before, now = now, self._now()

    def _now(self) -> dict[Path, tuple | None]:
        return {path: stamp_of(path) for path in self._stamps}


def files_named(scene: Scene, content: Any) -> dict[Path, tuple | None]:
    """Stamps of the files that the texts in some content of a scene may name; None for what is no file, or not yet."""
    if isinstance(content, str):
        path = scene.resolve(content)
        return {path: stamp_of(path)}
    parts = content.values() if isinstance(content, dict) else content if isinstance(content, list | tuple) else ()
    return {path: stamp for part in parts for path, stamp in files_named(scene, part).items()}


def smaller(camera: Camera, width: int) -> Camera:
    """A camera with the same field of view, at most so many pixels wide."""
    scale = min(1.0, width / camera.resolution[0])
    return resized(camera, *(max(1, round(scale * side)) for side in camera.resolution))


def _camera(cameras: list[Camera], wanted: str | None) -> Camera:
    known = {camera.id: camera for camera in cameras}
    if wanted is None:
        return cameras[0]
    require_known(wanted, known, "no such camera", key="--camera")
    return known[wanted]


def _pose(viewpoint: Viewpoint, simulation, stays_open_ns: int) -> tuple[int, np.ndarray]:
    """Time [ns] and pose [4, 4] of the vehicle from which to look; shutters stay open for ``stays_open_ns`` then."""
    frame, time_s, trajectory = viewpoint.frame, viewpoint.time_s, simulation.trajectory
    if time_s is not None:
        end_ns = int(trajectory.time_ns[-1]) - stays_open_ns
        if not 0.0 <= time_s <= 1e-9 * end_ns:
            raise InputError(
                "is not on the course", key="--time", value=time_s, remedy=f"It lasts {1e-9 * end_ns:g} s."
            )
        time_ns = min(round(1e9 * time_s), end_ns)
        return time_ns, trajectory.at([time_ns]).T_w_v(0)
    if not 0 <= frame < len(simulation.frames):
        raise InputError(
            "there is no such frame",
            key="--frame",
            value=frame,
            remedy=f"The sequence has frames 0 to {len(simulation.frames) - 1}.",
        )
    return int(simulation.frames.time_ns[frame]), simulation.frames.T_w_v(frame)
