"""The layer ``snow``: the drawn bodies of a frame, less what they add in the mean.

A_out = (A - E) M + S: S are the bodies, E is their expectation, and M is what bodies let pass, over its mean. The mean
over all seeds is A, whatever integrator made it (Campbell's theorem: E[S] = E, E[M] = 1).
"""

import functools
from dataclasses import replace

import numpy as np
import warp as wp

from varos_warp.device.launcher import Launcher
from varos_warp.kernels.field.along_camera import AlongCamera
from varos_warp.kernels.field.open_water import Field
from varos_warp.kernels.particles.bodies import FADE, NEAREST
from varos_warp.kernels.particles.bodies import Particles as ParticleData
from varos_warp.kernels.particles.expected import compare_expected, tabulate_expected
from varos_warp.kernels.particles.field_light import sum_along_rays
from varos_warp.kernels.particles.gather import gather_splats, take_mean
from varos_warp.kernels.particles.over import lay_over
from varos_warp.kernels.particles.sighting import Exposure
from varos_warp.kernels.transport.moments import Moments
from varos_warp.kernels.world.camera import Camera as CameraData
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.products.images.snow import Snow
from varos_warp.render.field.along_camera import Kernels, Nodes, checked, seen_at_rest
from varos_warp.render.field.open_water import OpenWater
from varos_warp.render.kinds import ParticleKernels, lamps_tabled, lit_by_field, particle_kernels
from varos_warp.render.particles.cells import (
    TURN_RATE,
    WANDER_PERIOD_S,
    check_cells,
    grains_on,
    particle_record,
    wander_of,
)
from varos_warp.render.particles.exposure import Open, View, open_shutter
from varos_warp.render.particles.splats import Seen, seen_cells, splats_by_tiles
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.device import camera_record, optics_spec
from varos_warp.scene.geometry.lazily import once
from varos_warp.scene.optics.camera import camera_model
from varos_warp.scene.water.particles import ParticleLaw, particle_laws
from varos_warp.sim.vehicle.current import Current

RAYS, RAYS_BY_CHANNEL = 2, 6
"""Rays of a pixel along which E is taken, and which tell what hides a body; where each channel has its own, more."""
FIELD_NODES = 48, 25, 41
"""Nodes of a table of the field's light by distance, row and column."""
LAMP_NODES = 25, 23, 41
"""Nodes of a table of the lamps' light, to a factor of e of the distance, and by row and column."""
OF_LAMPS = Kernels(tabulate_expected, compare_expected, True)


class Drawn:
    """The bodies that a camera sees, on the device.

    Args:
        launcher: Of the device.
        images: By the names of `Snow`.
    """

    def __init__(self, launcher: Launcher, images: dict[str, wp.array]):
        self.launcher, self.images = launcher, images

    def over(self, image: wp.array) -> wp.array:
        """An image [H, W] of vec3 of the water with the bodies: `Snow.over`, to the byte."""
        shown = wp.empty_like(image)
        bodies = {name: self.images[name] for name in ("passed", "added")}
        self.launcher.run(lay_over, image.shape, {"image": image, **bodies, "shown": shown})
        return shown

    @once  # its lock is this object's: frames side by side give the device away while they wait for what they fetch
    def on_host(self) -> Snow:
        """Images of the bodies, fetched from the device."""
        return Snow(**dict(zip(self.images, self.launcher.fetch(*self.images.values()), strict=True)))


class SnowRenderer:
    """Renders the layer ``snow`` of one scene on one device."""

    def __init__(self, scene: Scene, launcher: Launcher, open_water: OpenWater):
        self.scene, self.launcher, self.device, self.open_water = scene, launcher, launcher.device, open_water
        self.laws = particle_laws(scene)
        check_cells(self.laws, scene.vehicle.cameras)
        self.current = Current(scene.current, scene.seed)
        self._records = functools.lru_cache(maxsize=8)(self._particles)
        self._field_tables: dict[Camera, wp.array] = {}
        self._lamp_tables: dict[Camera, tuple[list[AlongCamera], wp.array]] = {}

    def render(
        self, here: View, key: int, share: wp.array | None = None, following: View | None = None, whole: bool = True
    ) -> Drawn:
        """The bodies that a camera sees. The host waits for how many they are.

        Args:
            here: The camera.
            key: Of the random numbers of rays; those of the bodies follow from the scene.
            share: Of the light that reaches each pixel, float64 [H, W]; None: all.
            following: The camera at the next frame, to which the flow is; None: there is none.
            whole: Whether more is asked for than what image A needs.
        """
        shape = here.view.resolution[::-1]
        particles = [
            self._moved(record, law, here.time_ns)
            for record, law in zip(self._records(here.view), self.laws, strict=True)
        ]
        shutter = open_shutter(here, self._current(here.time_ns))
        images = {
            name: wp.zeros(shape, dtype=kind, device=self.device)
            for name, kind in (("light", wp.vec3), ("passed", float), ("coverage", float), ("flow", wp.vec2))
        }
        added = wp.empty(shape, dtype=wp.vec3, device=self.device)
        expected, hits = self._expect(here, shutter, particles, key, images["passed"])
        splats = self._splats(here, shutter, particles, following)
        if splats is not None:
            self.launcher.rows(
                gather_splats, shape, {**splats, "grains": grains_on(self.device), "hits": hits, **images}
            )
        self.launcher.run(
            take_mean,
            shape,
            {
                "share": wp.empty((0, 0), dtype=wp.float64, device=self.device) if share is None else share,
                "expected": expected,
                "passed": images["passed"],
                "light": images["light"],
                "added": added,
            },
        )
        wanted = {"added": added, "passed": images["passed"]}
        wanted |= {name: images[name] for name in ("coverage", "light") if whole}
        wanted |= {"flow": images["flow"]} if whole and following is not None else {}
        return Drawn(self.launcher, wanted)

    # ---------------------------------------------------------------------------------------------------- what moves

    def _particles(self, view: Camera) -> list[ParticleData]:
        return [particle_record(law, camera_model(view).pixel_angle, self.device) for law in self.laws]

    def _moved(self, record: ParticleData, law: ParticleLaw, time_ns: int) -> ParticleData:
        """The bodies of a block at a time."""
        moved, t = ParticleData(), 1e-9 * time_ns
        moved.assign(record)
        rate = 2.0 * np.pi / WANDER_PERIOD_S
        moved.drift = wp.vec3(*law.block.drift_m_s)
        moved.wander, moved.wander_rate = wander_of(law), rate
        moved.wander_phase, moved.turn = (float(np.fmod(r * t, 2.0 * np.pi)) for r in (rate, TURN_RATE))
        return moved

    def _current(self, time_ns: int) -> np.ndarray:
        """Velocity of the water at a time, float64 [3] [m/s]."""
        return self.current.velocity(np.array([1e-9 * time_ns]))[0]

    def _way(self, law: ParticleLaw, time_ns: int) -> np.ndarray:
        """How far the bodies of a block have drifted since time 0, float64 [3] [m]."""
        t = 1e-9 * time_ns
        return self.current.way(t) + t * np.asarray(law.block.drift_m_s, float)

    # --------------------------------------------------------------------------------------------- what is launched

    @once
    def _has_field(self) -> bool:
        """True if the field of open water shines on bodies."""
        return lit_by_field(self.scene) and not self.open_water.failure

    def _kernels(self, here: View, tabled: bool = False) -> ParticleKernels:
        moves, scene = here.motion is not None, self.scene
        return particle_kernels(scene, here.world.spec, here.view, moves, self._has_field, tabled)

    def _of_lamps(self, here: View, particles: list[ParticleData]) -> wp.array:
        """What bodies scatter of the lamps' light in the mean along a camera's rays, a table of each kind.

        Empty where there cannot be tables, or one of them would not be right.
        """
        if here.view not in self._lamp_tables:
            known = particles if lamps_tabled(self.scene, here.view) else []
            tables = [lamp_table(self.launcher, here, kind) for kind in known]
            if not all(table.radiance.shape[0] for table in tables):
                tables = []
            # kept, for the array holds no reference to those of its tables
            self._lamp_tables[here.view] = tables, wp.array(tables, dtype=AlongCamera, device=self.device)
        return self._lamp_tables[here.view][1]

    def _of_field(self, here: View, shutter: Open, particles: list[ParticleData]) -> wp.array:
        """What bodies scatter of the field in the mean, [kind, distance, row, column]; without a field, nothing.

        Where the camera and all lamps ride on the vehicle, it is the same in all frames.
        """
        rides = here.view.mount != "world" and len(self.scene.lights) == len(self.scene.vehicle.lights)
        if rides and here.view in self._field_tables:
            return self._field_tables[here.view]
        tables = wp.zeros((len(particles), *FIELD_NODES), dtype=wp.vec3, device=self.device)
        if kernel := self._kernels(here).field_light:
            scene, T_w_v, origin = SceneData(), np.eye(4) if rides else here.T_w_v, here.world.origin * (not rides)
            scene.assign(here.world.data)
            lights = shutter.lights
            scene.lights = here.world.lights.at(T_w_v, origin) if rides else lights[lights.shape[0] // 2]
            known = {
                "scene": scene,
                "camera": camera_record(here.view, T_w_v, origin, pinhole=True),
                "field": self.open_water.around_lights,
                "size": wp.vec2(*map(float, here.view.resolution)),
            }
            for i, kind in enumerate(particles):
                self.launcher.rows(kernel, FIELD_NODES, known | {"particles": kind, "table": tables[i]}, tile_rows=4)
                self.launcher.run(sum_along_rays, FIELD_NODES[1:], {"table": tables[i]})
        if rides:
            self._field_tables[here.view] = tables
        return tables

    def _expect(
        self, here: View, shutter: Open, particles: list[ParticleData], key: int, passed: wp.array
    ) -> tuple[wp.array, wp.array]:
        """What the bodies add in the mean, and where the rays of the pixels end; fills what lets through."""
        view, world = here.view, here.world
        shape, spec = view.resolution[::-1], optics_spec(view)
        hits = wp.empty((RAYS_BY_CHANNEL if spec.dispersion else RAYS, *shape), dtype=float, device=self.device)
        expected = wp.empty(shape, dtype=wp.vec3, device=self.device)
        scene = SceneData()
        scene.assign(world.data)
        scene.lights = shutter.lights[0]
        of_lamps = self._of_lamps(here, particles)
        self.launcher.rows(
            self._kernels(here, of_lamps.shape[0] > 0).expected,
            shape,
            {
                "of_field": self._of_field(here, shutter, particles),
                "of_lamps": of_lamps,
                "scene": scene,
                "camera": world.camera(view, here.T_w_v),
                "key": wp.uint32(key),
                "hits": hits,
                "expected": expected,
                "moments": shutter.exposure.moments if shutter.varies else Moments(),
                "passed": passed,
                "particles": wp.array(particles, dtype=ParticleData, device=self.device),
            },
        )
        return expected, hits

    def _splats(
        self, here: View, shutter: Open, particles: list[ParticleData], following: View | None
    ) -> dict[str, wp.array] | None:
        """The splats of all bodies by tiles; None if there is none."""
        then = Exposure()
        then.moments.cameras = wp.empty(0, dtype=CameraData, device=self.device)
        if following is not None and optics_spec(following.view) == optics_spec(here.view):
            way = self.current.way(1e-9 * following.time_ns) - self.current.way(1e-9 * here.time_ns)
            then = open_shutter(
                following, self._current(following.time_ns), 1e-9 * (following.time_ns - here.time_ns), way
            ).exposure
        known = {
            "scene": here.world.data,
            "exposure": shutter.exposure,
            "following": then,
            "lights": shutter.lights,
            "field": self.open_water.around_lights if self._has_field else Field(),
        }
        return splats_by_tiles(
            self.launcher, self._kernels(here).draw, known, self._cells(here, shutter, particles), here.view.resolution
        )

    def _cells(self, here: View, shutter: Open, particles: list[ParticleData]) -> list[Seen]:
        """The cells that a camera may see, of all classes of sizes of all blocks."""
        seen: list[Seen] = []
        for number, (law, record) in enumerate(zip(self.laws, particles, strict=True)):
            seeds = np.random.SeedSequence([self.scene.seed, law.block.seed, number, 0x736E6F77])
            seen += seen_cells(law, record, here, shutter, self._way(law, here.time_ns), seeds)
        return seen


def lamp_table(launcher: Launcher, here: View, kind: ParticleData) -> AlongCamera:
    """What one kind of bodies scatters of the lamps' light along a camera's rays, of a vehicle at rest."""
    steps, rows, cols = LAMP_NODES
    distances = 1 + round(steps * np.log(kind.reach / NEAREST))
    nodes = Nodes("bodies", (distances, rows, cols), NEAREST, kind.reach, (NEAREST + FADE, kind.reach))
    known = seen_at_rest(here.view, here.world.data.medium, here.world.lights)
    return checked(launcher, nodes, OF_LAMPS, known | {"particles": kind})


def with_snow(image, snow: Snow, layers: bool):
    """The image of water with its bodies; ``layers``: as a layer too."""
    shown = {
        name: None if (values := getattr(image, name)) is None else snow.over(values)
        for name in ("radiance", "denoised")
    }
    if layers and image.radiance is not None:
        image = replace(image, layers=image.layers | {"snow": shown["radiance"] - image.radiance})
    return replace(image, snow=snow, **shown)
