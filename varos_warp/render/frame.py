"""One frame from one pose of the vehicle: radiance of A and B, normals of C, depth of D, objects of S."""

import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
import warp as wp

from varos_warp.errors import InputError
from varos_warp.kernels.ambient import make_ambient_kernel
from varos_warp.kernels.aov import make_first_hits_kernel
from varos_warp.kernels.conventions import ALL, BLOCK_DIM
from varos_warp.kernels.film import Film, develop
from varos_warp.kernels.path import PathSpec, make_path_kernel
from varos_warp.kernels.reference import make_reference_kernel
from varos_warp.kernels.tables import TablesSpec, make_tables_kernel
from varos_warp.render.tables import OpenWater
from varos_warp.scene.description import Camera, Scene
from varos_warp.scene.device import DeviceScene, resolve_device
from varos_warp.scene.geometry import Part
from varos_warp.scene.segments import segment_table

LAYERS = ("direct", "single", "multiple")
INTEGRATORS = ("auto", "tables", "path", "reference")
TILE_ROWS = 8
"""Rows of a CPU tile: enough tiles to keep every core busy to the end."""
GPU_THREADS = 1 << 19
"""Threads that fill a large GPU: small images are split into strata of samples until there are as many."""


@dataclass(frozen=True)
class RadianceImage:
    """Linear radiance [W/sr/m^2] before denoising and exposure, float32 [H, W, 3]."""

    radiance: np.ndarray
    stderr: np.ndarray
    """Standard error of the mean; inf for one sample."""
    layers: dict[str, np.ndarray] = field(default_factory=dict)
    """Of A: direct, single, multiple; those that were asked for, and they sum to ``radiance``."""


@dataclass(frozen=True)
class NormalImage:
    """World normals towards the camera, float32 [H, W, 3]; zeros where nothing is hit."""

    normal: np.ndarray


@dataclass(frozen=True)
class DepthImage:
    """Distances [m] of the pixel centres' first hits, float32 [H, W]; inf where nothing is hit."""

    depth: np.ndarray
    """Planar, along the camera's z axis."""
    range: np.ndarray
    """Along the ray."""


@dataclass(frozen=True)
class SegmentImage:
    """What the pixel centres' rays hit first, int32 [H, W]; 0 where nothing is hit. See `FrameRenderer.segments`."""

    instance: np.ndarray
    """Number of the terrain or object, from 1."""
    material: np.ndarray
    """Number of its material in the scene file, from 1; 0 also where it has none."""


@dataclass(frozen=True)
class Frame:
    """What was asked for of one pose; the rest is None."""

    A: RadianceImage | None = None
    B: RadianceImage | None = None
    C: NormalImage | None = None
    D: DepthImage | None = None
    S: SegmentImage | None = None


def _usable_cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def resolve_integrator(name: str) -> str:
    """The integrator that ``render.integrator`` stands for.

    Raises:
        InputError: If there is none of that name.
    """
    return "path" if name == "auto" else name


def _check_request(outputs, layers, integrator, **numbers):
    """Refuse what cannot be rendered: unknown letters, layers and integrators, numbers under their least value."""
    texts = (("outputs", outputs, "ABCDS"), ("layers", layers, LAYERS), ("integrator", [integrator], INTEGRATORS))
    for key, names, known in texts:
        unknown = [name for name in names if name not in known]
        if unknown or not len(names):
            raise InputError("unknown or none", key=key, value=names, remedy=f"Name some of: {', '.join(known)}.")
    for key, number in numbers.items():
        least = 1 if key.startswith("spp") else 0
        if number is not None and number < least:
            raise InputError(f"must be at least {least}", key=key, value=number)


def stream_key(seed: int, frame: int, camera: str, output: str) -> int:
    """32-bit key of the random numbers of one image; pixel and sample are added in the kernel."""
    words = [seed, frame, *camera.encode(), *output.encode()]
    return int(np.random.SeedSequence(words).generate_state(1)[0])


class FrameRenderer:
    """Renders frames of one scene on one device; uploads and compiles once.

    Args:
        scene: the scene.
        device: ``auto``, ``cpu`` or ``cuda:N``.
        parts: its geometry, where it is built already.
        threads: CPU threads; absent: all that the process may use. Does not change a byte of the result.
    """

    def __init__(self, scene: Scene, device: str = "auto", parts: list[Part] | None = None, threads: int | None = None):
        self.scene = scene
        self.device = resolve_device(device)
        self.device_name = wp.get_device(self.device).name
        if parts is None:
            from varos_warp.scene.meshes import build_parts

            parts = build_parts(scene)
        self.world = DeviceScene(scene, parts, self.device)
        self.origin = self.world.origin
        self.segments = segment_table(scene, self.world.part_names)
        """What the numbers of S stand for: a row for each."""
        self.threads = threads or _usable_cores()
        self.compile_seconds = 0.0
        self.open_water = OpenWater(scene, self.device)
        self._films: dict[tuple[int, int, int], Film] = {}
        self._loaded: set = set()
        self._cameras = {camera.id: camera for camera in scene.vehicle.cameras}

    def render(
        self,
        T_w_v,
        camera: str | Camera | None = None,
        outputs="ABCD",
        *,
        spp: int | None = None,
        spp_b: int | None = None,
        max_scatterings: int | None = None,
        max_bounces: int | None = None,
        layers=LAYERS,
        integrator: str | None = None,
        seed: int | None = None,
        frame: int = 0,
    ) -> Frame:
        """Render the ``outputs`` of one camera for the vehicle at ``T_w_v`` [4, 4].

        Args:
            T_w_v: pose of the vehicle in the world.
            camera: id of a camera of the scene, or a camera that is not in it; absent: the first.
            outputs: any of A, B, C, D and S.
            spp: samples per pixel of A; absent: the scene's, or 64.
            spp_b: samples per pixel of B; absent: the scene's.
            max_scatterings: most scatterings in the water on a path; None: no bound.
            max_bounces: most reflections on surfaces; None: no bound.
            layers: which of direct, single, multiple to render.
            integrator: of A: auto, tables, path or reference; absent: the scene's.
            seed: of the random numbers; absent: the scene's.
            frame: number of the frame, which keys the random numbers too.
        """
        bounds = {"max_scatterings": max_scatterings, "max_bounces": max_bounces}
        integrator = integrator or self.scene.render.integrator
        _check_request(outputs, layers, integrator, spp=spp, spp_b=spp_b, **bounds)
        view = self._camera(camera)
        seed = self.scene.seed if seed is None else seed
        T_w_v = np.asarray(T_w_v, np.float64)
        images = {}
        if "A" in outputs:
            spp = spp or self.scene.render.spp or 64
            key = stream_key(seed, frame, view.id, "A")
            bounds = (ALL if bound is None else bound for bound in bounds.values())
            images["A"] = self._render_water(view, T_w_v, spp, *bounds, layers, resolve_integrator(integrator), key)
        if "B" in outputs:
            key = stream_key(seed, frame, view.id, "B")
            images["B"] = self._render_ambient(view, T_w_v, spp_b or self.scene.render.spp_b, key)
        if set("CDS") & set(outputs):
            first_hits = self._render_first_hits(view, T_w_v)
            images |= {name: image for name, image in first_hits.items() if name in outputs}
        return Frame(**images)

    def _camera(self, name: str | Camera | None) -> Camera:
        if isinstance(name, Camera):
            return name
        if name is None:
            return self.scene.vehicle.cameras[0]
        if name not in self._cameras:
            raise InputError(
                "no such camera", key="camera", value=name, remedy=f"There are: {', '.join(self._cameras)}."
            )
        return self._cameras[name]

    # ------------------------------------------------------------------------------------------------- the images

    def _render_water(self, view, T_w_v, spp, max_scatterings, max_bounces, layers, integrator, key) -> RadianceImage:
        medium = bool(self.world.water.sigma_s.any())
        if not (self.world.has_surfaces or medium) or not self.scene.vehicle.lights:
            black = np.zeros((*view.resolution[::-1], 3), np.float32)
            return RadianceImage(black, black.copy(), {layer: black.copy() for layer in layers})
        max_scatterings = max_scatterings if medium else 0
        wanted = ("direct" in layers, "single" in layers, "multiple" in layers)
        surfaces = (self.world.has_instances, self.world.has_textures)
        bounds = [max_scatterings, max_bounces]
        if integrator == "reference":
            kernel = make_reference_kernel(*wanted, *surfaces)
        elif integrator == "tables":
            kernel = make_tables_kernel(TablesSpec(*wanted, *surfaces))
            tables = self.open_water.tables(view)
            self.world.pose_lights(T_w_v)
            grid, points = self._veil(view, T_w_v, tables, spp, max_bounces, key, surfaces)
        else:
            kernel = make_path_kernel(PathSpec(medium, *wanted, *surfaces))
        self.world.pose_lights(T_w_v)
        film = self._film(view, spp)
        self._launch(
            kernel,
            view,
            film,
            [self.world.data, self.world.camera(view, T_w_v)],
            [*([tables, points, grid] if integrator == "tables" else []), spp, *(bounds if integrator != "tables" else bounds[1:]), wp.uint32(key), film],
        )
        return self._develop(film, spp, layers)

    def _veil(self, view, T_w_v, tables, spp, max_bounces, key, surfaces):
        from varos_warp.kernels.lit_points import LitPoint, make_lit_points_kernel
        from varos_warp.kernels.veil import VeilGrid, make_veil_kernel, sum_slabs
        import os
        CELL=int(os.environ.get("CELL","8")); K=int(os.environ.get("SLABS","16")); N=int(os.environ.get("NV","8"))
        points = wp.empty(1 << 14, dtype=LitPoint, device=self.device)
        kk = make_lit_points_kernel(*surfaces); self._load(kk)
        wp.launch(kk, dim=points.shape[0], inputs=[self.world.data, wp.uint32(key)], outputs=[points], device=self.device, block_dim=BLOCK_DIM)
        width, height = view.resolution
        rows, cols = max(2, -(-height // CELL) + 1), max(2, -(-width // CELL) + 1)
        grid = VeilGrid()
        grid.scale = 1.0
        grid.log_step = float(np.log1p(200.0) / K)
        grid.radiance = wp.empty((K, rows, cols), dtype=wp.vec3, device=self.device)
        slabs = wp.empty((N, rows, cols, K), dtype=wp.vec4, device=self.device)
        kern = make_veil_kernel(*surfaces)
        self._load(kern)
        camera = self.world.camera(view, T_w_v, pinhole=True)
        args = [tables, points, grid, wp.vec2(float(width), float(height)), max_bounces, wp.uint32(key ^ 0x5bd1e995), slabs]
        if self.device != "cpu":
            wp.launch(kern, dim=(rows, cols, N), inputs=[self.world.data, camera, 0, *args], device=self.device, block_dim=BLOCK_DIM)
        else:
            with ThreadPoolExecutor(self.threads) as pool:
                list(pool.map(lambda r: wp.launch(kern, dim=(1, cols, N), inputs=[self.world.data, camera, r, *args], device="cpu"), range(rows)))
        self._load(sum_slabs)
        wp.launch(sum_slabs, dim=(rows, cols), inputs=[self.world.data, slabs, grid], device=self.device, block_dim=BLOCK_DIM)
        return grid, points

    def _render_ambient(self, view, T_w_v, spp, key) -> RadianceImage:
        if not self.world.has_surfaces:
            shape = (*view.resolution[::-1], 3)
            return RadianceImage(np.ones(shape, np.float32), np.zeros(shape, np.float32))
        film = self._film(view, spp)
        self._launch(
            make_ambient_kernel(self.world.has_instances, self.world.has_textures),
            view,
            film,
            [self.world.data, self.world.camera(view, T_w_v, pinhole=True)],
            [spp, ALL, wp.uint32(key), film],
        )
        image = self._develop(film, spp, ("direct",))
        return RadianceImage(image.radiance, image.stderr)

    def _render_first_hits(self, view, T_w_v) -> dict[str, NormalImage | DepthImage | SegmentImage]:
        width, height = view.resolution
        shape = (height, width)
        normal = wp.zeros(shape, dtype=wp.vec3, device=self.device)
        depth, distance = (wp.full(shape, wp.inf, dtype=float, device=self.device) for _ in range(2))
        instance = wp.zeros(shape, dtype=wp.int32, device=self.device)
        if self.world.has_surfaces:
            camera = self.world.camera(view, T_w_v, pinhole=True)
            kernel = make_first_hits_kernel(self.world.has_instances)
            self._launch(kernel, view, None, [self.world.data, camera], [normal, depth, distance, instance])
        ids = instance.numpy()
        return {
            "C": NormalImage(normal.numpy()),
            "D": DepthImage(depth.numpy(), distance.numpy()),
            "S": SegmentImage(ids, np.array([0, *(row["material_id"] for row in self.segments)], np.int32)[ids]),
        }

    # ---------------------------------------------------------------------------------------------- films, launches

    def _film(self, view, spp: int) -> Film:
        """Buffers for an image, kept from frame to frame; strata depend on nothing but device kind, size and spp."""
        width, height = view.resolution
        strata = 1 if self.device == "cpu" else max(1, min(spp, GPU_THREADS // (width * height)))
        shape = (strata, height, width)
        if shape not in self._films:
            film = Film()
            for name in ("direct", "single", "multiple", "squares"):
                setattr(film, name, wp.empty(shape, dtype=wp.vec3d, device=self.device))
            self._films[shape] = film
        return self._films[shape]

    def _develop(self, film: Film, spp: int, layers) -> RadianceImage:
        shape = film.squares.shape[1:]
        images = {name: wp.empty(shape, dtype=wp.vec3, device=self.device) for name in (*LAYERS, "radiance", "stderr")}
        self._load(develop)
        outputs = list(images.values())
        wp.launch(develop, dim=shape, inputs=[film, spp], outputs=outputs, device=self.device, block_dim=BLOCK_DIM)
        arrays = {name: image.numpy() for name, image in images.items()}
        return RadianceImage(
            arrays["radiance"], arrays["stderr"], {layer: arrays[layer] for layer in LAYERS if layer in layers}
        )

    def _launch(self, kernel, view, film, before, after):
        """Run a kernel over the image: at once on a GPU, in tiles of rows from a thread pool on the CPU."""
        self._load(kernel)
        width, height = view.resolution
        strata = () if film is None else (film.squares.shape[0],)
        if self.device != "cpu":
            wp.launch(
                kernel,
                dim=(height, width, *strata),
                inputs=[*before, 0, *after],
                device=self.device,
                block_dim=BLOCK_DIM,
            )
            return

        def launch_tile(row):
            rows = min(TILE_ROWS, height - row)
            wp.launch(kernel, dim=(rows, width, *strata), inputs=[*before, row, *after], device="cpu")

        rows = range(0, height, TILE_ROWS)
        if self.threads == 1:
            for row in rows:
                launch_tile(row)
            return
        with ThreadPoolExecutor(self.threads) as pool:
            list(pool.map(launch_tile, rows))

    def _load(self, kernel):
        """Compile a kernel before threads need it, and count the time apart."""
        if kernel not in self._loaded:
            start = time.perf_counter()
            # the block size is part of a binary's identity, and a CPU launch always has 1
            kernel.module.load(self.device, block_dim=1 if self.device == "cpu" else BLOCK_DIM)
            self.compile_seconds += time.perf_counter() - start
            self._loaded.add(kernel)
