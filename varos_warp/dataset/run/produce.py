"""The main job: a scene becomes a dataset on disk. What is complete there is kept, what is missing is made.

Rendering (which may be divided into shards and interrupted) writes linear EXR files; the exposure of A follows from
all of them afterwards. So the bytes do not depend on how the work was divided.
"""

import contextlib
import time

from varos_warp.dataset.layout import Layout
from varos_warp.dataset.progress import Console
from varos_warp.dataset.run.pipeline import Rendered
from varos_warp.dataset.run.shared import Shared
from varos_warp.dataset.run.steps import Run
from varos_warp.dataset.run.summary import Summary
from varos_warp.dataset.run.workers import device_of_worker
from varos_warp.dataset.write import folder
from varos_warp.device.devices import resolve_device
from varos_warp.errors import InputError
from varos_warp.render.decisions import require_planner
from varos_warp.scene.file.named_files import require_files
from varos_warp.scene.file.source import located


def produce(
    scene,
    out,
    *,
    device: str = "auto",
    frames: slice = slice(None),
    shard: tuple[int, int] = (0, 1),
    sensors: bool = True,
    images: bool = True,
    quiet: bool = False,
    renderer=None,
    workers: int | None = None,
) -> Summary:
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
        workers: Render in so many processes of this host, each on a GPU of its own with ``auto``; a script that asks
            for them must not do so again when it is imported (``if __name__ == "__main__":``).

    Raises:
        InputError: If the folder cannot be used, holds a dataset of another scene, or another run is at it; or there
            is no such device.
        RunFailed: If images could not be made; all others are.
    """
    return produce_sharing(
        scene,
        out,
        Shared(renderer=renderer, is_lit=renderer is not None),
        device=device,
        frames=frames,
        shard=shard,
        sensors=sensors,
        images=images,
        quiet=quiet,
        workers=workers,
    )


def produce_sharing(
    scene,
    out,
    shared: Shared,
    *,
    device: str,
    frames: slice,
    shard: tuple[int, int] = (0, 1),
    sensors: bool = True,
    images: bool = True,
    quiet: bool = False,
    workers: int | None = None,
) -> Summary:
    """Do as `produce`, with what earlier runs have made already, and for later ones; ``shared`` must suit the scene."""
    start = time.monotonic()
    if workers is not None and (workers < 1 or shard[1] > 1):
        raise InputError(
            "must be at least 1" if workers < 1 else "cannot be given with --shard",
            key="--workers",
            value=workers,
            remedy="Leave one of them out." if workers > 0 else "Such as 2.",
        )
    layout = Layout.of(scene, out)
    if images and workers is None:
        device = shared.renderer.device if shared.is_lit else resolve_device(device)
    new = not layout.root.exists()
    try:
        folder.open_folder(scene, layout)  # before anything is made or removed there
        # n workers and their parent share the folder as n + 1
        with folder.claimed(layout.root, (workers, workers + 1) if workers else shard), located(scene):
            previous = folder.open_folder(scene, layout)
            if images and previous is None:
                require_files(scene)
                require_planner(scene)
            run = Run(scene, layout, shard, Console(quiet), device, shared)
            with run.record.recording():
                run.simulate(frames, previous)
                run.clean_up()
                run.borrow()
                if workers and images:
                    run.hand_out(workers, render_shard, (scene, out, device, frames), sensors)
                run.go(sensors, images)
    finally:
        if new:
            with contextlib.suppress(OSError):
                layout.root.rmdir()  # what failed before the first file leaves no empty folder
    run.summary.seconds = round(time.monotonic() - start, 3)
    run.summary.stages = run.clock.rounded()
    return run.summary


def render_shard(
    scene, out, device: str, frames: slice, *, shard: tuple[int, int], console
) -> tuple[Summary, Rendered]:
    """What a worker does: all of a run but what follows from the frames of all workers."""
    layout = Layout.of(scene, out)
    with folder.claimed(layout.root, (shard[0], shard[1] + 1)):
        run = Run(scene, layout, shard, console, device_of_worker(device, shard[0]))
        run.is_worker = True
        with run.record.recording():
            run.simulate(frames, folder.recorded(scene, layout))
            run.go(sensors=False, images=True)
    run.summary.stages = run.clock.rounded()
    return run.summary, run.made
