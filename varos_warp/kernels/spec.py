"""What kernels are compiled for: all that is present in a scene, and in an image of it, in one frozen record."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache, wraps
from threading import RLock
from typing import Any, TypeVar

from varos_warp.kernels.world.optics import STRAIGHT, OpticsSpec

T = TypeVar("T")


@dataclass(frozen=True)
class SceneSpec:
    """What is present; features that a scene lacks cost nothing. The defaults stand for what a factory does not ask."""

    medium: bool = True
    """The water scatters."""
    surfaces: bool = True
    """There are surfaces in the scene."""
    instances: bool = False
    """Some surfaces are instances."""
    textures: bool = True
    """Some material is more than one constant reflectance."""
    patterns: bool = True
    """Some material has an image or a pattern: more than colours of faces, and metal."""
    metals: bool = True
    """Some material shows bare metal."""
    grain: bool = False
    """Some material's tone varies from grain to grain."""
    rough: bool = False
    """Some material's diffuse part is rough."""
    masks: bool = False
    """Masks of mesh files cut holes."""
    bands: bool = False
    """Channels are bands of the spectrum, to which reflectances R G B are brought by matrices."""
    optics: OpticsSpec = STRAIGHT
    """The camera's lens and port."""
    varies: bool = False
    """Camera or lights differ from sample to sample."""
    disks: int = 0
    """Number of lights, if some are disks, whose points differ from sample to sample; else 0."""
    few_lights: bool = False
    """Lights are so few that the camera's segments ask for the direct light of each."""
    rolling: bool = False
    """The camera differs from row to row."""
    direct: bool = True
    single: bool = True
    multiple: bool = True
    """Which layers of A are wanted."""
    field: bool = False
    """The field of open water is known."""
    camera_field: bool = False
    """The field of open water is also known along this camera's rays."""
    lamps_tabled: bool = False
    """Tables tell along this camera's rays what bodies scatter of the lamps' light in the mean."""

    def only(self, *names: str) -> "SceneSpec":
        """A spec with these fields, and the defaults of all others."""
        return SceneSpec(**{name: getattr(self, name) for name in names})

    @property
    def mirrors(self) -> bool:
        """There may be metals, whose lobes mirror what is around them."""
        return self.surfaces and self.metals

    def camera(self) -> "SceneSpec | None":
        """What the camera's own segments need; None if no layer does."""
        multiple = self.multiple and (self.field or self.mirrors)
        if self.direct or self.single or multiple:
            return replace(self, multiple=multiple)
        return None

    def subpaths(self) -> "SceneSpec | None":
        """What subpaths need; None if there are none: of open water the field knows all."""
        if self.multiple and (self.surfaces or not self.field):
            return replace(self, direct=False, single=False, few_lights=False)
        return None


FIELDS = tuple(field.name for field in fields(SceneSpec))


def specialised(*names: str) -> Callable[[Callable[[SceneSpec], T]], Callable[[SceneSpec], T]]:
    """Decorate a factory of kernels or of their functions: it sees these fields of a spec, and makes each thing once.

    Specs that differ in other fields only share what it made, and threads that ask at once get the same.

    Raises:
        TypeError: A name is none of the fields.
    """
    if unknown := {*names} - {*FIELDS}:
        raise TypeError(f"SceneSpec has no {', '.join(sorted(unknown))}")

    def decorate(make: Callable[[SceneSpec], Any]) -> Callable[[SceneSpec], Any]:
        kept, lock = cache(make), RLock()

        @wraps(make)
        def made(spec: SceneSpec) -> Any:
            with lock:  # `cache` calls a factory again while it is at work in another thread
                return kept(spec.only(*names))

        return made

    return decorate
