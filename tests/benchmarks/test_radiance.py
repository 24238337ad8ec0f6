"""The order of work, the budget and what is written, with stand-ins that render nothing."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import chart, methods, peers, radiance, scenes, store
from benchmarks.errors import Reference
from benchmarks.methods import Method, Timed
from varos_warp.errors import InputError

SHAPE = (24, 32, 3)
MACHINE = {
    "device": "cuda:0",
    "device_name": "a GPU",
    "cpu": "a CPU",
    "cores": 2,
    "system": "Linux",
    "warp": "1",
    "commit": "abc",
    "date": "2026-01-01",
}


class Clock:
    """Seconds that pass only when something is rendered."""

    now = 0.0

    def __init__(self, device=None):
        self.start = Clock.now

    @property
    def seconds(self):
        return Clock.now - self.start


class Stage:
    """Stands in for a Workshop: a method's name says how many seconds a sample takes."""

    compile_seconds = cost = 0.0

    def __init__(self, bench, device):
        self.bench, self.device, self.rng = bench, device, np.random.default_rng(1)

    def prepare(self, method):
        if method.name == "refused":
            raise InputError("does not serve")
        cost = float(method.name)

        def render(spp):
            Clock.now += cost * spp
            return Timed(1.0 + self.rng.standard_normal((1, *SHAPE)) / np.sqrt(spp), cost * spp, cost * spp)

        return render, 0.5


@pytest.fixture
def bench(monkeypatch):
    Clock.now = 0.0
    monkeypatch.setattr(radiance, "Workshop", Stage)
    monkeypatch.setattr(radiance, "Budget", Clock)
    known = {"full": Reference(np.ones(SHAPE), np.full(SHAPE, 1e-3))}
    monkeypatch.setattr(radiance, "references", lambda bench, device, tell: known)
    camera = SimpleNamespace(resolution=(32, 24))
    return SimpleNamespace(name="a_scene", title="a stand-in", parts=[], camera=camera)


def series(*names):
    return [Method(name, name, "path", spp=(1, 4, 16, 64)) for name in names]


def test_the_cheapest_point_comes_first_and_the_budget_is_kept(bench, tmp_path):
    kept = store.Store(tmp_path, MACHINE)
    points = radiance.compare(bench, series("1.0", "0.1"), "cuda:0", 20.0, kept, lambda text: None)
    done = [(row["method"], row["spp"]) for row in kept.rows]
    assert points == len(done)
    assert done == [("1.0", 1), ("0.1", 1), ("0.1", 4), ("0.1", 16), ("1.0", 4), ("0.1", 64), ("1.0", 16)][: len(done)]
    assert ("1.0", 16) not in done  # 16 s more than the 20 there are
    assert Clock.now <= 20.0


def test_what_does_not_serve_is_left_out_with_its_reason(bench, tmp_path):
    kept = store.Store(tmp_path, MACHINE)
    radiance.compare(bench, series("refused", "0.1"), "cuda:0", 100.0, kept, lambda text: None)
    assert kept.scenes["a_scene"]["left_out"] == {"refused": "does not serve"}
    assert {row["method"] for row in kept.rows} == {"0.1"}


def test_every_row_is_on_disk_before_the_next_is_made(bench, tmp_path):
    def killed(text):
        if "16 spp" in text:
            raise KeyboardInterrupt

    kept = store.Store(tmp_path, MACHINE)
    with pytest.raises(KeyboardInterrupt):
        radiance.compare(bench, series("0.1"), "cuda:0", 100.0, kept, killed)
    result = json.loads((tmp_path / "bench.json").read_text())
    assert [row["spp"] for row in result["A"]] == [1, 4, 16]
    assert result["machine"]["commit"] == "abc"


def test_the_charts_are_drawn(bench, tmp_path):
    kept = store.Store(tmp_path, MACHINE)
    radiance.compare(bench, series("1.0", "0.1"), "cuda:0", 100.0, kept, lambda text: None)
    chart.radiance(kept.content(), "a_scene", tmp_path / "A.png")
    chart.scenes(kept.content(), tmp_path / "scenes.png")
    assert (tmp_path / "A.png").stat().st_size > 10_000
    assert (tmp_path / "scenes.png").stat().st_size > 5_000


def test_the_pareto_front_is_what_nothing_beats():
    points = [(1.0, 5.0), (2.0, 6.0), (3.0, 2.0), (3.0, 3.0), (4.0, 2.0), (5.0, 1.0)]
    assert chart.pareto(points) == [(1.0, 5.0), (3.0, 2.0), (5.0, 1.0)]


def test_other_programs_join_in_where_they_are_installed(monkeypatch):
    calls = []

    def render(name, scene, parts, camera, T_w_v, *, spp, denoise):
        calls.append((name, spp, denoise))
        return SimpleNamespace(radiance=np.ones(SHAPE, np.float32), seconds=1.0, cpu_seconds=2.0, setup_seconds=3.0)

    monkeypatch.setattr(peers, "available", lambda: ["mitsuba", "cycles"])
    monkeypatch.setattr(peers, "render", render)
    plain, denoised = methods.find(["mitsuba", "cycles+oidn"])
    bench = SimpleNamespace(scene=None, parts=[], camera=None, T_w_v=None)
    made, setup = methods.Workshop(bench, "cpu").prepare(denoised)
    timed = made(16)
    assert calls == [("cycles", 16, True)]
    assert (timed.seconds, timed.cpu_seconds, timed.setup_seconds, setup) == (1.0, 2.0, 3.0, 0.0)
    assert timed.images.shape == (1, *SHAPE)
    assert plain.peer == "mitsuba"
    with pytest.raises(InputError, match="no such method"):
        methods.find(["mitsuba+oidn"])


def test_without_them_only_ours_are_known(monkeypatch):
    monkeypatch.setattr(peers, "available", list)
    assert methods.find([]) == list(methods.OURS)


def test_unknown_names_are_refused():
    with pytest.raises(InputError, match="ref1, open_water"):
        scenes.find(["ref2"])
    with pytest.raises(InputError, match="direct, single"):
        methods.find(["fast"])


def test_a_run_goes_on_where_an_earlier_one_by_the_same_code_stopped(tmp_path):
    first = store.Store(tmp_path, MACHINE)
    for scene in ("one", "two"):
        first.add({"scene": scene})
    again = store.reopen(tmp_path, MACHINE | {"date": "2026-01-02"})
    again.forget(["two"])
    assert again.rows == [{"scene": "one"}]
    assert store.reopen(tmp_path, MACHINE | {"commit": "def"}).rows == []
