"""Samples by frame: the poses that are judged, what each needs, and what the frames between them take."""

import numpy as np
import pytest

from tests.render.test_plan import POSE, make_renderer, make_scene
from varos_warp.render import by_frame
from varos_warp.render.by_frame import judged_frames, look, samples_needed, spp_of, stretches
from varos_warp.render.error_law import FEWEST_SPP
from varos_warp.render.pilot import error
from varos_warp.render.plan import plan_render

A_POSE = sum(1.0 / fewer for fewer in by_frame.FEWER) + by_frame.JUDGES
"""What judging one costs, in images of an image's samples."""


@pytest.mark.parametrize(("count", "pixels", "poses"), [
    (4713, 1.0, 33),  # as many as there ever are
    (200, 0.2, 11),   # 4 % of 200 frames are 8, for 0.75 a pose
    (60, 1.0, 0),     # too few to pay
    (1, 1e-6, 0)])
def test_judged_frames_are_spread_evenly_and_cost_little(count, pixels, poses):
    frames = judged_frames(count, pixels)
    assert len(frames) == poses
    assert (poses - 1) * A_POSE * pixels <= by_frame.SHARE * count
    if frames:
        assert (frames[0], frames[-1]) == (0, count - 1)
        assert np.ptp(np.diff(frames)) <= 1


def test_a_frame_takes_what_the_more_demanding_of_its_neighbours_needs():
    frames, needed = [0, 10, 20, 30, 40], [2, 3, 9, 4, 4]
    given = stretches(frames, needed)
    assert given == [[0, 3], [10, 9], [30, 4]]
    plan = {"spp": 9, "spp_by_frame": {"M0": given, "M1": [[0, 5]]}}
    for frame in range(41):
        k = min(frame // 10, 3)
        assert spp_of(plan, "M0", frame) == max(needed[k:k + 2])
    assert spp_of(plan, "M1", 33) == 5
    for plan in ({"spp": 9, "spp_by_frame": None}, {"spp": 9}):  # the second as in datasets of before
        assert spp_of(plan, "M0", 7) == 9


def noisy_images(sigma: float, seed: int = 1):
    """Makes images of a gradient whose samples have a relative deviation of ``sigma``, as `look` wants them."""
    truth = np.tile(np.linspace(0.5, 1.5, 160)[:, None], (120, 1, 3))

    def image(spp: int, number: int, denoised: bool):
        rng = np.random.default_rng((seed, spp, number))
        return truth + sigma * rng.normal(size=truth.shape) / np.sqrt(spp)

    return image


@pytest.mark.parametrize("spp", [32, 100, 8, 4])
def test_a_view_needs_what_its_noise_says(spp):
    """(0.5 / 0.1)^2 = 25 samples, in multiples of four, and what chance leaves open, which is a few percent.

    Judged with more than that, and with fewer: then it is judged again, as extrapolating so far would be a guess.
    """
    image = noisy_images(0.5)
    needed, = samples_needed(lambda view, *how: image(*how), ["it"], spp, 0.1, -0.75).values()
    assert 24 <= needed <= 28


def test_views_that_need_more_than_they_were_judged_with_are_judged_again():
    asked = []

    def image(view, spp, *how):
        asked.append((view, spp))
        return noisy_images(view)(spp, *how)

    needed = samples_needed(image, [0.1, 1.0], 16, 0.1, -0.75)
    assert needed[0.1] == FEWEST_SPP
    assert 92 <= needed[1.0] <= 108
    assert max(spp for view, spp in asked if view == 0.1) == 16
    assert max(spp for view, spp in asked if view == 1.0) == by_frame.REACH * 16


def test_a_view_is_judged_by_images_that_know_nothing_of_it():
    """With the images themselves as judges there would be no error."""
    seen = look(noisy_images(0.5), 16)
    assert seen.spp == [4, 8, 16]
    everything = [*seen.images, *seen.judges]
    assert len({image.tobytes() for image in everything}) == len(everything)
    for spp, image in zip(seen.spp, seen.images, strict=True):
        np.testing.assert_allclose(error([image], seen.judges, 0.0), 0.5 / np.sqrt(spp), rtol=0.1)


def test_vague_judges_never_talk_samples_down():
    """The image is 2 % off, its judges are all noise: then no fewer samples are taken than the image had."""
    truth, spp = np.ones((180, 320, 3)), 32

    def image(samples, number, denoised):
        rng = np.random.default_rng((samples, number))
        return truth + (0.02 if denoised else 6.0 / np.sqrt(spp)) * rng.normal(size=truth.shape)

    for target in (0.01, 0.02, 0.03, 0.3):
        assert look(image, spp).needs(target, -0.75) >= spp


UP = POSE.copy()
UP[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
"""Looks up into the water, where there is nothing but scattered light."""


def test_frames_of_a_sequence_take_what_their_views_need():
    """Two halves: one sees the floor, one only water; each keeps the tolerance, with samples of its own.

    Four images of each are judged by one of 4096 samples, and tell their error to about a tenth.
    """
    scene = make_scene(tolerance=0.3)
    renderer = make_renderer(scene)
    poses = [POSE] * 300 + [UP] * 300
    plan = plan_render(scene, renderer, poses)
    given = [spp_of(plan.to_dict(), "M0", frame) for frame in range(600)]
    assert min(given[:300]) > max(given[301:])
    assert max(given) == plan.spp
    assert "spp by frame" in plan.reasons[-1]
    for frame in (0, 599):
        how = plan.options | {"spp": given[frame]}
        truth = renderer.render(poses[frame], outputs="A", seed=5, **plan.options | {"spp": 4096}).A.radiance
        found = [renderer.render(poses[frame], outputs="A", seed=80 + k, **how).A.radiance for k in range(4)]
        assert error(found, [truth, truth], 0.0).max() <= 1.1 * scene.render.tolerance


def test_few_frames_all_take_the_same():
    scene = make_scene(tolerance=0.3)
    plan = plan_render(scene, make_renderer(scene), [POSE] * 20 + [UP] * 20)
    assert plan.spp_by_frame is None
