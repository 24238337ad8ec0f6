"""The datasets of a sweep: which of them are to have the same images, which have, and which are whole."""

from functools import lru_cache
from pathlib import Path

from varos_warp.dataset import files
from varos_warp.dataset.layout import Layout
from varos_warp.dataset.run.shared import fingerprint, images_of
from varos_warp.dataset.sweep.versions import Version
from varos_warp.dataset.write.checksums import NAME, read_checksums
from varos_warp.files import is_file, stamp_of
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.scene.description import Scene
from varos_warp.scene.description.looks import LOOKS
from varos_warp.sim.clock import select


class Unit:
    """One dataset of a sweep: a version of the scene as one vehicle sees it."""

    def __init__(self, version: Version, vehicle: str, scene: Scene, root: Path):
        self.version, self.vehicle, self.scene, self.root = version, vehicle, scene, root
        self.layout = Layout.of(scene, root)
        kinds = {LOOKS, *(OUTPUTS[letter].beside for letter in scene.render.outputs)}
        self._of = {beside: fingerprint(scene, beside) for beside in kinds}

    def has_same(self, letter: str, other: "Unit") -> bool:
        """Return whether another dataset is to have the same images of a type that this one has."""
        if self is not other and self.scene.is_spectral and OUTPUTS[letter].is_color:  # the water decides on its bands
            return False
        beside = OUTPUTS[letter].beside
        return letter in other.scene.render.outputs and self._of[beside] == other._of[beside]

    @property
    def course(self) -> str:
        """Fingerprint shared by scenes that differ in their looks only, and so have the same geometry and course."""
        return self._of[LOOKS]

    @property
    def listed(self) -> dict[str, str]:
        """Checksums of its files; none before a run has made all that it was asked for."""
        path = self.root / NAME
        return _listed(path, stamp_of(path))

    def is_whole(self, frames: slice) -> bool:
        """Return whether a run has made all images of these frames, and no file is gone since."""
        listed = self.listed
        if not listed or not is_file(self.layout.metadata):
            return False
        wanted = select(frames, files.read_json(self.layout.metadata)["frames"]["of"])
        names = [
            path.relative_to(self.root).as_posix()
            for letter in self.scene.render.outputs
            for path in images_of(self.layout, self.scene, letter, wanted)
        ]
        return all(name in listed for name in names) and all(is_file(self.root / name) for name in listed)

    def shares(self, letter: str, other: "Unit") -> bool:
        """Return whether all its images of a type are those of another dataset, byte by byte."""
        folders = {
            self.layout.image_files(camera, letter, 0, vars(self.scene.render))[folder].parent
            for camera in self.layout.cameras
            for folder in OUTPUTS[letter].wanted(vars(self.scene.render))
        }
        own = {name: value for name, value in self.listed.items() if (self.root / name).parent in folders}
        theirs = other.listed
        return bool(own) and all(theirs.get(name) == value for name, value in own.items())


@lru_cache(maxsize=4096)
def _listed(path: Path, stamp: tuple | None) -> dict[str, str]:
    """Checksums of a dataset; ``stamp`` differs when they were written anew."""
    return {} if stamp is None else read_checksums(path.parent)
