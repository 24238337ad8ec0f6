"""The layer ``snow``: the drawn bodies of a frame, less what they add in the mean.

A_out = A M + S - E: S are the bodies, E is their expectation, and M is what bodies let pass of what is behind them,
over its mean. The mean over all seeds is A, whatever integrator made it (Campbell's theorem: E[S] = E, E[M] = 1).
"""

import functools
from dataclasses import replace
from typing import Protocol

import numpy as np
import warp as wp

from varos_warp.device.launcher import Launcher
from varos_warp.kernels.field.open_water import Field
from varos_warp.kernels.particles.bodies import Particles as ParticleData
from varos_warp.kernels.particles.draw import Exposure
from varos_warp.kernels.particles.field_light import sum_along_rays
from varos_warp.kernels.particles.gather import find_tiles, gather_splats, take_mean
from varos_warp.kernels.particles.image import Directions
from varos_warp.kernels.particles.splat import TILE, Splat
from varos_warp.kernels.transport.moments import Moments
from varos_warp.kernels.world.camera import Camera as CameraData
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.lights.record import Light as LightData
from varos_warp.products.images.snow import Snow
from varos_warp.render.field.open_water import OpenWater
from varos_warp.render.kinds import ParticleKernels, lit_by_field, particle_kernels
from varos_warp.render.moments import Motion, moments_of
from varos_warp.render.particles.cells import (
    TURN_RATE,
    WANDER_PERIOD_S,
    cells_of,
    cone_of,
    field_of,
    particle_record,
    reach_of,
    size_classes,
)
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.device import DeviceScene, optics_spec
from varos_warp.scene.lights.records import lights_vary
from varos_warp.scene.optics.camera import camera_model
from varos_warp.scene.optics.shutter import STILL, instants
from varos_warp.scene.water.particles import ParticleLaw, particle_laws
from varos_warp.sim.vehicle.current import Current

TABLE = 48, 25, 41
"""Nodes of a table of the field's light by distance, row and column."""
RAYS, RAYS_BY_CHANNEL = 4, 6
"""Rays of a pixel along which E is taken, and which tell what hides a body; where each channel has its own, more."""
GUESSES = 65
"""Nodes along each side of the table of directions."""
IN_TURN = 9
"""Instants of an exposure whose cameras tell what is seen."""


class View(Protocol):
    """A camera at one frame."""

    @property
    def view(self) -> Camera:
        """The camera."""

    @property
    def T_w_v(self) -> np.ndarray:
        """Pose of the vehicle [4, 4]."""

    @property
    def motion(self) -> Motion | None:
        """Of the vehicle while the shutter is open; None: it stands still, and so does all else."""

    @property
    def world(self) -> DeviceScene:
        """With what moves where it is at the frame's time."""

    @property
    def time_ns(self) -> int:
        """Of the frame [ns]."""


class SnowRenderer:
    """Renders the layer ``snow`` of one scene on one device."""

    def __init__(self, scene: Scene, launcher: Launcher, open_water: OpenWater):
        self.scene, self.launcher, self.device, self.open_water = scene, launcher, launcher.device, open_water
        self.laws = particle_laws(scene)
        self.current = Current(scene.current, scene.seed)
        self._records = functools.lru_cache(maxsize=8)(self._particles)
        self._tables = functools.lru_cache(maxsize=8)(self._directions)

    def render(self, here: View, key: int, share: wp.array | None = None, following: View | None = None,
               whole: bool = True) -> Snow:
        """The bodies that a camera sees.

        Args:
            here: The camera.
            key: Of the random numbers of rays; those of the bodies follow from the scene.
            share: Of the light that reaches each pixel, float64 [H, W]; None: all.
            following: The camera at the next frame, to which the flow is; None: there is none.
            whole: Whether more is asked for than what image A needs.
        """
        shape = here.view.resolution[::-1]
        particles = [self._moved(record, law, here.time_ns) for record, law in
                     zip(self._records(here.view), self.laws, strict=True)]
        exposure, lights = self._exposure(here, 0.0)
        images = {name: wp.zeros(shape, dtype=kind, device=self.device) for name, kind in (
            ("light", wp.vec3), ("passed", float), ("coverage", float), ("flow", wp.vec2))}
        added = wp.empty(shape, dtype=wp.vec3, device=self.device)
        expected, hits = self._expect(here, exposure, lights, particles, key, images["passed"])
        splats = self._splats(here, exposure, lights, particles, following)
        if splats is not None:
            self.launcher.rows(gather_splats, shape, {**splats, "hits": hits, **images})
        self.launcher.run(take_mean, shape, {
            "share": wp.empty((0, 0), dtype=wp.float64, device=self.device) if share is None else share,
            "expected": expected, "light": images["light"], "added": added})
        wanted = {"added": added, "passed": images["passed"]}
        wanted |= {name: images[name] for name in ("coverage", "light") if whole}
        wanted |= {"flow": images["flow"]} if whole and following is not None else {}
        return Snow(**dict(zip(wanted, self.launcher.fetch(*wanted.values()), strict=True)))

    # ---------------------------------------------------------------------------------------------------- what moves

    def _particles(self, view: Camera) -> list[ParticleData]:
        return [particle_record(law, camera_model(view).pixel_angle, self.device) for law in self.laws]

    def _moved(self, record: ParticleData, law: ParticleLaw, time_ns: int) -> ParticleData:
        """The bodies of a block at a time."""
        moved, t = ParticleData(), 1e-9 * time_ns
        moved.assign(record)
        rate = 2.0 * np.pi / WANDER_PERIOD_S
        moved.velocity = wp.vec3(*(self.current.velocity(np.array([t]))[0] + law.block.drift_m_s))
        moved.wander, moved.wander_rate = law.block.wander_m_s * np.sqrt(2.0 / 3.0) / rate, rate
        moved.wander_phase, moved.turn = (float(np.fmod(r * t, 2.0 * np.pi)) for r in (rate, TURN_RATE))
        return moved

    def _way(self, law: ParticleLaw, time_ns: int) -> np.ndarray:
        """How far the bodies of a block have drifted since time 0, float64 [3] [m]."""
        t = 1e-9 * time_ns
        return self.current.way(t) + t * np.asarray(law.block.drift_m_s, float)

    # ------------------------------------------------------------------------------------------------- what is seen

    def _exposure(self, seen: View, after_s: float) -> tuple[Exposure, wp.array]:
        """A camera while its rows are exposed, and the lamps in the mean over that, [row or 1, lamp]."""
        view, scene, moves = seen.view, self.scene, seen.motion is not None and seen.view.shutter is not None
        exposure, moments = Exposure(), Moments()
        if moves or lights_vary(scene.lights):
            moments = moments_of(seen.world, view, seen.T_w_v, seen.motion if moves else None, False)
            lights = wp.array(mean_lights(moments, view.resolution[1]), dtype=LightData, device=self.device)
        else:
            moments.cameras = wp.array([seen.world.camera(view, seen.T_w_v)], dtype=CameraData, device=self.device)
            lights = wp.array(seen.world.lit(seen.T_w_v).lights.numpy()[None], dtype=LightData, device=self.device)
        when = instants(view, scene.lights) if moves else STILL
        exposure.moments, exposure.after_s, exposure.length_s = moments, after_s, when.length_s if moves else 0.0
        exposure.begin_s = float(when.offset_s[0] - 0.5 * when.length_s) if moves else 0.0
        exposure.width, exposure.height = view.resolution
        exposure.table = self._tables(view)
        return exposure, lights

    def _directions(self, view: Camera) -> Directions:
        """Image points by direction, of a camera with a lens or a port."""
        table = Directions()
        if not optics_spec(view).bends:
            table.points = wp.empty((0, 0), dtype=wp.vec2, device=self.device)
            return table
        from scipy.ndimage import distance_transform_edt

        table.half_angle = min(field_of(view).half_angle + 0.05, np.pi - 1e-3)
        y, x = (table.half_angle * axis for axis in np.meshgrid(*[np.linspace(-1.0, 1.0, GUESSES)] * 2, indexing="ij"))
        angle = np.hypot(x, y)
        across = np.sinc(angle / np.pi)
        far = 2.0 * np.stack([across * x, across * y, np.cos(angle)], -1)
        points = camera_model(view).project(np.where((angle < np.pi)[..., None], far, np.nan))
        unseen = ~np.isfinite(points).all(-1)
        if unseen.any():
            points = points[tuple(distance_transform_edt(unseen, return_distances=False, return_indices=True))]
        table.points = wp.array(points.astype(np.float32), dtype=wp.vec2, device=self.device)
        return table

    @functools.cached_property
    def _has_field(self) -> bool:
        """Whether the field of open water shines on bodies."""
        return lit_by_field(self.scene) and not self.open_water.failure

    def _kernels(self, here: View) -> ParticleKernels:
        return particle_kernels(self.scene, here.world.spec, here.view, here.motion is not None, self._has_field)

    def _of_field(self, here: View, kernel: wp.Kernel | None, lights: wp.array, particles: list[ParticleData]
                  ) -> wp.array:
        """What bodies scatter of the field in the mean, [kind, distance, row, column]; without a field, nothing."""
        tables = wp.zeros((len(particles), *TABLE), dtype=wp.vec3, device=self.device)
        if kernel is not None:
            scene = SceneData()
            scene.assign(here.world.data)
            scene.lights = lights[lights.shape[0] // 2]
            camera = here.world.camera(here.view, here.T_w_v, pinhole=True)
            size = wp.vec2(*map(float, here.view.resolution))
            for i, kind in enumerate(particles):
                self.launcher.run(kernel, TABLE, {
                    "scene": scene, "camera": camera, "field": self.open_water.around_lights, "particles": kind,
                    "size": size, "table": tables[i]})
                self.launcher.run(sum_along_rays, TABLE[1:], {"table": tables[i]})
        return tables

    def _expect(self, here: View, exposure: Exposure, lights: wp.array, particles: list[ParticleData], key: int,
                passed: wp.array) -> tuple[wp.array, wp.array]:
        """What the bodies add in the mean, and where the rays of the pixels end; fills what lets through."""
        view, world = here.view, here.world
        shape, spec = view.resolution[::-1], optics_spec(view)
        varies = exposure.moments.lights is not None and exposure.moments.lights.shape[0] > 0
        kernels = self._kernels(here)
        hits = wp.empty((RAYS_BY_CHANNEL if spec.dispersion else RAYS, *shape), dtype=float, device=self.device)
        expected = wp.empty(shape, dtype=wp.vec3, device=self.device)
        of_field = self._of_field(here, kernels.field_light, lights, particles)
        self.launcher.rows(kernels.expected, shape, {
            "of_field": of_field, "scene": world.lit(here.T_w_v), "camera": world.camera(view, here.T_w_v),
            "moments": exposure.moments if varies else Moments(), "key": wp.uint32(key), "hits": hits,
            "particles": wp.array(particles, dtype=ParticleData, device=self.device), "expected": expected,
            "passed": passed})
        return expected, hits

    def _splats(self, here: View, exposure: Exposure, lights: wp.array, particles: list[ParticleData],
                following: View | None) -> dict[str, wp.array] | None:
        """The splats of all bodies by tiles, as `gather_splats` takes them; None if there is none."""
        world, launcher = here.world, self.launcher
        kernel = self._kernels(here).draw
        then = Exposure()
        then.moments.cameras = wp.empty(0, dtype=CameraData, device=self.device)
        if following is not None and optics_spec(following.view) == optics_spec(here.view):
            then, _ = self._exposure(following, 1e-9 * (following.time_ns - here.time_ns))
        classes = [(kind, cone, cells) for i, kind in enumerate(particles)
                   for cone, cells in self._classes(i, kind, here, exposure)]
        counted = []
        none = {"ends": wp.empty(0, dtype=int, device=self.device), "tiles": wp.empty(0, dtype=int, device=self.device),
                "splats": wp.empty(0, dtype=Splat, device=self.device)}
        known = {"scene": world.data, "exposure": exposure, "following": then, "lights": lights,
                 "field": self.open_water.around_lights if self._has_field else Field()}
        for kind, cone, cells in classes:
            counts = wp.empty(int(np.prod(cells.size)), dtype=int, device=self.device)
            launcher.rows(kernel, counts.shape, {**known, **none, "particles": kind, "cone": cone, "cells": cells,
                                                 "counts": counts}, tile_rows=CELL_ROWS)
            ends = wp.empty_like(counts)
            wp.utils.array_scan(counts, ends, inclusive=True)
            counted.append((counts, ends))
        totals = [int(total[0]) for total in launcher.fetch(*(ends[-1:].contiguous() for _, ends in counted))]
        count = sum(totals)
        if not count:
            return None
        tiles, order = (wp.empty(2 * count, dtype=int, device=self.device) for _ in "to")
        splats = wp.empty(count, dtype=Splat, device=self.device)
        first = 0
        for (kind, cone, cells), (counts, ends), total in zip(classes, counted, totals, strict=True):
            if total:
                launcher.rows(kernel, counts.shape, {
                    **known, "particles": kind, "cone": cone, "cells": cells, "counts": counts, "ends": ends,
                    "tiles": tiles[first:first + total], "splats": splats[first:first + total]}, tile_rows=CELL_ROWS)
            first += total
        wp.copy(order, wp.array(np.arange(count, dtype=np.int32), dtype=int, device=self.device), count=count)
        wp.utils.radix_sort_pairs(tiles, order, count)
        width, height = here.view.resolution
        starts = wp.empty(-(-width // TILE) * -(-height // TILE) + 1, dtype=int, device=self.device)
        launcher.run(find_tiles, starts.shape, {"tiles": tiles, "count": count, "starts": starts})
        return {"splats": splats, "order": order, "starts": starts}

    def _classes(self, number: int, record: ParticleData, here: View, exposure: Exposure):
        """Cone and cells of each class of sizes of a block."""
        law, view = self.laws[number], here.view
        cameras = exposure.moments.cameras.numpy()
        seen = cameras[np.unique(np.linspace(0, len(cameras) - 1, IN_TURN).astype(int))]
        open_s = 0.5 * len(cameras) * exposure.length_s
        aperture = 0.5e-3 * view.focal_mm / view.f_stop if view.f_stop > 0.0 else 0.0
        slack = (np.linalg.norm(record.velocity) * open_s + 2.0 * record.wander + law.block.radius_m[1]
                 + aperture * (1.0 + record.reach / max(view.focus_m, 0.1)) + 1e-3)
        cone, way = cone_of(seen, field_of(view), float(slack)), self._way(law, here.time_ns)
        keys = np.random.SeedSequence([self.scene.seed, law.block.seed, number, 0x736E6F77])
        sizes = size_classes(law)
        for size, key in zip(sizes, keys.generate_state(len(sizes)), strict=True):
            reach = min(reach_of(law), size.r_high / record.least_angle)
            cells = cells_of(size, cone, reach, here.world.origin, way)
            cells.slope, cells.key = law.block.slope, wp.uint32(int(key))
            yield cone, cells


CELL_ROWS = 1 << 12
"""Cells that a CPU's thread visits at a time."""


def mean_lights(moments: Moments, rows: int) -> np.ndarray:
    """Records of the lamps [row or 1, lamp] in the middle of a row's exposure, with their mean intensity over it."""
    lights, count = moments.lights.numpy(), moments.lights.shape[0]
    begin = np.arange(rows if moments.per_row else 1) * float(moments.per_row)
    end = begin + max(float(moments.open), 1.0)
    low, high = (moments.lit_begin, moments.lit_end) if moments.lit_end else (0, count)
    begin, end = np.clip(begin, low, high), np.clip(end, low, high)
    middle = np.clip((0.5 * (begin + end)).astype(int), 0, count - 1)
    found, summed = lights[middle], np.cumsum(lights["intensity"].astype(float), axis=0)
    summed = np.concatenate([np.zeros_like(summed[:1]), summed])
    nodes = np.arange(count + 1)
    over = [np.stack([np.interp(at, nodes, column) for column in summed.reshape(count + 1, -1).T], -1)
            for at in (begin, end)]
    length = np.maximum(end - begin, 1e-9)[:, None]
    found["intensity"] = ((over[1] - over[0]) / length).reshape(found["intensity"].shape)
    found["intensity"][end <= begin] = 0.0
    return found


def with_snow(image, snow: Snow, layers: bool):
    """The image of water with its bodies; ``layers``: as a layer too."""
    shown = {name: None if (values := getattr(image, name)) is None else snow.over(values)
             for name in ("radiance", "denoised")}
    if layers and image.radiance is not None:
        image = replace(image, layers=image.layers | {"snow": shown["radiance"] - image.radiance})
    return replace(image, snow=snow, **shown)

