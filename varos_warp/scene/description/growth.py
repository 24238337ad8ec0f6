"""What grows and lies on surfaces: animals, plants and stones, as copies on the triangles of their hosts."""

from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import Field, model_validator

from varos_warp.errors import did_you_mean
from varos_warp.scene.block import Block, NonNegative

GrowthKind = Literal[
    "barnacle",
    "tube_worm",
    "hydroid",
    "anemone",
    "coralline",
    "mussel",
    "starfish",
    "shell",
    "pebble",
    "kelp",
    "seagrass",
    "turf",
]
SizeM = Annotated[float, Field(ge=1e-4, le=20.0)]
LARGEST_M: dict[str, float] = {
    "barnacle": 0.3,
    "tube_worm": 0.5,
    "hydroid": 0.6,
    "anemone": 1.0,
    "coralline": 2.0,
    "mussel": 0.5,
    "starfish": 1.5,
    "shell": 1.5,
    "pebble": 1.0,
    "kelp": 20.0,
    "seagrass": 7.0,
    "turf": 0.5,
}
"""No copy of a kind is larger [m]: about as the largest that has been found in any sea, and somewhat more."""
Cosine = Annotated[float, Field(ge=-1.0, le=1.0)]
Depth = Annotated[float, Field(ge=-1e4, le=1.2e4)]


class Growth(Block):
    """Copies of one kind of animal, plant or stone on surfaces of the scene, by chance and in clusters."""

    on: Annotated[list[str], Field(min_length=1)] = Field(examples=[["objects.0", "terrain"]])
    """Hosts that it grows on: ``terrain``, objects (``objects.0``), blocks of scatter (``scatter.0``, on each copy)."""
    kind: GrowthKind = Field(examples=["barnacle"])
    """Kind of growth: barnacle, tube_worm, hydroid, anemone, coralline, mussel, starfish, shell, pebble, kelp,
    seagrass, turf."""
    per_m2: Annotated[NonNegative, Field(le=1e5)] | None = Field(default=None, examples=[230])
    """Mean number of copies on a square metre of the surface where they may be, over all seeds; those that find no
    room are not counted. Absent: the kind's own (docs/growth.md)."""
    cluster: Annotated[NonNegative, Field(le=20.0)] | None = Field(default=None, examples=[11])
    """Degree of clustering: 0 is even chance everywhere, 11 is dense clumps and bare places between them.
    Absent: the kind's own."""
    up: tuple[Cosine, Cosine] | None = Field(default=None, examples=[[-1, 1]])
    """Least and largest vertical part of the surface's normal where they may be: -1 is an underside, 0 a wall, 1 level
    ground. Absent: the kind's own."""
    size_m: tuple[SizeM, SizeM] | None = Field(default=None, examples=[[0.007, 0.024]])
    """Smallest and largest size [m]: how wide it is, of anemones, hydroids and plants how high. At most what
    the largest of its kind may be (docs/growth.md). Absent: the kind's own."""
    depth_m: tuple[Depth, Depth] | None = Field(default=None, examples=[[0, 20]])
    """Least and greatest depth below the sea surface at which it grows [m]. Absent: at all depths."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """Seed of the places, together with that of the scene."""

    @model_validator(mode="after")
    def _ranges_ascend(self):
        for key in ("up", "size_m", "depth_m"):
            value = getattr(self, key)
            if value is not None and value[0] > value[1]:
                raise ValueError(f"{key}: {list(value)} begins above its end; give [low, high]")
        return self

    @model_validator(mode="after")
    def _no_larger_than_any(self):
        most = LARGEST_M[self.kind]
        if self.size_m is not None and self.size_m[1] > most:
            raise ValueError(
                f"size_m: {list(self.size_m)} is larger than any {self.kind} is; {most:g} m is the most, "
                "give [low, high]"
            )
        return self

    @model_validator(mode="after")
    def _each_host_once(self):
        for i, host in enumerate(self.on):
            if host in self.on[:i]:
                raise ValueError(f"on.{i}: '{host}' is named twice; name it once, with a larger per_m2")
        return self


def problem_of(blocks: Iterable[Growth], hosts: dict[str, str | None]) -> str | None:
    """What is wrong with the hosts of blocks, after the key that it is wrong with; None: nothing.

    Args:
        blocks: Those of a scene.
        hosts: Keys of all that things may grow on, each with the reason why nothing can, or None.
    """
    taken: dict[tuple, str] = {}
    for i, block in enumerate(blocks):
        for j, host in enumerate(block.on):
            key = f"growth.{i}.on.{j}"
            if host not in hosts:
                still = [name for name, reason in hosts.items() if reason is None]
                near = did_you_mean(host, still) or f"There are: {', '.join(still) or 'none'}"
                return f"{key}: there is no surface '{host}' to grow on. {near}"
            if reason := hosts[host]:
                return f"{key}: '{host}' {reason}; name what stands still"
            if (first := taken.setdefault((host, block.kind, block.seed), f"growth.{i}")) != f"growth.{i}":
                return (
                    f"growth.{i}.seed: {block.seed} is that of {first}, which puts the same kind on {host}: the "
                    "copies would stand in the same places; give another seed"
                )
    return None
