"""Nothing grows over a run: the short form of the soak, with the real renderer on the CPU."""

import gc
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import soak
from varos_warp.dataset.run import pipeline

SIZE = (64, 36)
FRAME_BYTES = SIZE[0] * SIZE[1] * 4 * (6 * 3 + 2 * 3 + 3 + 2)
"""float32 images of a frame: six of A (radiance, error, layers, denoised), two of B, C and D."""

linux = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


FRAMES = 100


@pytest.fixture(autouse=True)
def no_search_for_garbage():
    """Memory is given back without: what stands in a circle would be kept for long, as commands search rarely."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@linux
def test_a_long_run_leaves_no_memory_handle_or_thread_behind(tmp_path, monkeypatch):
    """A tenth of the frames kept by anybody would be found, and a handle or a thread left by one in fifty.

    The slope through the last 4/5 of the samples has a standard error of sqrt(12) / 80^1.5 = 0.0048 of their scatter:
    of a megabyte a fifth of what is allowed, of one handle a quarter. One frame is under way at a time: a queue that
    fills when other work keeps the cores from writing is no leak. Nor is what a process takes when it first renders.
    """
    monkeypatch.setattr(pipeline, "room", lambda cores: 1)
    soak.soak(20, SIZE, "cpu", tmp_path / "first", integrator="path")
    result = soak.soak(FRAMES, SIZE, "cpu", tmp_path / "out", integrator="path")
    growth = result["growth_per_frame"]
    assert growth["bytes"] < 0.1 * FRAME_BYTES
    assert growth["handles"] < 0.02
    assert growth["threads"] < 0.02
    assert result["python_threads_left"] == 0
    assert result["images"] == 4 * FRAMES
    assert set(range(FRAMES)) <= {sample["frame"] for sample in result["samples"]}


LEAK = """
import sys
from pathlib import Path
from benchmarks import soak

kept = []

class Leaking(soak.Watched):
    def render(self, *args, **options):
        kept.append(super().render(*args, **options))
        return kept[-1]

soak.Watched = Leaking
print(soak.soak(25, (64, 36), "cpu", Path(sys.argv[1]), integrator="path")["growth_per_frame"]["bytes"])
"""


@linux
def test_a_renderer_that_keeps_its_images_is_found_out(tmp_path):
    """In a process of its own: what other tests have freed would take up what leaks here."""
    command = [sys.executable, "-c", LEAK, tmp_path / "out"]
    result = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(soak.__file__).parents[1])
    assert float(result.stdout.splitlines()[-1]) > 0.3 * FRAME_BYTES


def test_growth_is_the_slope_after_the_run_has_settled():
    samples = [
        {"frame": k, "rss_mb": 100.0 + 0.002 * k + (k < 10) * 50, "handles": 6 + 0.5 * k, "threads": 4}
        for k in range(50)
    ]
    assert soak.growth(samples) == pytest.approx({"bytes": 2000.0, "handles": 0.5, "threads": 0.0})
