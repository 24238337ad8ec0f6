"""The main job of a sweep: a dataset of each version; what versions have in common is made once.

Each dataset has the bytes that `run` makes of its version alone, and can be moved, completed and deleted alone.
"""

import contextlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from varos_warp.dataset.progress import Console
from varos_warp.dataset.run.fleet import datasets_of
from varos_warp.dataset.run.produce import produce_sharing
from varos_warp.dataset.run.shared import Shared, give_up, link_equal, unlike
from varos_warp.dataset.run.summary import Summary
from varos_warp.dataset.sweep.manifest import Manifest
from varos_warp.dataset.sweep.units import Unit
from varos_warp.dataset.sweep.versions import Version, read_versions
from varos_warp.device.devices import resolve_device
from varos_warp.errors import InputError, RunFailed
from varos_warp.scene.description import Scene
from varos_warp.scene.file.load import load_scene
from varos_warp.scene.file.named_files import require_files
from varos_warp.scene.file.source import located
from varos_warp.sim.clock import select


@dataclass
class Sweep:
    """What a sweep is to make, checked; nothing is made yet."""

    manifest: Manifest
    device: str = "auto"
    kept: dict[str, Shared] = field(default_factory=dict)
    """What stays in memory from run to run, by vehicle."""

    def __post_init__(self):
        first: dict[str, int] = {}
        for i, unit in enumerate(self.manifest.units):
            first.setdefault(unit.course, i)
        self.units = sorted(self.manifest.units, key=lambda unit: first[unit.course])
        """Datasets in the order of the work: those with the same geometry and course one after another."""

    def donors(self, unit: Unit) -> dict[str, Unit]:
        """Datasets from which one is to have its images, by letter: one that is done, else the first that is made."""
        found = {}
        for letter in unit.scene.render.outputs:
            alike = [other for other in self.units if unit.has_same(letter, other)]
            done = (other for other in alike if other is not unit and self.manifest.is_complete(other))
            donor = next(done, alike[0])
            if donor is not unit:
                found[letter] = donor
        return found

    def run(
        self, *, shard: tuple[int, int] = (0, 1), workers: int | None = None, quiet: bool = False
    ) -> dict[str, Summary | None]:
        """Make what is missing; arguments and errors are those of `produce`. `RunFailed` comes when all else is made.

        Returns by the folder of each dataset what was done; None: nothing, it was whole.
        """
        manifest, console, failures = self.manifest, Console(quiet), []
        done: dict[str, Summary | None] = dict.fromkeys(map(manifest.folder_of, self.units))
        left = [unit for unit in self.units if not manifest.is_complete(unit)]
        with self._listed(bool(left)):
            for i, unit in enumerate(left):
                name = manifest.folder_of(unit)
                console.tell(f"{name}, {i + 1} of {len(left)} ...")
                try:
                    summary = done[name] = self._make(unit, console, shard=shard, workers=workers, quiet=quiet)
                except RunFailed as error:
                    failures.append(f"{name}: {error}")
                else:
                    manifest.write(unit if summary.complete else None)
        if failures:
            raise RunFailed("; ".join(failures))
        return done

    @contextlib.contextmanager
    def _listed(self, anything: bool) -> Iterator[None]:
        """The list is there while anything is made, and tells where that stopped; none of what made no file at all."""
        is_new = not self.manifest.path.exists()
        if anything:
            self.manifest.write()
        try:
            yield
        except InputError:
            if is_new:
                self.manifest.withdraw()
            raise
        except KeyboardInterrupt:
            self.manifest.write()
            raise

    def _make(self, unit: Unit, console: Console, **how: Any) -> Summary:
        """Make one dataset; images that prove to be others than those that were linked are made anew."""
        shared = self.kept.setdefault(unit.vehicle, Shared())
        scene, donors = shared.suited(unit.scene), self.donors(unit)
        before: Summary | None = None
        while True:
            shared.donors = {letter: donor.root for letter, donor in donors.items()}
            summary = produce_sharing(scene, unit.root, shared, device=self.device, frames=self.manifest.frames, **how)
            if before is not None:
                summary.rendered, summary.seconds = summary.rendered + before.rendered, summary.seconds + before.seconds
                summary.kept = before.kept
            mine = select(self.manifest.frames, len(shared.simulation.frames))[how["shard"][0] :: how["shard"][1]]
            wrong = unlike(shared.donors, unit.layout, scene, mine[:1])
            if not wrong:
                break
            console.tell(
                f"note: {', '.join(wrong)} of {unit.version.name} are not those of other versions, as they "
                "should be, and are made anew"
            )
            give_up(wrong, unit.layout, scene, mine[1:])
            before = summary
            donors = {letter: donor for letter, donor in donors.items() if letter not in wrong}
        if summary.complete:
            link_equal(unit.root, [other.root for other in self._related(unit)])
        return summary

    def _related(self, unit: Unit) -> Iterable[Unit]:
        """Other whole datasets that may have the same files: the first of this course, and of all."""
        others = [other for other in self.units if other is not unit and self.manifest.is_complete(other)]
        return [*[other for other in others if unit.course == other.course][:1], *others[:1]]


def prepare(
    path: str | Path,
    over: Sequence[str],
    out: str | Path,
    overrides: Iterable[str | tuple[str, str]] = (),
    *,
    device: str = "auto",
    frames: slice = slice(None),
    only: str | None = None,
) -> Sweep:
    """What a sweep is to make, after everything is checked that can be before hours are spent. Changes nothing.

    ``over`` is a file, or keys with values, ``KEY=VALUE,VALUE`` (`read_versions`), and has the last word over
    ``overrides`` of all versions, as `load_scene` takes them; ``only`` is the id of one of the scene's ``vehicles``,
    other arguments are those of `produce`. An `InputError` tells of a version that cannot be made, or a folder that
    cannot be used.
    """
    out, overrides = Path(out), list(overrides)
    load_scene(path, overrides)  # what is wrong without any version is not told of one
    units = []
    for version in read_versions(over):
        with _told_of(version):
            scene = load_scene(path, [*overrides, *version.changes])
        units += [
            Unit(version, vehicle, alone, root)
            for vehicle, (alone, root) in datasets_of(scene, out / version.name, only).items()
        ]
    manifest = Manifest(out, units, frames)
    manifest.check()
    for unit in units:
        with _told_of(unit.version):
            check(unit.scene, resolve_device(device))
    return Sweep(manifest, device)


@contextlib.contextmanager
def _told_of(version: Version) -> Iterator[None]:
    """Errors name the version, unless they are about what it sets itself."""
    try:
        yield
    except InputError as error:
        if str(error.file) in [change.where for change in version.changes]:
            raise
        raise error.but(problem=f"in version {version.name}: {error.problem}") from error


def check(scene: Scene, device: str) -> None:
    """Refuse, by file and key, what `produce` would refuse before the first image."""
    from varos_warp.render.kinds import kernels_needed
    from varos_warp.render.particles.cells import check_cells
    from varos_warp.scene.device import foretold_spec
    from varos_warp.scene.water.particles import particle_laws

    with located(scene):
        require_files(scene)
        check_cells(particle_laws(scene), scene.vehicle.cameras)
        kernels_needed(scene, foretold_spec(scene, device), scene.render.outputs)
