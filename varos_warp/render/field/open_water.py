"""The precomputed field of open water: solved once for the lights and cameras of a vehicle in its water, and kept.

kernels/field/open_water.py says what it holds, docs/results.md how right it is.
"""

from dataclasses import replace
from functools import cached_property

import numpy as np
import warp as wp
from threadpoolctl import threadpool_limits

from varos_warp.cache import cached, code_hash
from varos_warp.device.launcher import Launcher
from varos_warp.kernels.field.along_camera import AlongCamera
from varos_warp.kernels.field.open_water import Field, LightField
from varos_warp.render.field import solver
from varos_warp.render.field.along_camera import MULTIPLE, SINGLE, Nodes, along_camera, as_pinhole, tabulated
from varos_warp.render.field.solver import LightFieldSolver, NotSolved, farthest_m
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.lights.distribution import Distribution, distribution
from varos_warp.scene.lights.records import Lights
from varos_warp.scene.passes import passes
from varos_warp.scene.water import medium_record, optical_properties

CODE = (
    "varos_warp.kernels",
    "varos_warp.render.field",
    "varos_warp.scene.device",
    "varos_warp.scene.lights",
    "varos_warp.scene.water",
)
"""What the numbers of the field follow from, besides the scene: those on disk are solved again when it changes."""
MOST_BACKWARD_G, SHARPEST_G = 0.0, 0.98
"""Mean cosines of phase functions that the field serves. Of Henyey and Greenstein g = 0.8, 0.924, 0.95 and 0.98 agree
with paths in one scene (docs/stability.md); at -0.3 the matrix of scattering is 4 % off."""
MOST_DEPTH = 100.0
"""Optical depth of the farthest distance in the murkiest channel: at 200 the sum over the orders does not converge, for
most of the grid is dark (docs/stability.md). Jerlov's water types have 35 to 60."""
LIGHT_KINDS = ("spot", "point", "profile")
"""Lights that the field serves: points that are symmetric about an axis. Of disks a sample sees a point."""
CONES_DEG = (20.0, 179.0)
"""Cones, full angle, that the grids resolve, and that have one convex nappe. In sea water a cone of 20 degrees loses
0.2 % of the light within two free paths, of 10 degrees 1 %, of 5 degrees 3 %: narrow beams are seen as thin lines."""


def unavailable(scene: Scene) -> str | None:
    """Why the cameras of a scene have no field; None if they have one. Reads the files of lights and water."""
    return _no_lights(scene) or _no_water(scene) or _no_shape(scene)


def _no_lights(scene: Scene) -> str | None:
    """Why there is no field for the kinds of light of a scene; None: there may be one."""
    for light in scene.lights:
        if light.kind not in LIGHT_KINDS:
            return f"a light is of kind {light.kind!r}, and the field is known for {', '.join(LIGHT_KINDS)} only"
        if light.strobe:
            return "a light is a strobe, and the field is known for lights that shine all the time"
    return None if scene.lights else "there are no lights"


def _no_water(scene: Scene) -> str | None:
    """Why there is no field for the water of a scene; None: there may be one."""
    if scene.is_spectral:  # in every band
        return next(
            filter(None, (_no_water(one.scene) for camera in scene.vehicle.cameras for one in passes(scene, camera))),
            None,
        )
    water = optical_properties(scene)
    if not water.sigma_s.any():
        return "the water does not scatter"
    if not MOST_BACKWARD_G <= water.g <= SHARPEST_G:
        return (
            f"the mean cosine of the water's phase function is {water.g:g}, and the field is known from "
            f"{MOST_BACKWARD_G} to {SHARPEST_G}"
        )
    if water.sigma_t.max() * farthest_m(water) > MOST_DEPTH:
        return f"one channel is much murkier than another: it has an optical depth of over {MOST_DEPTH:g} on their grid"
    return None


def _no_shape(scene: Scene) -> str | None:
    """Why there is no field for how the lights of a scene shine; None: there is one."""
    narrow, wide = CONES_DEG
    for light in scene.lights:
        shape = distribution(light, scene)
        if not shape.is_round:
            return (
                f"the intensity of a lamp ({light.file}) changes around its axis, and the field is known for lamps "
                "that are the same all around"
            )
        if not shape.everywhere and not narrow <= np.degrees(2.0 * shape.half_angle) <= wide:
            return (
                f"a light's cone of {np.degrees(2.0 * shape.half_angle):.3g} degrees is not between {narrow:g} and "
                f"{wide:g}"
            )
    return None


class OpenWater:
    """The field of one scene on one device.

    Args:
        scene: With lights and water for which nothing is `unavailable`.
        launcher: Of the device.
        lights: Those of the scene there, where they are known.
    """

    def __init__(self, scene: Scene, launcher: Launcher, lights: Lights | None = None):
        self.scene, self.launcher, self.device = scene, launcher, launcher.device
        self.water = optical_properties(scene)
        self.lights = lights or Lights(scene, self.device)
        self._cameras: dict[str, AlongCamera] = {}

    @cached_property
    def failure(self) -> str | None:
        """Why the field cannot be had although nothing is `unavailable`; None if it can. It is solved for."""
        try:
            _ = self._lights
        except NotSolved as error:
            return str(error)
        return None

    @property
    def around_lights(self) -> Field:
        """The field without any part along a camera's rays.

        Raises:
            NotSolved: If there is a `failure`.
        """
        field = Field()
        field.lights = self._lights
        return field

    def field(self, view: Camera) -> Field:
        """The field for a camera; without the part along its rays where `along_camera` says that there is none.

        Raises:
            NotSolved: If there is a `failure`.
        """
        field = self.around_lights
        if along_camera(self.scene, view):
            field.multiple, field.single = self._along(view, MULTIPLE), self._along(view, SINGLE)
        return field

    def only_single(self, view: Camera) -> Field:
        """Light scattered once along a camera's rays, and nothing else: nothing is solved for."""
        field = Field()
        if along_camera(self.scene, view):
            field.single = self._along(view, SINGLE)
        return field

    def _along(self, view: Camera, nodes: Nodes) -> AlongCamera:
        """One of the tables along a camera's rays."""
        view, camera = as_pinhole(view)
        key = f"{nodes} {camera!r}"
        if key not in self._cameras:
            lights = [light.model_dump(mode="json") for light in self.scene.vehicle.lights]
            depends_on = self._depends_on(
                along=nodes,  # which tests change in memory
                camera=camera,
                lights=lights,
                distributions=[shape.described() for shape in self.lights.distributions],
            )
            arrays = cached("camera", depends_on, lambda: {"radiance": self._tabulated(view, nodes)})
            self._cameras[key] = nodes.table(self._array(arrays["radiance"]))
        return self._cameras[key]

    def _tabulated(self, view: Camera, nodes: Nodes) -> np.ndarray:
        """Radiance [distance, row, column, 3] of a table."""
        lights = self._lights if nodes.name == MULTIPLE.name else None
        return tabulated(self.launcher, view, nodes, medium_record(self.water, self.device), self.lights, lights)

    @cached_property
    def _lights(self) -> wp.array:
        """The field of each light; those of one distribution share their arrays."""
        shapes = self.lights.distributions
        kinds = list(dict.fromkeys(replace(shape, gain=1.0) for shape in shapes))
        # kept, for the array below holds no reference to the arrays of its fields
        self._fields = {shape: self._light_field(shape, kinds) for shape in dict.fromkeys(shapes)}
        fields = [self._fields[shape] for shape in shapes]
        return wp.array(fields, dtype=LightField, device=self.device)

    def _light_field(self, shape: Distribution, kinds: list[Distribution]) -> LightField:
        """The field of one of so many kinds of lamps, which differ in more than their gain."""
        solving, unit = LightFieldSolver(shape, self.water, self.launcher), replace(shape, gain=1.0)
        which = f" ({kinds.index(unit) + 1} of {len(kinds)} kinds)" if len(kinds) > 1 else ""
        arrays = cached(
            "light",
            self._depends_on(light=unit.described()),
            lambda: _solved(solving),
            what=f"the field of a lamp in this water{which}",
        )
        if "failure" in arrays:
            raise NotSolved(str(arrays["failure"]))
        field = LightField()
        field.grid = solving.fine
        field.irradiance, field.source = self._array(arrays["irradiance"]), self._array(arrays["source"])
        return field

    def _depends_on(self, **what) -> dict:
        """What the numbers of any array depend on, and what else."""
        return what | {
            "code": code_hash(__name__, CODE),
            "nodes": solver.nodes(),  # which tests change in memory
            "device": self.device.partition(":")[0],  # the kinds round differently
            "sigma_s": self.water.sigma_s.tolist(),
            "sigma_a": self.water.sigma_a.tolist(),
            "phase": self.water.phase.key,
        }

    def _array(self, values: np.ndarray) -> wp.array:
        return wp.array(values, dtype=wp.vec3, device=self.device)


def _solved(solving: LightFieldSolver) -> dict[str, np.ndarray]:
    """The field's arrays, the same however many cores there are: a product of matrices rounds differently on more.

    That it cannot be solved is kept like any field, so that it is found out once.
    """
    with threadpool_limits(1), np.errstate(all="ignore"):  # what is not a number is looked for
        try:
            return solving.solve()
        except NotSolved as error:
            return {"failure": np.array(str(error))}
