"""Samples by frame: the poses that are tried, what each needs, and what the frames between them take."""

import numpy as np
import pytest

from tests.render.planner.test_plan import POSE, make_renderer, make_scene
from varos_warp.render.decisions import Plan
from varos_warp.render.planner import by_frame, pilot
from varos_warp.render.planner.by_frame import (
    halfway,
    knots,
    need,
    samples_along,
    samples_needed,
    trial,
    tried_frames,
)
from varos_warp.render.planner.errors import SAMPLES, Made, error, of_others, squared_error
from varos_warp.render.planner.plan import plan_render

FIELD = SAMPLES["field"]
A_POSE = sum(1.0 / fewer for fewer in by_frame.FEWER)
"""What trying one costs, in images of an image's samples."""


@pytest.mark.parametrize(
    ("count", "pixels", "poses"),
    [
        (4713, 1.0, 33),  # as many as there ever are
        (200, 0.8, 11),  # 7 % of 200 frames are 14, for 1.4 a pose
        (60, 1.0, 0),  # too few to pay
        (1, 1e-6, 0),
    ],
)
def test_tried_frames_are_spread_evenly_and_cost_little(count, pixels, poses):
    frames = tried_frames(count, pixels)
    assert len(frames) == poses
    assert (poses - 1) * A_POSE * pixels <= by_frame.SHARE * count
    if frames:
        assert (frames[0], frames[-1]) == (0, count - 1)
        assert np.ptp(np.diff(frames)) <= 1


def test_samples_change_in_proportion_between_poses_that_are_alike():
    given = knots({("M0", 0): 5, ("M0", 10): 7, ("M0", 30): 5, ("M1", 0): 5, ("M0", 40): 5})
    assert given == {"M0": [[0, 5], [10, 7], [30, 5], [40, 5]], "M1": [[0, 5]]}
    plan = Plan(9, None, spp_by_frame=given)
    for frame in range(41):
        between = np.interp(frame, *zip(*given["M0"], strict=True))
        assert plan.spp_of("M0", frame) == pytest.approx(between), frame
    assert plan.spp_of("M1", 33) == 5
    assert Plan(9, None).spp_of("M0", 7) == 9


def test_between_unlike_poses_frames_take_what_the_more_demanding_one_needs():
    plan = Plan(9, None, spp_by_frame=knots({("M0", 0): 2, ("M0", 10): 8, ("M0", 20): 9, ("M0", 21): 4, ("M0", 30): 2}))
    given = [plan.spp_of("M0", frame) for frame in range(31)]
    assert given == [2, *[8] * 10, *(8 + k / 10 for k in range(1, 11)), *[4] * 9, 2]


def test_stretches_are_halved_where_their_ends_need_unlike_numbers():
    needed = {("M0", 0): 4, ("M0", 10): 6, ("M0", 20): 20, ("M0", 21): 60, ("M0", 41): 9, ("M1", 0): 40, ("M1", 9): 40}
    assert halfway(needed, 1) == {("M0", 31): 34.5, ("M0", 15): 13}  # a quarter of seven: not the one from 4 to 6
    assert halfway({("M0", 0): 9, ("M0", 8): 13, ("M1", 0): 99}, 1) == {}


def test_a_peak_between_even_poses_is_found_and_followed():
    """Needs of a bump 40 frames wide, on the shoulder of which a pose stands: poses gather about it, and only there."""

    def truth(frame):
        return 5.0 + 35.0 * np.exp(-0.5 * ((frame - 420) / 40.0) ** 2)

    asked = []

    def image(view, spp, *how):
        asked.append(view[1])
        return noisy_images(0.1 * np.sqrt(truth(view[1])))(spp, *how)

    frames = list(range(0, 1001, 100))
    needed = samples_along(image, [("M0", frame) for frame in frames], (("M0", 500), 9), 0.1, FIELD)
    plan = Plan(9, None, spp_by_frame=knots(needed))
    assert 500 not in asked
    assert {350, 450} <= set(asked) - set(frames)
    assert all(300 <= frame <= 600 for frame in set(asked) - set(frames))
    for frame in range(380, 461):  # chance and a straight line through a bump make a tenth; and steps of four above 16
        assert truth(frame) * 0.9 <= plan.spp_of("M0", frame) <= by_frame.UNLIKE * 1.1 * truth(frame) + 4


def noisy_images(sigma: float, seed: int = 1):
    """Makes images of a gradient whose samples have a relative deviation of ``sigma``, as `trial` wants them."""
    truth = np.tile(np.linspace(0.5, 1.5, 160)[:, None], (120, 1, 3))

    def image(spp: float, number: int, denoised: bool):
        rng = np.random.default_rng((seed, int(8 * spp), number))
        radiance = truth + sigma * rng.normal(size=truth.shape) / np.sqrt(spp)
        return Made(spp, radiance, radiance if denoised else None)

    return image


@pytest.mark.parametrize("spp", [32, 100, 8, 4])
def test_a_view_needs_what_its_noise_says(spp):
    """(0.5 / 0.1)^2 = 25 samples, in steps of two, and what chance leaves open, which is a few percent.

    Tried with more than that, and with fewer: then it is tried again, as extrapolating so far would be a guess.
    """
    assert 24 <= samples_needed(noisy_images(0.5), spp, 0.1, FIELD) <= 28


@pytest.mark.parametrize(("sigma", "least", "most"), [(0.1, 1.375, 1.375), (1.0, 92, 108)])
def test_views_that_need_more_than_they_were_tried_with_are_tried_again(sigma, least, most):
    asked = []

    def image(spp, *how):
        asked.append(spp)
        return noisy_images(sigma)(spp, *how)

    needed = samples_needed(image, 16, 0.1, FIELD)
    assert least <= needed <= most
    assert max(asked) >= needed / by_frame.BEYOND
    assert needed > 16 or max(asked) == 16


def test_a_view_that_needs_many_times_the_first_guess_is_tried_until_it_is_known():
    assert 132 <= samples_needed(noisy_images(1.2), 8, 0.1, FIELD) <= 160  # 144, in steps of 16


def test_errors_are_told_by_images_that_know_nothing_of_those_they_are_of():
    """By all but the image itself: with it among them, its error would come out smaller."""
    tried = trial(noisy_images(0.5), 16, FIELD)
    assert [one.spp for one in tried] == [4, 8, 16]
    assert len({one.radiance.tobytes() for one in tried}) == 3
    for one in tried:
        np.testing.assert_allclose(of_others(error, one, tried, 0.0), 0.5 / np.sqrt(one.spp), rtol=0.1)
    few = trial(noisy_images(0.5), 2, FIELD)
    assert [(one.spp, one.denoised is None) for one in few] == [(0.5, False), (1, False), (2, False)]
    fewest = trial(noisy_images(0.5), 0.5, FIELD)
    assert [(one.spp, one.denoised is None) for one in fewest] == [(0.25, False), (0.25, True), (0.5, False)]
    assert [one.spp for one in trial(noisy_images(0.5), 5, SAMPLES["path"])] == [2, 3, 5]


@pytest.mark.parametrize("samples", [*SAMPLES.values(), FIELD.in_multiples(1), FIELD.in_multiples(6)])
def test_a_first_guess_has_two_unlike_numbers_of_samples_so_that_a_law_can_be_told(samples):
    """Those of a view that nothing is known of, by paths and where colours part, too."""
    assert len({one.spp for one in trial(noisy_images(0.5), by_frame.first_guess(samples), samples)}) > 1
    assert samples_needed(noisy_images(0.001), by_frame.first_guess(samples), 0.02, samples) >= samples.fewest


def test_images_are_added_while_they_do_not_tell():
    """They are 2 % off but far noisier before the denoiser: for one more after the other, up to six."""
    made = []

    def image(spp, number, denoised):
        rng = np.random.default_rng((int(8 * spp), number))
        noisy, clean = (1.0 + sigma * rng.normal(size=(90, 160, 3)) for sigma in (8.0 / np.sqrt(spp), 0.02))
        made.append(Made(spp, noisy, clean if denoised else None))
        return made[-1]

    samples_needed(image, 16, 0.021, FIELD)
    assert len(made) == by_frame.MOST_IMAGES
    assert len({one.radiance.tobytes() for one in made}) == len(made)


def test_images_of_many_samples_tell_more_than_those_of_few():
    """Weighted by their samples; and the standard error is what the square varies by."""
    rng, truth, spp = np.random.default_rng(8), np.ones((60, 80, 3)), [1, 1, 2, 4, 16]
    found = [
        [
            squared_error([truth + 0.02], [truth + rng.normal(size=truth.shape) / np.sqrt(n) for n in spp], how)
            for how in (spp, None)
        ]
        for _ in range(40)
    ]
    (square, unsure), (alike, _) = np.moveaxis(found, (1, 2), (0, 1))
    np.testing.assert_allclose(square.mean(), 0.02**2, atol=4.0 * square.std() / np.sqrt(square.size))
    np.testing.assert_allclose(square.std(), unsure.mean(), rtol=4.0 / np.sqrt(2.0 * square.size))
    assert square.std() < 0.67 * alike.std()  # 0.49 by the deviations of the products, and four standard errors


def tried_with(truth, errors, deviation, rng):
    """Images of 2, 4, 8 samples with errors of these deviations, and of two that are all noise."""
    images = [truth + error * rng.normal(size=truth.shape) for error in errors]
    noise = [truth + deviation * rng.normal(size=truth.shape) for _ in range(5)]
    made = [Made(spp, noisy, image) for spp, noisy, image in zip((2, 4, 8), noise, images, strict=False)]
    return made + [Made(8, noisy) for noisy in noise[3:]]


def test_no_more_samples_are_taken_than_were_enough():
    """From 2 to 4 samples errors fall faster than by the law, for with 2 none are shared out by noise: 4 are enough."""
    truth, rng = np.ones((180, 320, 3)), np.random.default_rng(4)
    tried = tried_with(truth, [0.049, 0.0165, 0.0098], 0.02, rng)
    assert need(tried, 0.0188, FIELD).spp == 4
    assert need(tried, 0.012, FIELD).spp in (5.5, 6, 6.5, 7)  # between 4 and 8 as they say
    lucky = tried_with(truth, [0.0165, 0.049, 0.0098], 0.02, rng)
    assert 4 < need(lucky, 0.0188, FIELD).spp <= 8  # with fewer it was enough once, and once not


def test_vague_estimates_never_talk_samples_down():
    """The image is 2 % off, the estimates are all noise: then no fewer samples are taken than the image had.

    But it is no more than about 10 % off, and that is enough where 30 % are asked.
    """
    truth, spp = np.ones((180, 320, 3)), 32

    def image(samples, number, denoised):
        rng = np.random.default_rng((int(8 * samples), number))
        noisy, clean = (truth + sigma * rng.normal(size=truth.shape) for sigma in (6.0 / np.sqrt(samples), 0.02))
        return Made(samples, noisy, clean if denoised else None)

    for target in (0.01, 0.02, 0.03):
        assert need(trial(image, spp, FIELD), target, FIELD).spp >= spp
    assert need(trial(image, spp, FIELD), 0.3, FIELD).spp < spp


UP = POSE.copy()
UP[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
"""Looks up into the water, where there is nothing but scattered light."""


def test_frames_of_a_sequence_take_what_their_views_need(monkeypatch):
    """Two halves: one sees the floor, one only water; each keeps the tolerance, with samples of its own.

    With the field, for paths alone leave rare bright samples in open water: of 60 images with 24 samples one was off by
    eight times what half of them were. Four images of each, against two of 32 samples, tell their error to about a
    tenth; what four of 32 say differs by a hundredth.
    """
    monkeypatch.setattr(pilot, "POSES", 2)  # the first and the last: there are but two
    scene = make_scene(tolerance=0.07, integrator="field")
    renderer = make_renderer(scene)
    poses = [POSE] * 300 + [UP] * 300
    plan = plan_render(scene, renderer, poses)
    given = [plan.spp_of("M0", frame) for frame in range(600)]
    assert min(given[:300]) > max(given[301:])
    assert max(given) == plan.spp
    assert "spp by frame" in plan.reasons[-1]
    for frame in (0, 599):
        how = plan.options | {"spp": given[frame]}
        estimates = [
            renderer.render(poses[frame], outputs="A", seed=5 + k, **plan.options | {"spp": 32}).A.radiance
            for k in range(2)
        ]
        found = [renderer.render(poses[frame], outputs="A", seed=80 + k, **how).A.radiance for k in range(4)]
        assert error(found, estimates, 0.0).max() <= 1.1 * scene.render.tolerance


def test_few_frames_all_take_the_same():
    scene = make_scene(tolerance=0.3)
    plan = plan_render(scene, make_renderer(scene), [POSE, UP])
    assert plan.spp_by_frame is None
