"""The steps of a run: what is decided, loaded, written, rendered and finished, in this order."""

import contextlib
import os
import time
from collections import Counter
from collections.abc import Callable
from datetime import UTC, datetime

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.layout import Layout, from_runs
from varos_warp.dataset.progress import Console, Progress
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.pipeline import Pipeline, Rendered, give_back_large_arrays
from varos_warp.dataset.run.shared import Shared, borrow
from varos_warp.dataset.run.summary import Summary
from varos_warp.dataset.run.workers import run_in_workers
from varos_warp.dataset.timing import BESIDE, MAIN, Clock
from varos_warp.dataset.write import folder, tables
from varos_warp.dataset.write import texts as writers
from varos_warp.dataset.write.checksums import Record
from varos_warp.dataset.write.expose import expose
from varos_warp.dataset.write.images import ImageJob, Store
from varos_warp.dataset.write.moving import describe_moving, write_moving
from varos_warp.dataset.write.rays import write_rays
from varos_warp.device.compile import beside
from varos_warp.device.devices import kind_of
from varos_warp.errors import InputError, RunFailed, counted
from varos_warp.products.images.registry import DENOISE_KEYS, OUTPUTS, colors
from varos_warp.products.images.segments import SEGMENT_LEVELS
from varos_warp.products.sensors.registry import needs_solids
from varos_warp.render.decisions import Plan
from varos_warp.render.image.denoise import available_method
from varos_warp.render.moments import Motion
from varos_warp.scene.description.image_types import SEGMENTS
from varos_warp.scene.description.optics import has_lens
from varos_warp.scene.optics.camera import camera_model
from varos_warp.scene.spectra.matrix import color_matrix
from varos_warp.sim.clock import frame_time_ns, select


def simulated(scene, quiet: bool = False, parts: list | None = None):
    """The scene's `Simulation`, with a progress bar; ``parts`` are its geometry, where it is at hand."""
    from varos_warp.sim.trajectory import simulate

    with Console(quiet).progress("simulating", 100, "%") as progress:
        return simulate(scene, parts, progress=progress.reach)


class Run:
    """State of one run, or of one worker's part of it."""

    is_worker = False
    """True if a parent does what follows from the frames of all shards."""
    has_tables = False
    """True if the tables are written already."""

    def __init__(
        self, scene, layout: Layout, shard: tuple[int, int], console: Console, device: str, shared: Shared | None = None
    ):
        self.scene, self.layout, self.shard, self.console = scene, layout, shard, console
        self.device, self.shared = device, shared or Shared()
        self.renderer = self.shared.renderer if self.shared.is_lit else None
        self.clock, self.made, self.record = Clock(), Rendered(), Record(layout.root)
        self.work: list[ImageJob] = []

    def simulate(self, frames: slice, previous: dict | None) -> None:
        """The course of the vehicle, and the frames of it that are asked for."""
        if needs_solids(self.scene.vehicle) and self.parts is None:
            with self.clock("load"):
                self.build()
        if self.shared.simulation is None:
            with self.clock("simulate"):
                self.shared.simulation = simulated(self.scene, self.console.quiet, self.parts)
        self.simulation = self.shared.simulation
        self.count = len(self.simulation.frames)
        self.selected = select(frames, self.count)
        self.summary = Summary(str(self.layout.root), len(self.selected))
        for message in self.simulation.messages:
            self.say(message)
        if frames.stop is not None and frames.stop > self.count:
            self.say(f"frames up to {frames.stop - 1} are asked for, but the sequence ends with frame {self.count - 1}")
        self.take_over(previous)

    @property
    def parts(self) -> list | None:
        """Everything solid in the scene, where something needed it."""
        return self.shared.parts

    def take_over(self, previous: dict | None) -> None:
        """What earlier runs, or other shards, decided holds for this one, too."""
        self.previous = previous
        before = previous["samples"] if previous else {}
        self.plan = Plan.from_dict(before["plan"]) if before.get("plan") else None
        self.recorded_device = previous and previous["device"]
        self.denoisers = {letter: before.get(key) for letter, key in DENOISE_KEYS.items()}
        self.store = Store(self.layout, self.scene, self.denoisers, self.record.has)

    def clean_up(self) -> None:
        """Remove what killed runs left, and files that are not as a run wrote them, which are then made again.

        A shard leaves them: others are at work. The run that completes the dataset compares all checksums.
        dataset.json, by which all else was made, is refused if it is not as it was written.
        """
        if folder.is_read_only(self.layout.root):
            self.refuse_damage()
            return
        folder.sweep(self.layout.root)
        if self.shard[1] > 1 or not self.previous:
            return
        with self.clock("checksums"):
            damaged = self.refuse_damage()
        for name in damaged:
            self.record.forget(name)

    def refuse_damage(self) -> list[str]:
        """Tell of files that are not as a run wrote them, and return their names; some cannot be made again."""
        damaged = self.record.damaged()
        own = self.layout.metadata.name
        if own in damaged:
            raise InputError(
                "is not as a run wrote it: its checksum differs",
                file=self.layout.metadata,
                remedy="Restore it, or make the dataset anew in another folder.",
            )
        if damaged:
            names = ", ".join(damaged[:5]) + ", ..." * (len(damaged) > 5)
            self.say(f"{counted(len(damaged), 'damaged or missing file')}, to be made again: {names}")
        return damaged

    @property
    def mine(self) -> list[int]:
        """Frames of this shard."""
        return self.selected[self.shard[0] :: self.shard[1]]

    def borrow(self) -> None:
        """Link the images that other datasets have, but for the first frame, which shows whether they are the same."""
        if not self.shared.donors:
            return
        with folder.planning(self.layout.root):
            self.take_over(folder.recorded(self.scene, self.layout))
            if self.previous is None:  # whose folder this is stands there before anything else
                self.choose_extent(images=False)
                self.write_metadata()
                self.take_over(folder.recorded(self.scene, self.layout))
        with self.clock("checksums"):
            borrow(self.shared.donors, self.layout, self.scene, self.mine[1:], self.record)

    def hand_out(self, workers: int, body: Callable, arguments: tuple, sensors: bool) -> None:
        """Have worker processes, which call ``body``, render what is missing; write tables from the first image on."""
        self.find_work()
        if not self.work:
            return
        self.choose_extent(images=True)
        try:
            with self.rendering() as progress:

                def done(steps: int) -> None:
                    progress.advance(steps)
                    if not self.has_tables:
                        self.write_tables(sensors)

                results = run_in_workers(workers, body, arguments, done=done, tell=self.console.tell)
                self.summary.rate = round(progress.rate, 4)
        finally:
            folder.sweep(self.layout.root)  # what killed workers left
            self.record.reload()
        for summary, made in results:
            self.made.add(made)
            self.clock.beside(summary.stages)
            self.summary.messages += [words for words in summary.messages if words not in self.summary.messages]
        devices = Counter(summary.device for summary, _ in results if summary.device)
        self.summary.device = ", ".join(f"{n} x {name}" if n > 1 else name for name, n in devices.items())

    def go(self, sensors: bool, images: bool) -> None:
        """Everything after the simulation."""
        if images:
            self.find_work()
        with self.compiling():
            if self.work or self.lacks_segments(images):
                with self.clock("load"):
                    self.load()
            with folder.planning(
                self.layout.root,
                lambda: (
                    None if self.is_worker else self.console.tell("waiting for the plan that another shard makes ...")
                ),
            ):
                self.take_over(folder.recorded(self.scene, self.layout))
                if self.work:
                    self.settle()
                self.choose_extent(images)
                self.write_metadata()
                if not (self.is_worker or self.has_tables):
                    self.write_tables(sensors)
        try:
            if images:
                self.render()
            if images and not self.is_worker:
                self.finish()
            if self.summary.complete and not self.is_worker:
                with self.clock("checksums"), folder.planning(self.layout.root):
                    self.record.write_checksums()
        finally:
            self.write_log()

    def rendering(self) -> Progress:
        """How far the rendering is: a frame is one job, or one for each of several cameras."""
        unit = "frames" if len(self.layout.cameras) == 1 else "views"
        return self.console.progress("rendering", len(self.work), unit)

    def lacks_segments(self, images: bool) -> bool:
        """Return whether what tells what S means is to be made, though no image is."""
        outputs = {*(self.previous["outputs"] if self.previous else ()), *(self.scene.render.outputs if images else ())}
        return SEGMENTS in outputs and not self.layout.segments.exists()

    def say(self, message: str) -> None:
        """Tell the user, and keep it for the summary."""
        self.summary.messages.append(message)
        self.console.tell(f"note: {message}")

    def T_w_v(self, frame: int) -> np.ndarray:
        """Pose of the vehicle at a frame; for F, at the one after the last, too."""
        if frame < self.count:
            return self.simulation.frames.T_w_v(frame)
        return self.simulation.trajectory.at([frame_time_ns(frame, self.scene.render.frame_rate_hz)]).T_w_v(0)

    def motion(self, frame: int) -> Motion:
        """Motion of the vehicle around a frame."""
        return self.simulation.motion(frame_time_ns(frame, self.scene.render.frame_rate_hz))

    def find_work(self) -> None:
        """Find what this shard has to render."""
        self.work = list(self.store.missing(self.mine))
        self.summary.rendered += sum(len(job.letters) for job in self.work)
        wanted = len(self.mine) * len(self.layout.cameras) * len(self.scene.render.outputs)
        self.summary.kept = wanted - self.summary.rendered

    def compiling(self) -> contextlib.AbstractContextManager[None]:
        """Threads compile meanwhile, or load what is compiled; each worker does so on cores of its own."""
        if not self.work or self.renderer is not None:
            return contextlib.nullcontext()
        from varos_warp.render.kinds import compiling_foretold

        return compiling_foretold(self.scene, self.device, self.letters(), self.plan and self.plan.integrator)

    def letters(self) -> set[str]:
        """Letters of the images that are to be rendered."""
        return {letter for job in self.work for letter in job.letters}

    def choose_denoisers(self) -> None:
        """Find what really denoises, not what was asked for without pyoidn; earlier frames must have had it, too."""
        for letter, key in DENOISE_KEYS.items():
            if not any(OUTPUTS[made].settings == letter for job in self.work for made in job.letters):
                continue
            method, before = available_method(getattr(self.scene.render, key)), self.denoisers[letter]
            if before not in (None, method):
                raise InputError(
                    f"frames of {letter} in this folder were denoised with {before!r}, the next ones "
                    f"would be with {method!r}",
                    file=self.layout.metadata,
                    key=f"samples.{key}",
                    remedy="Go on where Open Image Denoise (pyoidn) is installed alike, or give another "
                    "folder with -o.",
                )
            self.denoisers[letter] = method

    def build(self) -> list:
        """Everything solid in the scene, built once."""
        from varos_warp.scene.geometry.build import build_parts

        if self.shared.parts is None:
            self.shared.parts = build_parts(self.scene)
        return self.shared.parts

    def load(self) -> None:
        """Load the scene onto the device, and warn of what looks wrong in it before hours are spent."""
        self.choose_denoisers()
        if self.renderer is None:
            from varos_warp.render.renderer import FrameRenderer
            from varos_warp.scene.checks import check_scene
            from varos_warp.sim.trajectory import path_samples

            parts, before = self.build(), self.shared.renderer
            making = (FrameRenderer, self.scene, self.device, parts) if before is None else (before.relit, self.scene)
            with beside(*making) as renderer:
                for warning in check_scene(self.scene, parts, path_samples(self.simulation)):
                    self.say(warning)
                self.renderer = self.shared.renderer = renderer.result()
        if self.renderer.device == "cpu":
            give_back_large_arrays()
        if SEGMENTS in self.scene.render.outputs and len(self.renderer.segments) > SEGMENT_LEVELS:
            raise InputError(
                f"{len(self.renderer.segments)} objects cannot be numbered in 16 bits",
                key="render.outputs",
                value=SEGMENTS,
                remedy="Leave out S, or scatter fewer"
                + ("; or leave out render.segments: fine" * (self.scene.render.segments == "fine"))
                + ".",
            )

    def settle(self) -> None:
        """Decide what is still open: denoisers, the device on record, which stays the first, and the plan."""
        self.choose_denoisers()
        here = {"name": self.renderer.device, "model": self.renderer.device_name}
        self.recorded_device = self.recorded_device or here | {"name": kind_of(here["name"])}  # a worker may be first
        words, first = ("{name} ({model})".format_map(device) for device in (here, self.recorded_device))
        self.summary.device = words
        if here["model"] != self.recorded_device["model"]:
            self.say(
                f"earlier frames were rendered on {first}, these are on {words}: pixels may differ in rounding; "
                "dataset.json keeps the first"
            )
        simd, first_simd = writers.simd(), (self.previous or {}).get("versions", {}).get("simd")
        if first_simd not in (None, simd):
            self.say(
                f"this dataset was begun on another kind of CPU ({first_simd}; here {simd}): the last digits of "
                "tables may differ, of images they do not; dataset.json keeps the first"
            )
        with self.clock("plan"):
            if self.plan is None or not self.plan.says_how(self.letters()):
                self.plan = self.make_plan()

    def make_plan(self) -> Plan:
        """What the planner chooses for the whole sequence."""
        from varos_warp.dataset.run.planning import kept_plan, plan_sequence, told_of, what_is_planned

        start = time.monotonic()
        if question := what_is_planned(self.scene):
            self.console.tell(f"planning {question} ...")
        # of the whole sequence, whichever part of it this run renders
        frames = self.simulation.frames
        plan = kept_plan(
            self.scene,
            self.renderer,
            frames,
            lambda: plan_sequence(self.scene, self.renderer, frames, self.simulation.motion, self.console.quiet),
        )
        first, *others = told_of(plan, self.scene.render.outputs) or [""]
        if first:
            self.say(f"planned in {time.monotonic() - start:.0f} s: {first}")
        for sentence in others:
            self.say(sentence)
        return plan

    def choose_extent(self, images: bool) -> None:
        """Frames and outputs that the dataset has or is to have."""
        before = self.previous["outputs"] if self.previous else []
        asked = self.scene.render.outputs if images else []
        self.outputs = [letter for letter in OUTPUTS if letter in before or letter in asked]
        frames = set(from_runs(self.previous["frames"]["ranges"])) if before else set()
        self.frames = sorted(frames | set(self.selected if images or not before else ()))

    def write_metadata(self) -> None:
        """What says whose folder this is, before anything else is written, and what it holds."""
        plan = self.plan and writers.with_models(self.plan, self.scene, self.outputs, self.denoisers)
        content = writers.describe(
            self.layout,
            self.scene,
            frames=self.frames,
            frame_count=self.count,
            outputs=self.outputs,
            device=self.recorded_device,
            plan=plan and plan.to_dict(),
            denoisers=self.denoisers,
            moving=describe_moving(self.scene, self.parts),
            lamp_gains=writers.lamp_gains_of(self.scene),
        )
        relief = {part.name: part.relief for part in self.parts or () if part.relief}
        if relief or (self.previous or {}).get("relief"):
            content["relief"] = relief or self.previous["relief"]
        if self.previous and self.previous["device"]:  # versions stay those that the first frame was rendered with
            content["versions"] = self.previous["versions"]
            if "noise" in content and self.previous.get("noise"):
                content["noise"]["versions"] = self.previous["noise"]["versions"]
        files.write_json(self.layout.metadata, content)
        if SEGMENTS in self.outputs and self.renderer is not None:
            files.write_json(self.layout.segments, {"0": "nothing", "segments": self.renderer.segments})

    def write_tables(self, sensors: bool) -> None:
        """Everything but the images and the metadata; long courses take seconds."""
        writers.write_readme(self.layout, self.scene, self.outputs)
        if sensors:
            tables.write_sensors(self.layout, self.scene, self.simulation)
        poses = np.array([self.T_w_v(frame) for frame in self.frames])
        time_ns = self.simulation.frames.time_ns[self.frames]
        for camera in self.scene.vehicle.cameras:
            tables.write_camera(
                self.layout, camera, self.frames, time_ns, poses, self.outputs, color_matrix(self.scene, camera)
            )
            if has_lens(camera) and not self.record.has(self.layout.rays(camera.id)):
                write_rays(self.layout, camera)
            if writers.has_row_poses(camera):
                tables.write_row_poses(self.layout, camera, self.frames, self.motion)
        tables.write_lights(self.layout, self.scene, self.frames, time_ns, poses)
        write_moving(self.layout, self.scene, time_ns)
        self.has_tables = True

    def render(self) -> None:
        """Render what is missing; `RunFailed` tells of images that could not be made."""
        if not self.work:
            return
        with self.rendering() as progress, self.renderer.compiling(self.letters(), self.plan.integrator):
            Pipeline(
                self.renderer,
                self.store,
                self.plan,
                self.T_w_v,
                self.motion,
                self.made,
                self.clock,
                progress.advance,
                self.say,
            ).run(self.work)
            self.summary.rate = round(progress.rate, 4)
        if self.made.failures:
            (job, error), *rest = self.made.failures
            more = f"; {len(rest)} more failed" if rest else ""
            raise RunFailed(
                f"frame {job.frame}, camera {job.camera} could not be made: {error}{more}. All others "
                "are; the same command tries again"
            ) from error

    def write_log(self) -> None:
        """Write when and how fast this run rendered, in the only file that differs from run to run."""
        seconds = self.clock.rounded()
        if self.made.timings:
            stamp = datetime.now(UTC)
            content = {
                "ended": stamp.isoformat(timespec="seconds"),
                "device": self.renderer.device,
                "model": self.renderer.device_name,
                "compile_seconds": round(self.renderer.compile_seconds, 3),
                "versions": writers.versions(),
                "stages": seconds,
                "messages": self.summary.messages,
                "frames": self.made.timings,
            }
            with contextlib.suppress(InputError):  # on a full disk, that is what the user is told of already
                files.write_json(
                    self.layout.root / "log" / f"{stamp:%Y%m%dT%H%M%S}_{files.HOST}_{os.getpid()}.json", content
                )
        if self.summary.rendered and not self.is_worker:
            words = [
                ", ".join(f"{stage} {seconds[stage]:.1f} s" for stage in stages if seconds[stage] >= 0.05)
                for stages in (MAIN, BESIDE)
            ]
            self.console.tell("time: " + "; beside it, in all threads: ".join(filter(None, words)))

    def finish(self) -> None:
        """Expose A, B and P once all frames asked for are rendered, and make the contact sheet."""
        for letter, count in self.made.clamped.items():
            if count:
                self.say(f"{count} values of {letter} above 65504 were cut to it in the EXR")
        for sentence in self.made.of_nothing(self.layout.cameras):
            self.say(sentence)
        self.record.reload()
        left = sum(len(job.letters) for job in self.store.missing(self.selected))
        self.summary.complete = left == 0
        if left:
            self.say(
                f"{left} images belong to other shards and are not there yet; the run that completes them (or "
                "any later one) exposes A and B and ends the dataset"
            )
            return
        with self.clock("expose"):
            for camera in self.scene.vehicle.cameras:
                for letter in colors(self.outputs):  # A before P
                    frames = [f for f in self.frames if self.record.has(self.layout.exr(camera.id, letter, f))]
                    expose(
                        self.layout,
                        self.scene,
                        camera.id,
                        letter,
                        frames,
                        self.simulation.frames.time_ns[frames],
                        self.made.statistics,
                        self.record.has,
                        camera_model(camera).axis_weight,
                    )
            from varos_warp.dataset.write.pictures import contact_sheet

            contact_sheet(Dataset(self.layout.root), self.layout.root / "contact_sheet.png")
