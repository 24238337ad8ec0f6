"""What worker processes of the tests do; imported by them, so it imports little itself."""

import os
import signal
import sys
import time
from pathlib import Path


def wait_for(condition, seconds=60.0) -> None:
    """Until it is true."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.1)


def facts(shard, console):
    """What a worker is given, and what it holds."""
    links = [
        os.readlink(f"/proc/self/fd/{fd}")
        for fd in os.listdir("/proc/self/fd")
        if os.path.exists(f"/proc/self/fd/{fd}")
    ]
    console.tell("the same of all")
    console.tell(f"of {shard[0]}")
    with console.progress("work", 3) as progress:
        progress.advance(2)
        progress.advance()
    return shard, os.getpid(), sorted(os.sched_getaffinity(0)), [link for link in links if "socket" in link]


def dies(folder: Path, times: int, how: str, shard, console):
    """The worker 1 dies so often."""
    tries = len(list(folder.glob(f"{shard[0]}-*")))
    (folder / f"{shard[0]}-{tries}").touch()
    if shard[0] == 1 and tries < times:
        if how == "crash":
            raise ZeroDivisionError
        os.kill(os.getpid(), signal.SIGKILL)
    return tries


def fails(how: str, shard, console):
    """The worker 0 has a failure; the other one has time."""
    from varos_warp.errors import InputError, RunFailed

    if shard[0] == 0:
        raise (InputError("no space", file="disk", remedy="Free some.") if how == "input" else RunFailed("frame 4"))
    with console.progress("work", 1) as progress:
        progress.advance()
    time.sleep(60.0 if how == "input" else 0.2)


def sleeps(folder: Path, shard, console):
    """Works until it is interrupted, and notes that."""
    (folder / f"begun{shard[0]}").write_text(str(os.getpid()))
    try:
        time.sleep(60.0)
    except KeyboardInterrupt:
        time.sleep(0.2)  # an image that is under way
        (folder / f"ended{shard[0]}").touch()
        raise


def flat_floor_shard(kind: str, folder: Path, *arguments, shard, console):
    """`render_shard` with the stand-ins of standins.py; some of them kill their process, fail, or take long."""
    import pytest
    import standins

    from varos_warp.dataset.run import produce

    class Renderer(standins.FlatFloorRenderer):
        def render(self, *args, frame, **options):
            if kind == "killed" and frame == 5 and not (folder / "killed").exists():
                (folder / "killed").touch()
                os.kill(os.getpid(), signal.SIGKILL)
            if kind == "failing" and frame == 5:
                raise RuntimeError("CUDA error 700")
            if kind == "waiting" and frame >= 5:
                wait_for(lambda: list(folder.rglob("lights0_poses.csv")))
            if kind == "slow":
                time.sleep(0.3)
            return super().render(*args, frame=frame, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(standins, "FlatFloorRenderer", Renderer)
        standins.install(patch)
        return produce.render_shard(*arguments, shard=shard, console=console)


def sleep_in_two_workers(folder: Path) -> None:
    """A program whose workers sleep."""
    from varos_warp.dataset.run.workers import run_in_workers

    signal.signal(signal.SIGINT, signal.default_int_handler)  # shells let jobs in the background ignore it
    run_in_workers(2, sleeps, (folder,), done=print, tell=print)


def slow_command(out: Path) -> None:
    """The command line with a worker that takes long for each image."""
    from functools import partial

    import pytest
    import standins

    from varos_warp import cli
    from varos_warp.dataset.run import produce
    from varos_warp.scene.file import load

    patch = pytest.MonkeyPatch()
    standins.install(patch)
    patch.setattr(load, "load_scene", lambda *_: standins.make_scene(render={"outputs": ["D"]}))
    patch.setattr(produce, "render_shard", partial(flat_floor_shard, "slow", None))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv = ["varos-warp", "run", "scene.yaml", "-o", str(out), "--device", "cpu", "--workers", "1"]
    cli.main()
