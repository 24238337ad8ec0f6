"""One frame from one pose of the vehicle: the images of the registry, by what each is made from."""

import copy
import functools
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from varos_warp.device.compile import compiling
from varos_warp.device.devices import resolve_device
from varos_warp.device.launcher import Launcher
from varos_warp.errors import InputError
from varos_warp.kernels.transport.first_hits import Rows
from varos_warp.kernels.transport.moments import Moments
from varos_warp.products.images.depth import DepthImage
from varos_warp.products.images.flow import FlowImage
from varos_warp.products.images.normals import NormalImage
from varos_warp.products.images.protocol import FirstHits, Source
from varos_warp.products.images.radiance import RadianceImage
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.products.images.segments import SegmentImage, segment_table
from varos_warp.render.image.films import Films
from varos_warp.render.image.flow import MovingPart, flow_by_rows, flow_of
from varos_warp.render.image.frame import Frame
from varos_warp.render.kinds import hit_kernels, kernels_needed, purity_kernel
from varos_warp.render.moments import Motion, NextFrame, checked_motion, moments_of, poses_of_rows, times_seen
from varos_warp.render.options import INTEGRATORS, LAYERS, RenderOptions, check_names, options_of, resolve_integrator
from varos_warp.render.particles.snow import SnowRenderer
from varos_warp.render.radiance import RadianceRenderer, Shot
from varos_warp.render.spectral import SpectralRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.image_types import FLOW, WATER
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.device import DeviceScene, camera_records
from varos_warp.scene.frames import camera_pose, checked_pose, inverse, numeric
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.optics.camera import Rays, camera_model, channel_number, pixel_centres
from varos_warp.scene.optics.shutter import in_ns, is_rolling, row_offsets_s
from varos_warp.sim.companions import companions
from varos_warp.sim.poses import poses_of_moving

__all__ = [
    "INTEGRATORS",
    "LAYERS",
    "DepthImage",
    "FlowImage",
    "Frame",
    "FrameRenderer",
    "NextFrame",
    "NormalImage",
    "RadianceImage",
    "Rays",
    "SegmentImage",
    "resolve_integrator",
    "stream_key",
]


def stream_key(seed: int, frame: int, camera: str, output: str) -> int:
    """32-bit key of the random numbers of one image; pixel and sample are added in the kernel."""
    return int(np.random.SeedSequence([seed, frame, *camera.encode(), *output.encode()]).generate_state(1)[0])


@functools.lru_cache(maxsize=4)
def _centre_rays(view: Camera) -> Rays:
    """Rays of the pixels' centres in camera axes, kept from frame to frame: a second at 1280 x 720 with distortion."""
    return camera_model(view).rays(pixel_centres(*view.resolution))


def _points(points: ArrayLike, size: int) -> np.ndarray:
    """Points [..., size] that a caller gives, as float64."""
    array = numeric("points", points, f"Give an array [..., {size}].")
    if not array.ndim or array.shape[-1] != size:
        raise InputError(
            f"has the shape {array.shape}, not [..., {size}]",
            key="points",
            remedy="Image points have two numbers, points of the world three.",
        )
    return array


class Exposed(NamedTuple):
    """A camera, and the vehicle and objects while its shutter is open."""

    view: Camera
    T_w_v: np.ndarray
    motion: Motion | None
    world: DeviceScene
    """The scene, with what moves where it is at the frame's time."""
    time_ns: int
    """Time of the frame [ns]."""

    @property
    def rolls(self) -> bool:
        """True if rows are of different instants."""
        return self.motion is not None and is_rolling(self.view)

    def poses_of_rows(self) -> np.ndarray:
        """Pose [H, 4, 4] of the vehicle in the middle of the exposure of each row."""
        return poses_of_rows(self.view, self.T_w_v, self.motion)

    def cameras_of_rows(self) -> np.ndarray:
        """Camera pose for each row, [H, 4, 4]."""
        return camera_pose(self.view, self.poses_of_rows())

    def row_times(self) -> np.ndarray:
        """Middles of the exposures of the rows from the frame's time, int64 [H] [ns]; of one instant, [1]."""
        return in_ns(row_offsets_s(self.view)) if self.rolls else np.zeros(1, np.int64)


class FrameRenderer:
    """Renders frames of one scene on one device; uploads and compiles once.

    Args:
        scene: The scene.
        device: ``auto``, ``cpu`` or ``cuda:N``.
        parts: Its geometry, where it is built already.
        threads: CPU threads; absent: all that the process may use. Does not change a byte of the result.
    """

    def __init__(
        self,
        scene: Scene,
        device: str = "auto",
        parts: list[Part | Instances] | None = None,
        threads: int | None = None,
    ):
        self.scene = scene
        self.device = resolve_device(device)
        self.device_name = wp.get_device(self.device).name
        self.parts = build_parts(scene) if parts is None else parts
        self.world = DeviceScene(scene, self.parts, self.device)
        self.companions = companions(scene)
        self.segments = segment_table(scene, self.world.part_names)
        """What the numbers of S stand for: a row for each."""
        self._material_ids = np.array([0, *(row["material_id"] for row in self.segments)], np.int32)
        self.launcher = Launcher(self.device, threads)
        self.films = Films(self.launcher)
        self._see()

    def _see(self) -> None:
        """Make ready what renders the water of the scene."""
        renders = SpectralRenderer if self.scene.is_spectral else RadianceRenderer
        self.radiance = renders(self.scene, self.world, self.films)
        self.snow = SnowRenderer(self.world.scene, self.launcher, self.radiance.open_water)

    def relit(self, scene: Scene) -> "FrameRenderer":
        """A renderer of a scene that differs in water, lights, cameras or course only: nothing is built anew for it.

        Not for use at the same time as this one: both render into the same films.
        """
        other = copy.copy(self)
        other.scene, other.world, other.companions = scene, self.world.relit(scene), companions(scene)
        other._see()
        return other

    @property
    def compile_seconds(self) -> float:
        """Time spent so far on compiling kernels."""
        return self.launcher.compile_seconds

    @property
    def field_failure(self) -> str | None:
        """Why the field of open water, which the scene may have, cannot be solved for; None if it can. Takes its time.

        Only for scenes for which nothing is `unavailable` (render/field/open_water.py).
        """
        return self.radiance.open_water.failure

    def compiling(self, outputs: Iterable[str], integrator: str | None = None) -> AbstractContextManager[None]:
        """A ``with`` statement during which threads compile what images of the scene's cameras will need.

        Args:
            outputs: Letters of the images.
            integrator: Of A and P; absent: the scene's.
        """
        kernels = kernels_needed(
            self.world.scene, replace(self.world.spec, bands=self.scene.is_spectral), outputs, integrator
        )
        return compiling(kernels, self.device)

    def render(
        self,
        T_w_v: ArrayLike,
        camera: str | Camera | None = None,
        outputs: Iterable[str] = "ABCD",
        *,
        following: NextFrame | None = None,
        motion: Motion | None = None,
        time_ns: int = 0,
        seed: int | None = None,
        frame: int = 0,
        **options: Any,
    ) -> Frame:
        """Render the ``outputs`` of one camera for the vehicle at ``T_w_v`` [4, 4].

        Several threads may render: one uses the device while others wait for what it computes.

        Args:
            T_w_v: Pose of the vehicle in the world.
            camera: Id of a camera of the scene, or a camera that is not in it; absent: the first.
            outputs: Letters of image types.
            following: The next frame, to which F is the flow.
            motion: Of the vehicle around this frame, for cameras with a shutter (`Simulation.motion`); absent: it
                stands still, as do objects, and nothing is blurred.
            time_ns: Time of the frame [ns], for objects that move.
            seed: Of the random numbers; absent: the scene's.
            frame: Number of the frame; the random numbers follow from it too.
            options: Fields of `RenderOptions` (render/options.py): spp, integrator, denoise ...

        Raises:
            InputError: If something unknown is asked for, or F without ``following``, or a pose is none.
            TypeError: If there is no such option.
        """
        check_names("outputs", outputs, OUTPUTS)
        if FLOW in outputs and following is None:
            raise InputError(
                "F, the flow to the next frame, needs the vehicle's pose there",
                key="following",
                remedy="Give it, or leave F out of the outputs.",
            )
        how = options_of(self.scene, options)
        view, T_w_v = self._camera(camera), checked_pose("T_w_v", T_w_v)
        motion = checked_motion("motion", motion)
        if following is not None:
            following = following._replace(
                T_w_v=checked_pose("following.T_w_v", following.T_w_v),
                motion=checked_motion("following.motion", following.motion),
            )
        seed = self.scene.seed if seed is None else seed
        with self.launcher.turn:
            return self._rendered(
                self._exposed(view, T_w_v, motion, time_ns),
                outputs,
                how,
                following,
                lambda letter: stream_key(seed, frame, view.id, OUTPUTS[letter].settings),
            )

    def _rendered(
        self,
        here: Exposed,
        outputs: Iterable[str],
        how: RenderOptions,
        following: NextFrame | None,
        key_of: Callable[[str], int],
    ) -> Frame:
        """Render the ``outputs``, each with the random numbers of its key, by the thread whose turn it is."""
        view, T_w_v, motion = here.view, here.T_w_v, here.motion
        there = self._following(following, here) if following is not None else None
        # what is taken out of A for the bodies is light scattered once
        shows_bodies = how.snow and self.scene.particles and "single" in (how.layers or ()) and how.max_scatterings != 0
        whole = how.copied is None or any(OUTPUTS[letter].source is Source.PARTICLES for letter in outputs)
        bodies = functools.cache(
            lambda seen, moved, key: self.snow.render(
                here._replace(view=seen, motion=moved), key, self.radiance.share(seen), there, whole
            )
        )
        guides = functools.cache(lambda *seen: self.radiance.trace_guides(here.world, seen[0], T_w_v, *seen[1:]))
        # else all of an exposure is lit
        flashes = motion is not None and all(light.strobe for light in self.scene.lights)
        make = {Source.WATER: self.radiance.water, Source.AMBIENT: self.radiance.ambient}
        asked = {letter: image for letter, image in OUTPUTS.items() if letter in outputs}
        images: dict[str, Any] = {}
        for letter, product in asked.items():
            if product.source is Source.PARTICLES:
                images[letter] = bodies(view, motion, key_of(letter)).on_host
            if product.source not in make:
                continue
            seen, moved = product.seen_by(self.scene, view), motion if product.blurs else None
            if product.like in images and seen == view and (motion is None or view.exposure.is_instant):
                images[letter] = images[product.like]
            else:
                shown = functools.partial(guides, seen, moved, flashes and letter == WATER)
                drawn = functools.partial(bodies, seen, moved, key_of(letter)) if shows_bodies else None
                images[letter] = make[product.source](
                    Shot(seen, T_w_v, how, key_of(letter), shown, here.world, moved, drawn)
                )
        planes = {plane for image in asked.values() for plane in image.planes}
        planes |= {"instance"} if FLOW in asked and self.world.moving else set()
        if planes:
            keys = [key_of(letter) for letter, image in asked.items() if image.rays]
            hits = self._render_first_hits(here, planes, *keys)
            images |= {
                letter: image.of_hits(hits) for letter, image in asked.items() if image.source is Source.FIRST_HITS
            }
        if FLOW in asked and there is not None:
            images[FLOW] = self._render_flow(here, there, hits)
        return Frame(**images)

    def _following(self, following: NextFrame, here: Exposed) -> Exposed:
        """The camera at the next frame."""
        return self._exposed(
            self._camera(following.camera) if following.camera else here.view,
            np.asarray(following.T_w_v),
            following.motion,
            here.time_ns if following.time_ns is None else following.time_ns,
        )

    def rays(
        self,
        T_w_v: ArrayLike,
        camera: str | Camera | None = None,
        points: ArrayLike | None = None,
        channel: str = "green",
    ) -> Rays:
        """Rays in the water, world axes, float64: ``origin``, ``direction`` [..., 3] and ``weight`` [...].

        Args:
            T_w_v: Pose of the vehicle in the world.
            camera: As for `render`.
            points: Image points [..., 2] [pixels], the centre of the top left pixel at (0.5, 0.5); absent: the centres
                of all pixels [H, W, 2], whose rays C, D and S follow.
            channel: red, green or blue, whose rays differ where the water's index does.

        Returns:
            Origins lie on the outer surface of the port, or at the lens. The weight is the radiance at the sensor over
            that in the water. Where a camera sees no water: NaN, and weight 0.

        Raises:
            InputError: If there is no such camera or channel, or the pose or the points are none.
        """
        view, number = self._camera(camera), channel_number(channel)
        image = pixel_centres(*view.resolution) if points is None else _points(points, 2)
        return camera_model(view).rays(image, number).moved(camera_pose(view, checked_pose("T_w_v", T_w_v)))

    def project(
        self, points: ArrayLike, T_w_v: ArrayLike, camera: str | Camera | None = None, channel: str = "green"
    ) -> np.ndarray:
        """Image points [..., 2] [pixels] of points [..., 3] of the world; NaN where the camera cannot see them.

        What lies between is not looked at, and image points may lie outside of the image. Arguments as for `rays`.

        Raises:
            InputError: If there is no such camera or channel, or the pose or the points are none.
        """
        view, number = self._camera(camera), channel_number(channel)
        T_w_c = camera_pose(view, checked_pose("T_w_v", T_w_v))
        return camera_model(view).project((_points(points, 3) - T_w_c[:3, 3]) @ T_w_c[:3, :3], number)

    def _camera(self, name: str | Camera | None) -> Camera:
        if name is None or isinstance(name, Camera):
            return name or self.scene.vehicle.cameras[0]
        cameras = {camera.id: camera for camera in self.scene.vehicle.cameras}
        if name not in cameras:
            raise InputError("no such camera", key="camera", value=name, remedy=f"There are: {', '.join(cameras)}.")
        return cameras[name]

    def _exposed(self, view: Camera, T_w_v: np.ndarray, motion: Motion | None, time_ns: int) -> Exposed:
        """A camera, the vehicle and what moves at a time."""

        def poses(offset_ns: np.ndarray) -> dict[str, np.ndarray]:
            return poses_of_moving(self.world.moving, time_ns + offset_ns, self.companions)

        world = self.world.moved(poses, times_seen(view, self.scene.lights, motion))
        return Exposed(view, T_w_v, motion, world, time_ns)

    def _rows(self, here: Exposed) -> Rows:
        """What the rows of a rolling shutter are of."""
        rows = Rows()
        if here.rolls:
            rows.cameras = camera_records(here.view, here.poses_of_rows(), self.world.origin, self.device, pinhole=True)
            rows.moving = here.world.moving_at(here.row_times())
        return rows

    def _render_first_hits(self, here: Exposed, planes: Iterable[str], key: int = 0) -> FirstHits:
        """First hits with these planes; ``key`` is that of the random numbers of rays over a pixel."""
        view = here.view
        shape = view.resolution[::-1]
        normal = wp.zeros(shape, dtype=wp.vec3, device=self.device)
        depth, distance = (wp.full(shape, wp.inf, dtype=float, device=self.device) for _ in range(2))
        instance = wp.zeros(shape, dtype=wp.int32, device=self.device)
        if kernels := hit_kernels(self.world.spec, view, here.rolls):
            camera = self.world.camera(view, here.T_w_v, pinhole=True)
            self.launcher.rows(
                kernels.first_hits,
                shape,
                {
                    "scene": here.world.data,
                    "camera": camera,
                    "of_rows": self._rows(here),
                    "normal": normal,
                    "depth": depth,
                    "distance": distance,
                    "instance": instance,
                },
            )
        arrays = {"normal": normal, "depth": depth, "distance": distance, "instance": instance}
        if "purity" in planes:
            arrays["purity"] = self._trace_purity(here, key)
        wanted = {name: array for name, array in arrays.items() if name in planes}
        on_host = self.launcher.fetch(*wanted.values())
        found = dict(zip(wanted, on_host, strict=True))
        if "instance" in found and len(self.world.segment_of) > len(self._material_ids):  # else all have their own
            found["instance"] = self.world.segment_of[found["instance"]]
        return FirstHits(found, self.radiance.lets_through(view), self._material_ids)

    def _trace_purity(self, here: Exposed, key: int) -> wp.array:
        """Share float32 [H, W] of each pixel, as A is made, that shows what its centre shows."""
        view, world = here.view, here.world
        purity = wp.ones(view.resolution[::-1], dtype=float, device=self.device)
        moves, moments = here.motion is not None and not view.exposure.is_instant, Moments()
        if kernel := purity_kernel(world.spec, view, moves, here.rolls):
            if moves:
                moments = moments_of(world, view, here.T_w_v, here.motion, pinhole=False)
            self.launcher.rows(
                kernel,
                purity.shape,
                {
                    "scene": world.data,
                    "camera": world.camera(view, here.T_w_v),
                    "pinhole": world.camera(view, here.T_w_v, pinhole=True),
                    "of_rows": self._rows(here),
                    "moments": moments,
                    "key": wp.uint32(key),
                    "purity": purity,
                    "numbers": wp.array(world.segment_of, dtype=wp.int32, device=self.device),
                },
            )
        return purity

    def _render_flow(self, here: Exposed, following: Exposed, hits: FirstHits) -> FlowImage:
        """F from distances and objects: in float64 on the host, and what hides on the device."""
        view, distance = here.view, hits.planes["distance"]
        before = camera_model(following.view), pixel_centres(*view.resolution), _centre_rays(view), distance
        if here.rolls or following.rolls or self.world.moving:
            T_w_c, T_w_next = (at.cameras_of_rows() for at in (here, following))
            moved = flow_by_rows(*before, T_w_c, T_w_next, self._moving_parts(here, following, hits))
            eye = moved.eye
        else:
            T_w_next = camera_pose(following.view, following.T_w_v)
            moved = flow_of(*before, inverse(T_w_next) @ camera_pose(view, here.T_w_v))
            eye = (moved.eye.reshape(-1, 3) @ T_w_next[:3, :3].T).reshape(moved.eye.shape) + T_w_next[:3, 3]
        hidden = wp.zeros(distance.shape, dtype=wp.uint8, device=self.device)
        if kernels := hit_kernels(self.world.spec, view, here.rolls):
            eyes = wp.empty(distance.shape, dtype=wp.vec3, device=self.device)
            self.launcher.upload(eye - self.world.origin, eyes)
            next_row = wp.zeros(distance.shape, dtype=wp.int32, device=self.device)
            if following.rolls and self.world.moving:
                row = np.nan_to_num(before[1][..., 1] + moved.flow[..., 1])
                self.launcher.upload(np.clip(row, 0, following.view.resolution[1] - 1).astype(np.int32), next_row)
            camera = self.world.camera(view, here.T_w_v, pinhole=True)
            self.launcher.rows(
                kernels.hidden,
                distance.shape,
                {
                    "scene": here.world.data,
                    "camera": camera,
                    "of_rows": self._rows(here),
                    "next_scene": following.world.data,
                    "next_moving": following.world.moving_at(following.row_times()),
                    "eyes": eyes,
                    "next_row": next_row,
                    "hidden": hidden,
                },
            )
        (on_host,) = self.launcher.fetch(hidden)
        return FlowImage(moved.flow.astype(np.float32), on_host.astype(bool), moved.motion.astype(np.float32))

    def _moving_parts(self, here: Exposed, following: Exposed, hits: FirstHits) -> list[MovingPart]:
        """Objects that move: where each is seen, and its poses at both frames, for each row where rows differ."""
        if not self.world.moving:
            return []
        now, then = (at.world.poses_at(at.row_times()) for at in (here, following))
        numbers = [self.world.part_names.index(part.name) + 1 for part in self.world.moving]
        seen = hits.planes["instance"]
        return [MovingPart(seen == number, now[:, k], then[:, k]) for k, number in enumerate(numbers)]
