"""The cheapest plan that keeps the tolerance: which integrator renders A, and how many samples it takes.

Everything follows from a pilot (pilot.py): a few poses at low resolution. Errors are per channel, as relative RMSE of
an image: that of the field, and of noise and what a denoiser leaves. Times are measured for the cost only; nothing that
is chosen depends on them, so machines that share the work choose alike. docs/models.md says what is behind the numbers.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from varos_warp.render.field.open_water import unavailable
from varos_warp.render.image.adapt import brightness
from varos_warp.render.image.denoise import available_method, denoise_image
from varos_warp.render.options import resolve_integrator
from varos_warp.render.planner import by_frame, pilot
from varos_warp.render.planner.cost import sequence_cost
from varos_warp.render.planner.decisions import Decision, Plan, in_words, models_in_words
from varos_warp.render.planner.error_law import FEWEST_SPP, MOST_SPP, REACH, STEEPEST, ErrorLaw
from varos_warp.render.planner.pilot import View, pilot_camera
from varos_warp.scene.description import Scene
from varos_warp.scene.device import kind_of

CHANNELS = ("red", "green", "blue")

MARGIN, MARGIN_ADAPTING, MARGIN_DENOISED = 1.05, 1.1, 1.2
"""Samples are chosen for an error smaller by this factor: what a pilot says of it is not exact. The second is for
samples that adapt, and vary with the few that they adapt to; the third for images that are denoised, for what a
denoiser makes of little noise varies most from image to image. That is of images with `pilot.PIXELS`; of larger ones
the mean square of all pixels varies less, with the root of their number."""
FIELD_ERROR = 0.002
"""Relative RMSE of the field without noise: measured, docs/transport.md."""
SAMPLE_COST = {"field": 1.7, "path": 1.0}
"""Time of a sample of the one integrator over that of the other: about as measured in unlike scenes, and the same on
every machine, so that machines that share the work choose alike."""
PATHS_PAY = 0.8
"""Paths alone are taken where they need at most this share of the work: two images tell it only so well, and of about
equal ones those with the field have fewer rare bright samples."""
COMPARED_SPP, RARE_COUNTS = 8, 2.0
"""Samples per pixel of the images by which integrators are compared; and how many times less the work that noise before
denoising asks for counts, for a denoiser takes most of it."""
NOMINAL_SECONDS = {"cpu": 12e-6, "cuda": 50e-9}
"""Of a sample of a pixel with the field, two cores or a large GPU: what `max_seconds_per_frame` is told by, for the
same reason."""
MOST_SECONDS = {"cpu": 60.0, "cuda": 5.0}
"""`max_seconds_per_frame` where the scene says nothing."""
FIRST_GUESS = {"field": 2, "path": 4, "reference": 16}
"""Samples per pixel of the first images that are judged; if far from what is needed, others are."""
LEVELS = (1, 2, 4)
"""Images are judged with so many times as many samples,"""
JUDGE_LEVEL = 8
"""by others with so many times as many,"""
FEWEST_JUDGES, MOST_JUDGES, MOST_JUDGING = 2, 16, 512
"""of which there are more until they tell the square of an error (`pilot.JUDGED_TO`), or have so many samples per pixel
together."""
IMAGES = 4
"""Images that are judged at each level, of which the worst counts: what rare bright samples and a denoiser leave varies
from one to the next, and a tolerance is to hold for nearly all."""
MOST_JUDGED = 32
"""Samples per pixel of the first image that is judged, at most."""
ROUNDS = 3
FEWEST_ADAPTIVE = 16
"""With fewer samples per pixel, there is nothing to adapt."""
MOST_REHEARSED, PAYS = 1024, 0.8
"""Up to so many samples images that adapt them are tried, and samples adapt if the error is so much less than with as
many everywhere: in rounds and uneven tiles a GPU takes up to 1.8 times longer for a sample (measured at 320x180)."""


def plan_render(scene: Scene, renderer, poses: Sequence[np.ndarray], *, measure_cost: bool = False) -> Plan:
    """Choose integrator and samples for a sequence; what the scene file fixes stays as it is.

    Args:
        scene: The scene.
        renderer: A `FrameRenderer` of it.
        poses: T_w_v [4, 4] of every frame.
        measure_cost: Also measure how long it will take on this device.
    """
    planner = _Planner(scene, renderer, poses)
    plan = planner.plan()
    cost = sequence_cost(scene, renderer, poses, plan) if measure_cost else None
    return replace(plan, models=models_in_words(scene, plan), cost=cost)


class _Planner:
    """Takes one decision after the other; each knows those before it."""

    def __init__(self, scene: Scene, renderer, poses):
        self.scene, self.renderer, self.poses = scene, renderer, poses
        self.render = scene.render
        self.decisions: list[Decision] = []
        self.models = np.zeros(3)
        """Sum of the errors of models so far."""
        self.integrator = self.render.integrator
        self.spp_by_frame: dict | None = None

    def plan(self) -> Plan:
        """All decisions."""
        render = self.render
        if "A" in render.outputs:
            self.choose_integrator()
            spp, tolerance = self.choose_samples()
        else:  # nothing else pays for water
            self.decide("A", "none", "it is not among the outputs")
            spp, tolerance = render.spp or FEWEST_SPP, None
        return Plan(spp, render.max_scatterings, render.max_bounces, self.integrator, tolerance, self.spp_by_frame,
                    self.decisions)

    def decide(self, what: str, choice, reason: str, error=None) -> None:
        """Keep a decision."""
        self.decisions.append(Decision(what, str(choice), reason, None if error is None else tuple(map(float, error))))
        if error is not None:
            self.models = self.models + error

    # ------------------------------------------------------------------------------------------------------ the pilot

    @cached_property
    def views(self) -> list[View]:
        """What the scout found."""
        return list(pilot.scout(self.scene, self.renderer, self.poses))

    @property
    def lit(self) -> bool:
        """Whether any pose that was looked at sees light."""
        return max(view.image.radiance.max() for view in self.views) > 0.0

    @cached_property
    def worst(self) -> View:
        """The view in which most noise is left."""
        method = available_method(self.render.denoise)
        return max(self.views, key=lambda view: pilot.scouted_noise(view, method).max())

    @property
    def pixels(self) -> int:
        """Of the images in which errors are measured."""
        return pilot.judged_pixels(self.worst.given_camera, len(self.poses))

    @property
    def integrators(self) -> set[str]:
        """What renders A, over the cameras."""
        return {resolve_integrator(self.scene, camera, self.integrator, self.render.max_scatterings)
                for camera in self.scene.vehicle.cameras}

    @property
    def steepest(self) -> float:
        """Exponent of the error in the samples, at the least."""
        return min(STEEPEST[name] for name in self.integrators)

    def image(self, spp: int, number: int = 0, place: tuple | None = None, **changes):
        """An image A with what has been chosen so far; each ``number`` has its own random numbers.

        The ``place`` is T_w_v and the camera; absent: those of the worst view.
        """
        T_w_v, given = place or (self.worst.T_w_v, self.worst.given_camera)
        how = {"max_scatterings": self.render.max_scatterings, "max_bounces": self.render.max_bounces, "spp": spp,
               "integrator": self.integrator, "layers": tuple(self.render.layers)} | changes
        return self.renderer.render(T_w_v, pilot_camera(given, self.pixels), "A", seed=pilot.SEED + number, **how).A

    @property
    def first_spp(self) -> int:
        """Samples per pixel of the first images: far fewer than will be needed."""
        return min(FIRST_GUESS[name] for name in self.integrators)

    # ------------------------------------------------------------------------------------------------------ decisions

    def choose_integrator(self) -> None:
        """The one that takes least time for the same error; paths alone where the field is not right enough."""
        asked, found = self.render.integrator, self.integrators
        words = " and ".join(sorted(found))
        if "field" not in found:
            return self.decide("integrator", words, "given" if asked == words else self.why_no_field(), np.zeros(3))
        if asked == "auto" and 2.0 * FIELD_ERROR > self.render.tolerance:
            self.integrator = "path"
            return self.decide("integrator", "path", f"the field of open water is right to {FIELD_ERROR:.1%} only",
                               np.zeros(3))
        why = "given"
        if asked == "auto":
            why = "light in open water is known beforehand"
            if self.lit and self.renderer.world.has_surfaces:
                gain = self.gain_of_field()
                if gain < PATHS_PAY:
                    self.integrator = "path"
                    return self.decide("integrator", "path", "in this scene the field of open water helps little: "
                                       f"paths alone take {gain:.2g} of the time for the same noise", np.zeros(3))
                why = f"{why}: paths alone would take about {gain:.2g} times as long for the same noise"
        return self.decide("integrator", words, why, np.full(3, FIELD_ERROR))

    def gain_of_field(self) -> float:
        """How many times the work of the field paths alone need, in the noisiest view.

        By the noise that a denoiser leaves. But two denoised images seldom show rare bright samples, of which paths
        alone have more, with a lamp in view most: so they are not taken where they are much noisier before it.
        """
        after, before = self.work("path") / np.maximum(self.work("field"), 1e-30)
        return float(max(after, before / RARE_COUNTS))

    def work(self, name: str) -> np.ndarray:
        """Squares of the noise after and before denoising, times the time, in the noisiest view with an integrator."""
        pair = pilot.twins(self.renderer, self.worst, spp=COMPARED_SPP, integrator=name,
                           max_bounces=self.render.max_bounces, layers=tuple(self.render.layers))
        noise = np.array([pilot.scouted_noise(pair, method, rare=0.0).max()
                          for method in (available_method(self.render.denoise), "none")])
        return noise**2 * pair.image.spp * SAMPLE_COST[name]

    def why_no_field(self) -> str:
        """In words."""
        if self.render.max_scatterings is not None:
            return "the field holds all orders of scattering, and a bound is given"
        why = {unavailable(self.scene, camera) for camera in self.scene.vehicle.cameras} - {None}
        return "; ".join(sorted(why))

    # -------------------------------------------------------------------------------------------------------- samples

    def choose_samples(self) -> tuple[int, float | None]:
        """Samples per pixel, and the standard error at which tiles stop."""
        if self.render.spp is not None:
            self.decide("spp", self.render.spp, "given")
            return self.render.spp, None
        if not self.lit:
            self.decide("spp", FEWEST_SPP, "no light was found, and no fewer are taken", np.zeros(3))
            return FEWEST_SPP, None
        target = np.sqrt(self.render.tolerance**2 - min(self.models.max(), 0.9 * self.render.tolerance) ** 2)
        varies = available_method(self.render.denoise) != "none"
        margin = max(MARGIN, 1.0 + (MARGIN_DENOISED - 1.0) * np.sqrt(pilot.PIXELS / self.pixels)) if varies else MARGIN
        law = self.error_law(target / margin)
        spp = law.whole_samples(target / margin)
        adapting = None
        if "field" not in self.integrators and FEWEST_ADAPTIVE <= spp <= MOST_REHEARSED:
            adapting = self.adapting(law, spp)
        if adapting is not None:
            law, margin = adapting, MARGIN_ADAPTING
            spp = max(law.whole_samples(target / margin), spp // 2)
        needed = law.samples(target / margin)
        most = self.most_spp()
        if max(spp, needed) > most:
            adapting, spp = None, min(spp, most)
            self.tell_shortfall(margin * law.error(spp).max(), needed)
        self.decide("spp", spp, self.why_spp(law, needed, target), margin * law.error(spp))
        if adapting is not None:  # to each frame, too
            return spp, _round(law.noise(spp).max())
        return self.choose_by_frame(spp, target / margin), None

    def seconds(self, spp: float) -> float:
        """About how long an image of the largest camera takes with so many samples per pixel."""
        pixels = max(np.prod(camera.resolution) for camera in self.scene.vehicle.cameras)
        cost = max(SAMPLE_COST.get(name, 1.0) for name in self.integrators) / SAMPLE_COST["field"]
        return float(pixels * spp * cost * NOMINAL_SECONDS[kind_of(self.renderer.device)])

    def most_spp(self) -> int:
        """Samples per pixel that an image may take."""
        limit = self.render.max_seconds_per_frame or MOST_SECONDS[kind_of(self.renderer.device)]
        return int(np.clip(limit / self.seconds(1), FEWEST_SPP, MOST_SPP))

    def tell_shortfall(self, error: float, needed: int) -> None:
        """Say first that the tolerance is not kept."""
        asked = self.render.tolerance
        limit = self.render.max_seconds_per_frame or MOST_SECONDS[kind_of(self.renderer.device)]
        time = in_words(self.seconds(needed))
        error, asked = (f"{100 * share:.2g} %" for share in (error, asked))
        why = (f"{error} expected, {asked} asked; {asked} would take {time} a frame "
               f"(render.max_seconds_per_frame: {limit:g})")
        self.decisions.insert(0, Decision("tolerance", "NOT kept", why))

    def choose_by_frame(self, spp: int, target: float) -> int:
        """To each frame what it needs, where the worst view needs ``spp``; the most of them."""
        worst, count = self.worst, len(self.poses)
        judged = pilot_camera(worst.given_camera, self.pixels)
        frames = by_frame.judged_frames(count, np.prod(judged.resolution) / np.prod(worst.given_camera.resolution))
        if not frames or spp < by_frame.FEWER[0]:
            return spp
        method = available_method(self.render.denoise)
        cameras = {camera.id: camera for camera in self.scene.vehicle.cameras}

        def image(view, spp, number, denoised):
            camera, frame = view
            how = {"denoise": method, "denoised_only": True} if denoised else {}
            made = self.image(spp, number, place=(self.poses[frame], cameras[camera]), **how)
            return made.denoised if denoised else made.radiance

        views = [(camera, frame) for camera in cameras for frame in frames]
        needed = by_frame.samples_along(image, views, {(worst.camera.id, worst.frame): spp}, target, self.steepest)
        most = self.most_spp()
        given = self.spp_by_frame = by_frame.knots({view: min(count, most) for view, count in needed.items()})
        mean = np.mean([by_frame.mean_spp({"spp_by_frame": given}, camera, count) for camera in cameras])
        least, most = by_frame.extent(given)
        self.decide("spp by frame", f"{least} to {most}", f"{mean:.3g} on average: frames take what {len(needed)} "
                    "views need, and those between about as much")
        return most

    def adapting(self, law: ErrorLaw, spp: int) -> ErrorLaw | None:
        """The law of images that adapt their samples to ``spp`` and the noise it leaves; None if that does not pay."""
        method, first = available_method(self.render.denoise), IMAGES * len(LEVELS) + MOST_JUDGES
        images = [self.image(spp, first + k, tolerance=_round(law.noise(spp).max())) for k in range(IMAGES)]
        found = pilot.error([denoise_image(image, method) for image in images], law.judges)
        as_many = law.error(np.mean([image.spp for image in images]))
        if not np.all(found <= PAYS * as_many):
            return None
        asked = law.error(spp)
        return replace(law, measured=law.measured * np.divide(found, asked, out=np.ones(3), where=asked > 0.0))

    def error_law(self, target: float) -> ErrorLaw:
        """How the error falls with the samples: from images with about as many as are needed."""
        spp = self.first_spp
        for _ in range(ROUNDS):
            law = self.judged(spp)
            needed = law.samples(target)
            better = min(max(needed // LEVELS[-1], self.first_spp), MOST_JUDGED)
            if needed <= REACH * law.spp[-1] or better <= spp:
                break
            spp = better
        return law

    def judged(self, first: int) -> ErrorLaw:
        """Errors of images with a few times ``first`` samples, as other images judge them."""
        method = available_method(self.render.denoise)
        levels = [first * level for level in LEVELS]
        images = [[self.image(spp, IMAGES * k + i) for i in range(IMAGES)] for k, spp in enumerate(levels)]
        filtered = images if method == "none" else [
            [replace(image, radiance=denoise_image(image, method)) for image in level] for level in images]
        judges = self.judges(JUDGE_LEVEL * first, [image.radiance for image in filtered[-1]])
        noisy = np.array([pilot.error([image.radiance for image in level], judges) for level in images])
        left = np.array([np.max([pilot.error([image.radiance], judges) for image in level], axis=0)
                         for level in filtered])
        return ErrorLaw(levels, left, noisy, judges, self.steepest)

    def judges(self, spp: int, images: list[np.ndarray]) -> list[np.ndarray]:
        """Independent images of ``spp`` samples, as many as it takes to judge the given ones."""
        taken, judges = IMAGES * len(LEVELS), []
        while len(judges) < FEWEST_JUDGES or (len(judges) < MOST_JUDGES and len(judges) * spp < MOST_JUDGING):
            judges.append(self.image(spp, taken + len(judges)).radiance)
            if len(judges) >= FEWEST_JUDGES:
                square, unsure = pilot.squared_error(images, judges)
                worst = np.argmax(square / np.maximum(brightness(np.mean(judges[0], axis=(0, 1))), 1e-30) ** 2)
                if unsure[worst] <= pilot.JUDGED_TO * square[worst]:
                    break
        return judges

    def why_spp(self, law: ErrorLaw, needed: int, target: float) -> str:
        """The choice in words."""
        channel = CHANNELS[int(np.argmax(law.measured[-1]))]
        method = available_method(self.render.denoise)
        left = f" after {method}" if method != "none" else ""
        words = (f"{law.spp[-1]} samples leave an error of {law.measured[-1].max():.2%}{left} ({channel}, "
                 f"{self.worst.label}), and {target:.2%} of the {self.render.tolerance:.2%} asked for are left for it")
        return f"{words}; no fewer are taken" if needed <= FEWEST_SPP else words


def _round(x: float) -> float:
    """To two digits: machines that round differently agree on them nearly always."""
    return float(f"{x:.2g}")
