"""The cheapest plan that keeps the tolerance: which integrator renders A, and how many samples it takes.

Everything follows from a pilot (pilot.py): a few poses at low resolution. Errors are per channel, as relative RMSE of
an image (errors.py): that of the field, and of noise and what a denoiser leaves. Times are measured for the cost only;
nothing that is chosen depends on them, so machines that share the work choose alike. docs/models.md says how plans are
made, and what is behind the numbers.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from varos_warp.device.devices import kind_of
from varos_warp.device.launcher import at_once
from varos_warp.errors import InputError, duration
from varos_warp.render.decisions import (
    FIELD_ERROR,
    Decision,
    Plan,
    extent,
    given_integrator,
    models_in_words,
    plan_as_given,
    spp_between,
)
from varos_warp.render.field.open_water import unavailable
from varos_warp.render.image.adapt import brightness
from varos_warp.render.image.denoise import available_method, denoisers_of
from varos_warp.render.kinds import sample_step
from varos_warp.render.moments import Motion
from varos_warp.render.options import of_scene, resolve_integrator
from varos_warp.render.planner import by_frame, errors, pilot
from varos_warp.render.planner.cost import sequence_cost
from varos_warp.render.planner.errors import MOST_SPP, REACH, SAMPLES, ErrorLaw, Made, Samples
from varos_warp.render.planner.pilot import Frames, View, pilot_camera
from varos_warp.scene.block import plain_number
from varos_warp.scene.description import Scene
from varos_warp.scene.description.image_types import WATER
from varos_warp.scene.description.render import sees_water
from varos_warp.scene.frames import checked_poses
from varos_warp.scene.optics.pinhole import port_worth

STEPS = ("views", "integrator", "samples", "more samples", "samples by frame", "time")
"""Steps of planning, for progress reports; the fourth occurs where the first test images had far too few samples."""

MARGIN, MARGIN_DENOISED = 1.05, 1.2
"""Samples are chosen for an error smaller by this factor, for a pilot knows it only roughly. The second is for denoised
images of `pilot.PIXELS`, whose errors vary most; of larger ones they vary less, with the root of the pixels."""
SAMPLE_COST = {"field": 1.7, "path": 1.0}
"""Relative time of a sample, about as measured in unlike scenes; constant, so that machines that share the work choose
alike."""
PATHS_PAY = 0.8
"""Paths alone are taken where they need at most this share of the work: two images tell it only so well, and with the
field there are fewer rare bright samples."""
COMPARED_SPP, RARE_COUNTS = 4, 2.0
"""Samples per pixel of the images by which integrators are compared; and how many times less the work by noise before
denoising counts than that by noise after it, for a denoiser takes most of it."""
NOMINAL_SECONDS = {"cpu": 16e-6, "cuda": 40e-9}
"""Time of a sample of a pixel with the field, on two cores or a large GPU; constant for the same reason."""
MOST_SECONDS = {"cpu": 60.0, "cuda": 5.0}
"""`max_seconds_per_frame` where the scene says nothing."""
LEVELS, MOST_TRIED = 3, 128
"""Numbers of samples, each twice the last, whose errors make a law; and the most samples per pixel that are tried. Two
numbers are enough where the second keeps the tolerance."""
ESTIMATE_LEVEL = 2
"""Samples of estimates that help to tell errors, as a multiple of the most that were tried."""
MOST_ESTIMATES, MOST_ESTIMATING = 16, 512
"""Test images tell each other's errors, and estimates are added until the square of an error is known
(`errors.PRECISE`), or they are as many as the first, or have as many samples per pixel together as the second."""
IMAGES = 4
"""Test images of each level. The worst counts: what rare bright samples and a denoiser leave varies from one image to
the next, and a tolerance is to hold for nearly all."""


def silently(step: str, share: float) -> None:
    """Tells nobody how far planning is."""


def plan_render(
    scene: Scene,
    renderer,
    poses: Sequence[np.ndarray],
    *,
    time_ns: Sequence[int] | None = None,
    motion: Callable[[int], Motion] | None = None,
    measure_cost: bool = False,
    progress: Callable[[str, float], None] = silently,
) -> Plan:
    """Choose integrator and samples for a sequence; what the scene file fixes stays as it is.

    Args:
        scene: The scene.
        renderer: A `FrameRenderer` of it.
        poses: T_w_v [4, 4] of every frame.
        time_ns: When each is [ns]; absent: at the scene's frame rate, from 0.
        motion: Of the vehicle around a time, for cameras with a shutter (`Simulation.motion`); absent: nothing is
            blurred.
        measure_cost: Also measure how long it will take on this device.
        progress: Told which step is at work (`STEPS`), and what share of it is done.

    Raises:
        InputError: If the tolerance is not above 0, a pose is none, or the field is asked for by name and there is
            none.
    """
    if not scene.render.tolerance > 0.0:
        raise InputError("must be above 0", key="render.tolerance", value=scene.render.tolerance)
    frames = Frames.of(scene, renderer, checked_poses("poses", poses), time_ns, motion)
    plan = Planner(scene, frames, progress).plan()
    if measure_cost:
        progress("time", 0.0)
    cost = sequence_cost(scene, frames, plan) if measure_cost else None
    denoisers = denoisers_of(scene.render)
    models = models_in_words(scene, plan, scene.render.outputs, denoisers)
    return replace(plan, models=models, cost=cost)


class Planner:
    """Takes one decision after the other; each knows those before it."""

    def __init__(self, scene: Scene, frames: Frames, progress: Callable[[str, float], None] = silently):
        self.scene, self.renderer, self.frames, self.progress = scene, frames.renderer, frames, progress
        self.render, self.integrator = scene.render, scene.render.integrator
        self.decisions: list[Decision] = []
        self.spp_by_frame: dict | None = None
        self.failed = False
        """True if the field that the scene might have was found not to be solved for."""

    def plan(self) -> Plan:
        """Plan with all decisions."""
        render = self.render
        if sees_water(render.outputs):
            self.choose_integrator()
            spp = self.choose_samples()
        else:
            given = plan_as_given(self.scene)
            spp, self.decisions = given.spp, given.decisions
        self.weigh_ports()
        return Plan(spp, render.max_scatterings, render.max_bounces, self.integrator, self.spp_by_frame, self.decisions)

    def decide(self, what: str, choice, reason: str, error=None) -> None:
        """Keep a decision."""
        self.decisions.append(Decision(what, str(choice), reason, None if error is None else tuple(map(float, error))))

    def weigh_ports(self) -> None:
        """Say what each port is worth; nothing that is rendered depends on it."""
        for camera in self.scene.vehicle.cameras:
            if camera.port is not None and len(distances := pilot.distances_seen(self.frames, camera)):
                worth = port_worth(camera, distances)
                self.decide(f"port of {camera.id}", "not needed" if worth.pinhole else "needed", worth.in_words)

    # ------------------------------------------------------------------------------------------------------ the pilot

    @cached_property
    def denoiser(self) -> str:
        """What A is denoised with."""
        return available_method(self.render.denoise)

    @cached_property
    def views(self) -> list[View]:
        """Views that the pilot renders."""
        count, seen = len(pilot.pilot_frames(len(self.frames))) * len(self.scene.vehicle.cameras), []
        self.progress("views", 0.0)
        integrator = "path" if self.failed else self.render.integrator
        for view in pilot.pilot_views(self.scene, self.frames, integrator):
            seen.append(view)
            self.progress("views", len(seen) / count)
        return seen

    @property
    def lit(self) -> bool:
        """True if any of these poses sees light."""
        return max(view.images[0].radiance.max() for view in self.views) > 0.0

    @cached_property
    def worst(self) -> View:
        """The view in which most noise is left."""
        return max(self.views, key=lambda view: view.noise(self.denoiser).max())

    @cached_property
    def test_camera(self):
        """The worst view's camera with the pixels in which errors are measured."""
        return pilot_camera(self.worst.camera, pilot.pixels_tried(self.worst.camera, len(self.frames)))

    @cached_property
    def no_field(self) -> str | None:
        """Why the scene has no field."""
        return unavailable(self.scene)

    @property
    def failure(self) -> str | None:
        """Why the field that the scene may have cannot be solved for; None if it can, or is not looked at."""
        return self.renderer.field_failure if "multiple" in self.render.layers else None

    @property
    def resolved(self) -> str:
        """The integrator that renders A by what has been chosen so far."""
        return resolve_integrator(self.integrator, self.render.max_scatterings, lambda: self.no_field)

    @property
    def samples(self) -> Samples:
        """Which numbers of samples may be planned, and what they do."""
        cameras, with_field = self.scene.vehicle.cameras, self.resolved == "field"
        return SAMPLES[self.resolved].in_multiples(max(sample_step(camera, with_field) for camera in cameras))

    def image(self, frame: int, camera, spp: float, number: int = 0, **changes):
        """An image A with what has been chosen so far; each ``number`` has its own random numbers."""
        how = of_scene(self.scene) | {"spp": spp, "integrator": self.integrator, "snow": False} | changes
        return self.frames.render(frame, camera, WATER, seed=pilot.SEED + number, **how).A

    @property
    def at_once(self) -> Callable[..., Iterator]:
        """``map`` for functions that render."""
        return partial(at_once, self.renderer.device)

    def made(self, frame: int, camera, spp: float, number: int, denoised: bool) -> Made:
        """A test image to tell errors by, and what the denoiser makes of it."""
        copied = ["radiance", "denoised"] if denoised else ["radiance"]
        image = self.image(frame, camera, spp, number, denoise=self.denoiser if denoised else "none", copied=copied)
        return Made(spp, image.radiance, image.denoised if denoised else None)

    # ------------------------------------------------------------------------------------------------------ decisions

    def choose_integrator(self) -> None:
        """The one that takes least time for the same error; paths alone where the field is not right enough."""
        asked, found = self.render.integrator, self.resolved
        if found == "field" and asked == "auto":
            if 2.0 * FIELD_ERROR > self.render.tolerance:
                return self.take_paths(f"the field of open water is right to {FIELD_ERROR:.1%} only")
            if failure := self.failure:
                self.failed = True
                return self.take_paths(failure)
            why = "light in open water is known beforehand"
            if self.lit and self.renderer.world.spec.surfaces:
                self.progress("integrator", 0.0)
                gain = self.gain_of_field()
                if gain < PATHS_PAY:
                    return self.take_paths(
                        "in this scene the field of open water helps little: "
                        f"paths alone take {gain:.2g} of the time for the same noise"
                    )
                why = f"{why}: paths alone would take about {gain:.2g} times as long for the same noise"
            return self.decide("integrator", found, why, np.full(3, FIELD_ERROR))
        if found == "field" and (failure := self.failure):
            resolve_integrator(asked, None, lambda: failure)  # refuses it
        return self.decisions.append(given_integrator(self.scene))

    def take_paths(self, why: str) -> None:
        """Do without the field."""
        self.integrator = "path"
        self.decide("integrator", "path", why, np.zeros(3))

    def gain_of_field(self) -> float:
        """How many times the work of the field paths alone need, in the noisiest view.

        By the noise that a denoiser leaves. But two denoised images seldom show rare bright samples, of which paths
        alone have more, with a light in view most: so they are not taken where they are much noisier before it.
        """
        after, before = self.work("path") / np.maximum(self.work("field"), 1e-30)
        return float(max(after, before / RARE_COUNTS))

    def work(self, name: str) -> np.ndarray:
        """Squares of the noise after and before denoising, times the time, in the noisiest view with an integrator."""
        camera = pilot_camera(self.worst.camera)
        images = tuple(self.image(self.worst.frame, camera, COMPARED_SPP, k, integrator=name) for k in range(2))
        pair = replace(self.worst, images=images)
        noise = np.array([pair.noise(method, rare=0.0).max() for method in (self.denoiser, "none")])
        return noise**2 * images[0].spp * SAMPLE_COST[name]

    # -------------------------------------------------------------------------------------------------------- samples

    def choose_samples(self) -> float:
        """Samples per pixel, of the frames that need most."""
        asked = self.render.tolerance
        if self.render.spp is not None:
            self.decide("spp", self.render.spp, "given")
            return self.render.spp
        if not self.lit:
            self.decide("spp", self.samples.fewest, "no light was found, and no fewer are taken", np.zeros(3))
            return self.samples.fewest
        known = max(self.decisions[-1].error)
        left = asked * np.sqrt(1.0 - min(known / asked, 0.9) ** 2)
        target = left / self.margin
        law = self.error_law(target)
        needed, most = law.samples(target), self.most_spp()
        spp = min(self.samples.rounded(needed), most)
        if needed > most:
            self.tell_shortfall(self.margin * law.error(spp).max(), needed)
        self.decide("spp", spp, self.why_spp(law, needed, left), self.margin * law.error(spp))
        return self.choose_by_frame(spp, target)

    @property
    def margin(self) -> float:
        """Factor by which errors are to be smaller than asked."""
        if self.denoiser == "none":
            return MARGIN
        pixels = pilot.pixels_tried(self.worst.camera, len(self.frames))
        return max(MARGIN, 1.0 + (MARGIN_DENOISED - 1.0) * np.sqrt(pilot.PIXELS / pixels))

    def seconds(self, spp: float) -> float:
        """Approximate seconds for an image of the largest camera with so many samples per pixel."""
        pixels = max(np.prod(camera.resolution) for camera in self.scene.vehicle.cameras)
        cost = SAMPLE_COST.get(self.resolved, 1.0) / SAMPLE_COST["field"]
        return float(pixels * spp * cost * NOMINAL_SECONDS[kind_of(self.renderer.device)])

    @property
    def most_seconds(self) -> float:
        """Seconds that an image may take."""
        return self.render.max_seconds_per_frame or MOST_SECONDS[kind_of(self.renderer.device)]

    def most_spp(self) -> float:
        """Samples per pixel that an image may take."""
        step, most = self.samples.step, min(self.most_seconds / self.seconds(1), MOST_SPP)
        return plain_number(max(step * np.floor(most / step), self.samples.fewest))

    def tell_shortfall(self, error: float, needed: float) -> None:
        """Say first that the tolerance is not kept."""
        error, asked = (f"{100 * share:.2g} %" for share in (error, self.render.tolerance))
        why = (
            f"{error} expected, {asked} asked; {asked} would take {duration(self.seconds(needed))} a frame "
            f"(render.max_seconds_per_frame: {self.most_seconds:g})"
        )
        self.decisions.insert(0, Decision("tolerance", "NOT kept", why))

    def choose_by_frame(self, spp: float, target: float) -> float:
        """Give each frame the samples that it needs, where the worst view needs ``spp``; return the highest number."""
        worst, count = self.worst, len(self.frames)
        # all images have as many pixels as those in which errors were measured
        pixels = np.prod(self.test_camera.resolution)
        cameras = {given.id: pilot_camera(given, pixels) for given in self.scene.vehicle.cameras}
        frames = by_frame.tried_frames(count, pixels / np.prod(worst.camera.resolution))
        if not frames or spp < by_frame.first_guess(self.samples):
            return spp
        self.progress("samples by frame", 0.0)

        def image(view, spp, number, denoised):
            name, frame = view
            return self.made(frame, cameras[name], spp, number, denoised)

        views = [(name, frame) for name in cameras for frame in frames]
        needed = by_frame.samples_along(
            image, views, ((worst.camera.id, worst.frame), spp), target, self.samples, self.at_once
        )
        most = self.most_spp()
        given = self.spp_by_frame = by_frame.knots({view: min(count, most) for view, count in needed.items()})
        mean = np.mean([spp_between(given[name], frame) for name in cameras for frame in range(count)])
        least, most = extent(given)
        self.decide(
            "spp by frame",
            f"{least} to {most}",
            f"{mean:.3g} on average: frames take what {len(needed)} views need, and those between about as much",
        )
        return most

    def error_law(self, target: float) -> ErrorLaw:
        """How the error falls with the samples: from test images with twice as many, again and again, until they tell.

        A few of each number tell each other's errors; `errors.Made`.
        """
        made, levels, law = [], [], None
        self.progress("samples", 0.0)
        while law is None or not self.reaches(law, target):
            levels.append(plain_number(2 * levels[-1]) if levels else self.samples.fewest)
            self.try_samples(levels[-1], made, IMAGES)
            if len(levels) > 1:
                law = self.law_of(levels, made, 1)
                if self.reaches(law, target):  # as one image of each number says
                    self.know_error(levels[-1], made)
                    law = self.law_of(levels, made, IMAGES)
        return law

    def try_samples(self, spp: float, made: list[Made], count: int, denoised: bool = True) -> None:
        """Add test images of the noisiest view."""
        frame, camera, often = self.worst.frame, self.test_camera, IMAGES * self.samples.fewest * (2**LEVELS - 1)
        numbers = range(len(made), len(made) + count)
        for one in self.at_once(lambda number: self.made(frame, camera, spp, number, denoised), numbers):
            made.append(one)
            done = sum(one.spp for one in made)
            step = ("samples", done / often) if done <= often else ("more samples", 1.0 - often / done)
            self.progress(*step)

    def reaches(self, law: ErrorLaw, target: float) -> bool:
        """Return whether the samples that were tried tell how many keep the target: they are enough, or nearly."""
        if len(law.spp) < LEVELS:
            return law.measured[-1].max() <= target
        return law.samples(target) <= REACH * law.spp[-1] or law.spp[-1] >= MOST_TRIED

    def law_of(self, levels: list[float], made: list[Made], count: int) -> ErrorLaw:
        """Error law by the worst of ``count`` denoised images of each of the last numbers of samples.

        All images that were made tell these errors.
        """
        last = levels[-LEVELS:]
        tried = [[one for one in made if one.spp == spp and one.denoised is not None][:count] for spp in last]
        return ErrorLaw(last, errors.worst_errors(tried, made), self.samples.steepest)

    def know_error(self, spp: float, made: list[Made]) -> None:
        """Add estimates until those that were made tell the error of the denoised images with ``spp`` samples."""
        images = [one for one in made if one.spp == spp and one.denoised is not None]
        each, added = ESTIMATE_LEVEL * spp, 0
        most = int(min(MOST_ESTIMATES, -(-MOST_ESTIMATING // each)))
        while added < most and not self.is_told(images, made):  # which takes its time: after 0, 1, 2, 4 ...
            more = min(max(added, 1), most - added)
            self.try_samples(each, made, more, denoised=False)
            added += more

    def is_told(self, images: list[Made], made: list[Made]) -> bool:
        """Return whether the square of the error of images is known, by all that were made."""
        square, unsure = errors.mean_square(images, made)
        worst = np.argmax(square / np.maximum(brightness(errors.mean_of(made[0].radiance)), 1e-30) ** 2)
        return bool(unsure[worst] <= errors.PRECISE * square[worst])

    def why_spp(self, law: ErrorLaw, needed: float, left: float) -> str:
        """The choice of samples, in words."""
        channel = ("red", "green", "blue")[int(np.argmax(law.measured[-1]))]
        after = f" after {self.denoiser}" if self.denoiser != "none" else ""
        words = (
            f"{law.spp[-1]:g} samples leave an error of {law.measured[-1].max():.2%}{after} ({channel}, "
            f"{self.worst.label}), and {left:.2%} of the {self.render.tolerance:.2%} asked for are left for it"
        )
        return f"{words}; no fewer are taken" if needed <= self.samples.fewest else words
