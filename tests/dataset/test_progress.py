"""What a long job tells of how far it is."""

import pytest

from varos_warp.dataset import progress


@pytest.fixture
def clock(monkeypatch):
    """A clock that is set by hand."""
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_the_rate_is_that_after_the_first_step_and_no_end_is_foretold_from_it(clock, capsys):
    with progress.Progress("rendering", 9) as job:
        clock[0] += 40.0  # most of it for a compiler
        job.advance()
        assert job.rate == pytest.approx(1 / 40)
        assert capsys.readouterr().err == "rendering: 1/9 frames\n"
        for _ in range(4):
            clock[0] += 5.0
            job.advance()
        assert job.rate == pytest.approx(1 / 5)
        assert capsys.readouterr().err == "rendering: 4/9 frames, 0.2 frames/s, 0:25 left\n"


def test_steps_that_are_all_done_at_once_have_their_rate_from_the_start(clock, capsys):
    with progress.Progress("views", 16) as job:
        clock[0] += 2.0
        job.reach(0.5)
        job.reach(0.5)
        assert (job.done, job.rate) == (8, 4.0)
        clock[0] += 1.0
        job.reach(1.0)
    assert capsys.readouterr().err == "views: 16/16 frames, 8 frames/s in 0:03\n"


def test_a_log_is_told_of_each_step_and_of_a_long_one_now_and_then(clock, capsys):
    with progress.NamedSteps("planning", ["views", "samples"]) as steps:
        for seconds, name, share in (
            (2, "views", 0.0),
            (1, "views", 0.5),
            (1, "samples", 0.0),
            (14, "samples", 0.2),
            (1, "samples", 0.3),
            (14, "samples", 0.4),
        ):
            clock[0] += seconds
            steps.reach(name, share)
    assert capsys.readouterr().err.splitlines() == [
        "planning: views after 0:02",
        "planning: samples after 0:04",
        "planning: samples 30% after 0:19",
    ]
