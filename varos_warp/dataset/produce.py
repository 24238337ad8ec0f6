"""The main job: a scene becomes a dataset on disk. What is complete there is kept, what is missing is made.

Rendering (which may be divided into shards and interrupted) writes linear EXR files; the exposure of A follows from
all of them afterwards. So the bytes do not depend on how the work was divided.
"""

import contextlib
import os
import sys
import time
from collections import Counter, deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

import varos_warp
from varos_warp.dataset import files, writers
from varos_warp.dataset.layout import Dataset, Layout, from_runs
from varos_warp.dataset.progress import Progress
from varos_warp.errors import InputError
from varos_warp.render import exposure
from varos_warp.render.denoise import available_method, denoise_image
from varos_warp.render.outputs import OUTPUTS, SEGMENT_LEVELS, linear_channels, to_half
from varos_warp.scene.frames import pinhole
from varos_warp.scene.load import scene_to_dict

BACKGROUND = max(2, min(8, (os.cpu_count() or 2) // 2))
"""Frames that are denoised and written while the next one is rendered."""
PLANNED = ("spp", "max_scatterings", "max_bounces", "integrator")
"""What a plan says of every frame."""
_FREE = ("render.outputs", "render.linear_exr", "render.depth_exr", "render.exposure")
"""Keys that may change between runs into one folder: what they ask for is made from or added to what is there."""


@dataclass
class Summary:
    """What a run did."""

    out: str
    frames: int
    """Frames asked for."""
    rendered: int = 0
    """Images rendered, of any type and camera."""
    kept: int = 0
    """Images that were there already."""
    complete: bool = True
    """Whether every image of the frames asked for is there; False while other shards are missing."""
    seconds: float = 0.0
    device: str | None = None
    messages: list[str] = field(default_factory=list)


def produce(scene, out, *, device: str = "auto", frames: slice = slice(None), shard: tuple[int, int] = (0, 1),
            sensors: bool = True, images: bool = True, quiet: bool = False, renderer=None) -> Summary:
    """Simulate, render and write a dataset; completes one that was interrupted, and leaves a complete one alone.

    Args:
        scene: The scene.
        out: Folder; made where it is missing.
        device: ``auto``, ``cpu`` or ``cuda:N``.
        frames: Which frames of the sequence.
        shard: (i, n): render only every n-th of these frames, from the i-th; the run that finds all of them complete
            does the exposure.
        sensors: Whether to write IMU, depth gauge and vehicle.
        images: Whether to render.
        quiet: No progress on stderr.
        renderer: A `FrameRenderer` of this scene, where there is one already.

    Raises:
        InputError: If the folder cannot be used, or holds a dataset of another scene.
    """
    start = time.monotonic()
    layout = Layout.of(scene, out)
    if images and renderer is None:
        from varos_warp.scene.device import resolve_device

        device = resolve_device(device)
    new = not layout.root.exists()
    previous = open_folder(scene, layout)
    try:
        job = _Job(scene, layout, simulated(scene, quiet), previous, frames, quiet)
        if images:
            job.prepare(device, shard, renderer)
        job.write_texts(sensors, images)
        if images:
            job.render()
            job.finish()
    finally:
        if new:
            with contextlib.suppress(OSError):
                layout.root.rmdir()  # what failed before the first file leaves no empty folder
    job.summary.seconds = round(time.monotonic() - start, 3)
    return job.summary


def simulated(scene, quiet: bool = False):
    """The scene's `Simulation`, with a progress bar."""
    from varos_warp.sim.trajectory import simulate

    with Progress("simulating", 100, "%", quiet) as progress:
        return simulate(scene, progress=progress.reach)


# --------------------------------------------------------------------------------------------------------- the folder


def open_folder(scene, layout: Layout) -> dict | None:
    """Contents of dataset.json where the folder holds a dataset of this scene; None where it is new.

    Raises:
        InputError: If the folder is a file, belongs to something else, or holds a dataset of another scene.
    """
    root = layout.root
    with files.writing(root):
        root.mkdir(parents=True, exist_ok=True)
        files.sweep(root)
        entries = [entry for entry in root.iterdir() if not entry.name.startswith(".")]
    if not entries:
        return None
    if not layout.metadata.exists():
        raise InputError("the folder is not empty and holds no dataset", file=root,
                         remedy="Give a new folder with -o, or empty this one.")
    meta = Dataset(root).meta
    check_same(scene, meta, layout.metadata)
    return meta


def check_same(scene, meta: dict, file: Path) -> None:
    """Refuse to mix what two different scenes make.

    Raises:
        InputError: Naming the first key that differs.
    """
    here = {"varos_warp version": varos_warp.__version__, "contents of": writers.sources(scene), **scene_to_dict(scene)}
    there = {"varos_warp version": meta["versions"]["varos_warp"], "contents of": meta["sources"], **meta["scene"]}
    different = [d for d in _differences(there, here) if not d[0].startswith(_FREE)]
    if different:
        key, old, new = different[0]
        rest = [d[0] for d in different[1:4]] + ["..."] * (len(different) > 4)
        also = f" (also different: {', '.join(rest)})" if rest else ""
        raise InputError(f"the dataset in this folder was made with {_short(old)}, not {_short(new)}{also}", file=file,
                         key=key, remedy="Give another folder with -o, or delete this one.")


def _short(value) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _differences(there, here, path: str = "") -> Iterator[tuple[str, object, object]]:
    """(key, value there, value here) of everything that differs between two trees of dicts and lists."""
    if isinstance(there, dict) and isinstance(here, dict):
        pairs = [(key, there.get(key), here.get(key)) for key in {**there, **here}]
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        pairs = [(i, *pair) for i, pair in enumerate(zip(there, here, strict=True))]
    else:
        if there != here:
            yield path, there, here
        return
    for key, a, b in pairs:
        yield from _differences(a, b, f"{path}.{key}" if path else str(key))


def select(frames: slice, count: int) -> list[int]:
    """Numbers of the frames that a slice names.

    Raises:
        InputError: If there are none.
    """
    chosen = list(range(count))[frames]
    if not chosen:
        words = ":".join("" if end is None else str(end) for end in (frames.start, frames.stop))
        raise InputError("names no frame", key="frames", value=words,
                         remedy=f"The sequence has frames 0 to {count - 1}.")
    return chosen


# ------------------------------------------------------------------------------------------------------------ the job


class _Job:
    """State of one run."""

    def __init__(self, scene, layout: Layout, simulation, previous: dict | None, frames: slice, quiet: bool):
        self.scene, self.layout, self.simulation, self.previous, self.quiet = scene, layout, simulation, previous, quiet
        self.count = len(simulation.frame_ticks)
        self.selected = select(frames, self.count)
        self.plan = previous and previous["samples"]["plan"]
        self.device = previous and previous["device"]
        self.statistics: dict[tuple[str, str, int], exposure.Statistics] = {}
        self.clamped: Counter[str] = Counter()
        before = previous["samples"] if previous else {}
        self.denoisers = {"A": before.get("denoise"), "B": before.get("denoise_b")}
        self.timings: list[dict] = []
        self.work: list[tuple[int, str, str]] = []
        self.meshes: dict | None = None
        self.summary = Summary(str(layout.root), len(self.selected))
        for message in simulation.messages:
            self.say(message)

    def say(self, message: str) -> None:
        """Tell the user, and keep it for the summary."""
        self.summary.messages.append(message)
        if not self.quiet:
            print(f"note: {message}", file=sys.stderr, flush=True)

    def T_w_v(self, frame: int) -> np.ndarray:
        """Pose of the vehicle at a frame."""
        return self.simulation.trajectory.T_w_v(self.simulation.frame_ticks[frame])

    def time_ns(self, frames: list[int]) -> np.ndarray:
        """Time of frames."""
        return self.simulation.trajectory.time_ns[np.asarray(self.simulation.frame_ticks)[frames]]

    # ------------------------------------------------------------------------------------------------------ texts

    def write_texts(self, sensors: bool, images: bool) -> None:
        """Everything but the images. dataset.json comes first: it says whose folder this is."""
        before = self.previous["outputs"] if self.previous else []
        asked = self.scene.render.outputs if images else []
        self.outputs = [letter for letter in OUTPUTS if letter in before or letter in asked]
        frames = set(from_runs(self.previous["frames"]["ranges"])) if before else set()
        self.frames = sorted(frames | set(self.selected if images or not before else ()))
        self.write_metadata()
        writers.write_readme(self.layout, self.scene)
        if sensors:
            writers.write_sensors(self.layout, self.scene, self.simulation)
        poses, time_ns = np.array([self.T_w_v(frame) for frame in self.frames]), self.time_ns(self.frames)
        for camera in self.scene.vehicle.cameras:
            writers.write_camera(self.layout, camera, self.frames, time_ns, poses, self.outputs)
        writers.write_lights(self.layout, self.scene, self.frames, time_ns, poses)

    def write_metadata(self) -> None:
        """Write dataset.json; the versions and the device stay those that the first frame was rendered with."""
        content = writers.describe(self.layout, self.scene, frames=self.frames, frame_count=self.count,
                                   outputs=self.outputs, plan=self.plan, device=self.device,
                                   denoisers=self.denoisers)
        if self.previous and self.previous["device"]:
            content["versions"] = self.previous["versions"]
        files.write_json(self.layout.metadata, content)

    # -------------------------------------------------------------------------------------------------- rendering

    def prepare(self, device: str, shard: tuple[int, int], renderer) -> None:
        """Find what this shard has to render, and if there is anything, load the scene and plan."""
        index, of = shard
        mine = self.selected[index::of]
        self.work = list(self.missing(mine))
        self.summary.rendered = sum(len(letters) for _, _, letters in self.work)
        wanted = len(mine) * len(self.layout.cameras) * len(self.scene.render.outputs)
        self.summary.kept = wanted - self.summary.rendered
        if self.work:
            self.choose_denoisers()
            self.renderer = renderer or self.open_renderer(device)
            self.note_device()
            self.write_segments()
            self.plan = self.plan or self.make_plan()
            self.renderer = self.as_planned()

    def write_segments(self) -> None:
        """Write what the numbers of S stand for, where S is asked for.

        Raises:
            InputError: If there are more objects than 16 bits can number.
        """
        if "S" not in self.scene.render.outputs:
            return
        rows = self.renderer.segments
        if len(rows) > SEGMENT_LEVELS:
            raise InputError(f"{len(rows)} objects cannot be numbered in 16 bits", key="render.outputs", value="S",
                             remedy="Leave out S, or scatter fewer.")
        files.write_json(self.layout.segments, {"0": "nothing", "segments": rows})

    def choose_denoisers(self) -> None:
        """Find what really denoises what is to be rendered, which is not what was asked for without pyoidn.

        Raises:
            InputError: If earlier frames were denoised otherwise.
        """
        render = self.scene.render
        for letter, asked, key in (("A", render.denoise, "denoise"), ("B", render.denoise_b, "denoise_b")):
            if not any(letter in letters for _, _, letters in self.work):
                continue
            method, before = available_method(asked), self.denoisers[letter]
            if before not in (None, method):
                raise InputError(f"frames of {letter} in this folder were denoised with {before!r}, the next ones "
                                 f"would be with {method!r}", file=self.layout.metadata, key=f"samples.{key}",
                                 remedy="Go on where Open Image Denoise (pyoidn) is installed alike, or give another "
                                        "folder with -o.")
            self.denoisers[letter] = method

    def note_device(self) -> None:
        """Keep the first device on record, and say when another one goes on."""
        here = {"name": self.renderer.device, "model": self.renderer.device_name}
        self.summary.device = _device(here)
        self.device = self.device or here
        if here != self.device:
            self.say(f"earlier frames were rendered on {_device(self.device)}, these are on {_device(here)}: pixels "
                     "may differ in rounding; dataset.json keeps the first")

    def render(self) -> None:
        """Render what is missing."""
        if not self.work:
            return
        try:
            with Progress("rendering", len(self.work), quiet=self.quiet) as progress:
                self.render_all(progress)
        finally:
            self.write_log()

    def missing(self, frames: list[int]) -> Iterator[tuple[int, str, str]]:
        """(frame, camera, letters) of the images of these frames that are not complete."""
        for frame in frames:
            for camera in self.layout.cameras:
                letters = "".join(letter for letter in self.scene.render.outputs
                                  if not all(map(files.is_complete, self.rendered_files(camera, letter, frame))))
                if letters:
                    yield frame, camera, letters

    def rendered_files(self, camera: str, letter: str, frame: int) -> list[Path]:
        """Files that only rendering can make; the PNG of A and B follow from their EXR."""
        layout, render = self.layout, self.scene.render
        if not OUTPUTS[letter].is_color:
            depth_exr = [layout.exr(camera, letter, frame)] if letter == "D" and render.depth_exr else []
            return [layout.png(camera, letter, frame), *depth_exr]
        linear = [layout.linear(camera, frame)] if letter == "A" and render.linear_exr else []
        return [layout.exr(camera, letter, frame), *linear]

    def open_renderer(self, device: str):
        """Load the scene onto the device, and warn of what looks wrong in it before hours are spent."""
        from varos_warp.render.detail import choose_detail
        from varos_warp.render.frame import FrameRenderer
        from varos_warp.scene.checks import check_scene
        from varos_warp.scene.meshes import build_parts
        from varos_warp.sim.trajectory import path_samples

        parts = build_parts(self.scene)
        for warning in check_scene(self.scene, parts, path_samples(self.simulation)):
            self.say(warning)
        detail = choose_detail(self.scene, parts, self.poses(), device, compare=not self.plan)
        self.meshes = detail.meshes
        return FrameRenderer(self.scene, device, detail.parts)

    def poses(self) -> list[np.ndarray]:
        """T_w_v of the whole sequence, whichever part of it this run renders."""
        return [self.T_w_v(frame) for frame in range(self.count)]

    def make_plan(self) -> dict:
        """What the planner chooses for the whole sequence."""
        from varos_warp.render.plan import plan_render

        start = time.monotonic()
        if not self.quiet:
            print("planning from a few poses ...", file=sys.stderr, flush=True)
        plan = plan_render(self.scene, self.renderer, self.poses(), meshes=self.meshes)
        error = "" if plan.error is None else f", predicted error {plan.error.max():.1%}"
        self.say(f"planned in {time.monotonic() - start:.0f} s: {plan.spp} samples per pixel of A{error}")
        return plan.to_dict()

    def as_planned(self):
        """The renderer, without what the plan leaves out."""
        from varos_warp.render.plan import planned_renderer

        return planned_renderer(self.renderer, self.plan, self.poses())

    def render_all(self, progress: Progress) -> None:
        """Render, and finish the last frames in the background meanwhile."""
        render = self.scene.render
        pending: deque = deque()
        with ThreadPoolExecutor(BACKGROUND) as pool:
            for frame, camera, letters in self.work:
                start, compiled = time.monotonic(), self.renderer.compile_seconds
                image = self.renderer.render(
                    self.T_w_v(frame), camera=self.view(camera), outputs=letters, layers=tuple(render.layers),
                    frame=frame, tolerance=self.plan["tile_tolerance"],
                    **{key: self.plan[key] for key in PLANNED}, **self.denoise_at_once())
                seconds = time.monotonic() - start - (self.renderer.compile_seconds - compiled)
                self.timings.append({"frame": frame, "camera": camera, "outputs": letters,
                                     "seconds": round(seconds, 4)} | self.samples_of(frame, camera, image))
                pending.append(pool.submit(self.store, frame, camera, letters, image))
                if len(pending) > BACKGROUND:
                    self.clamped += pending.popleft().result()
                progress.advance()
            for future in pending:
                self.clamped += future.result()

    def samples_of(self, frame: int, camera: str, image) -> dict:
        """What the log says of an image's samples; tells the user of any that were not numbers."""
        lost = {letter: made.lost_samples for letter in "AB" if (made := getattr(image, letter, None)) is not None}
        for letter, count in lost.items():
            if count:
                self.say(f"frame {frame}, camera {camera}: at least {count} samples of {letter} were infinite or not a "
                         "number and count as black")
        spp = getattr(getattr(image, "A", None), "spp", None)
        return ({"spp": round(spp, 2)} if spp else {}) | ({"lost_samples": sum(lost.values())} if any(
            lost.values()) else {})

    def view(self, camera: str):
        """The camera to render with, as planned: by its name, or without its lens."""
        if not self.plan["pinhole"]:
            return camera
        named = {view.id: view for view in self.scene.vehicle.cameras}
        return pinhole(named[camera])

    def denoise_at_once(self) -> dict[str, str]:
        """What the renderer is to denoise: what a GPU can; the CPU's part is done beside the next frame."""
        if self.renderer.device == "cpu":
            return {}
        keys = (("denoise", "A"), ("denoise_b", "B"))
        return {key: "oidn" for key, letter in keys if self.denoisers[letter] == "oidn"}

    # ---------------------------------------------------------------------------------------------------- storing

    def store(self, frame: int, camera: str, letters: str, image) -> Counter[str]:
        """Write what was rendered of one frame; returns how many values were cut, by image type."""
        clamped: Counter[str] = Counter()
        for letter in letters:
            try:
                if OUTPUTS[letter].is_color:
                    clamped[letter] = self.store_color(frame, camera, letter, getattr(image, letter))
                else:
                    self.store_geometry(frame, camera, letter, getattr(image, letter))
            except InputError:
                raise
            except ValueError as error:
                raise RuntimeError(f"frame {frame}, camera {camera}, image {letter}: {error}") from error
        return clamped

    def store_color(self, frame: int, camera: str, letter: str, image) -> int:
        """Write A or B: as rendered where asked for, denoised as half floats, and exposed if the gain is known.

        Returns:
            How many values were cut to the largest half float.
        """
        render = self.scene.render
        if letter == "A" and render.linear_exr:
            files.write_exr(self.layout.linear(camera, frame), linear_channels(image))
        denoised = denoise_image(image, self.denoisers[letter]) if image.denoised is None else image.denoised
        half, clamped = to_half(denoised)
        self.statistics[camera, letter, frame] = exposure.statistics(half)
        files.write_exr(self.layout.exr(camera, letter, frame), {"RGB": half})
        gain = exposure.known_gain(getattr(render.exposure, letter), letter)
        if gain is not None:
            files.write_png(self.layout.png(camera, letter, frame), OUTPUTS[letter].encode(half, gain))
        return clamped

    def store_geometry(self, frame: int, camera: str, letter: str, image) -> None:
        """Write C, D or S."""
        render = self.scene.render
        if letter == "C":
            files.write_png(self.layout.png(camera, letter, frame), OUTPUTS[letter].encode(image.normal))
            return
        if letter == "S":
            files.write_png(self.layout.png(camera, letter, frame), OUTPUTS[letter].encode(image.instance))
            return
        if render.depth_exr:
            channels = {"Z": image.depth, "range": image.range}
            files.write_exr(self.layout.exr(camera, letter, frame),
                            {name: np.ascontiguousarray(values, np.float32) for name, values in channels.items()})
        distance = image.depth if render.depth_kind == "z" else image.range
        files.write_png(self.layout.png(camera, letter, frame), OUTPUTS[letter].encode(distance, render.depth_range_m))

    def write_log(self) -> None:
        """When and how fast this run rendered; the only file that differs from run to run."""
        if self.timings:
            stamp, renderer = datetime.now(UTC), self.renderer
            name = f"{stamp:%Y%m%dT%H%M%S}_{files.HOST}_{os.getpid()}.json"
            files.write_json(self.layout.root / "log" / name, {
                "ended": stamp.isoformat(timespec="seconds"), "device": renderer.device, "model": renderer.device_name,
                "compile_seconds": round(renderer.compile_seconds, 3), "versions": writers.versions(),
                "frames": self.timings})

    # --------------------------------------------------------------------------------------------------- exposing

    def finish(self) -> None:
        """Expose A and B once all frames asked for are rendered, and make the contact sheet."""
        for letter, count in self.clamped.items():
            if count:
                self.say(f"{count} values of {letter} above 65504 were cut to it in the EXR")
        left = sum(len(letters) for _, _, letters in self.missing(self.selected))
        self.summary.complete = left == 0
        if left:
            self.say(f"{left} images belong to other shards and are not there yet; the run that completes them (or "
                     "any later one) exposes A and B and ends the dataset")
            return
        color = [letter for letter in self.outputs if OUTPUTS[letter].is_color]
        for camera in self.layout.cameras:
            for letter in color:
                self.expose(camera, letter)
        from varos_warp.dataset.report import contact_sheet

        contact_sheet(Dataset(self.layout.root), self.layout.root / "contact_sheet.png")

    def expose(self, camera: str, letter: str) -> None:
        """Gains of one camera from all its rendered frames; writes the PNG whose gain is new, then the gains.

        The gains come last: if it is interrupted, the next run finds the old ones and does it again.
        """
        setting = getattr(self.scene.render.exposure, letter)
        table_path = self.layout.camera_file(camera, f"_exposure_{letter}.csv")
        old, known = _read_gains(table_path), exposure.known_gain(setting, letter) is not None
        frames = [f for f in self.frames if files.is_complete(self.layout.exr(camera, letter, f))]
        data = Dataset(self.layout.root)
        found = [self.statistics.get((camera, letter, f)) or (old[f][1] if f in old else
                 exposure.statistics(data.linear(letter, f, camera))) for f in frames]
        time_ns = self.time_ns(frames)
        gains = exposure.gains(setting, letter, time_ns * 1e-9, found)

        def encode(frame: int, gain: float) -> None:
            path = self.layout.png(camera, letter, frame)
            fresh = known and (camera, letter, frame) in self.statistics
            exposed = fresh or (frame in old and old[frame][0] == gain)
            if not (exposed and files.is_complete(path)):
                files.write_png(path, OUTPUTS[letter].encode(data.linear(letter, frame, camera), gain))

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(encode, frames, gains.tolist()))
        files.write_csv(table_path, [writers.TIME, "frame", "gain", "log_average", "highlight"], time_ns, frames, gains,
                        [s.log_average for s in found], [s.highlight for s in found])


def _device(device: dict) -> str:
    return f"{device['name']} ({device['model']})"


def _read_gains(path: Path) -> dict[int, tuple[float, exposure.Statistics]]:
    """Gain and statistics of every frame that were written before; nothing where there are none to trust."""
    try:
        table = files.read_csv(path)
        rows = zip(table["frame"].tolist(), table["gain"].tolist(), table["log_average"].tolist(),
                   table["highlight"].tolist(), strict=True)
    except (InputError, KeyError):
        return {}
    return {frame: (gain, exposure.Statistics(average, highlight)) for frame, gain, average, highlight in rows}
