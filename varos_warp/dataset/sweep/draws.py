"""Values of keys by chance: the i-th draw of a key follows from the seed, the key and i, whatever else is drawn."""

import math
import zlib
from statistics import NormalDist
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from varos_warp.scene.block import Block, Positive

Interval = tuple[float, float]


class Distribution(Block):
    """What a key is drawn from; exactly one of these."""

    choice: Annotated[list[Any], Field(min_length=1)] | None = None
    """One of several values, all equally likely."""
    uniform: Interval | None = None
    """Any number between two."""
    log_uniform: tuple[Positive, Positive] | None = None
    """Any number between two above 0, whose logarithm is uniform."""
    normal: tuple[float, Positive] | None = None
    """Mean and standard deviation."""
    integer: tuple[int, int] | None = None
    """Any whole number from the first to the last."""

    @model_validator(mode="after")
    def _one_form(self):
        given = {key: value for key, value in self if value is not None}
        if len(given) != 1:
            raise ValueError(f"give exactly one of {', '.join(type(self).model_fields)}")
        for key in ("uniform", "log_uniform", "integer"):
            if key in given and not given[key][0] < given[key][1]:
                raise ValueError(f"{key}: the first number must be less than the second")
        return self

    def draw(self, seed: int, key: str, index: int) -> Any:
        """The value of the index-th draw of a key."""
        u = _unit(seed, key, index)
        if self.choice is not None:
            return self.choice[int(u * len(self.choice))]
        if self.integer is not None:
            first, last = self.integer
            return first + int(u * (last - first + 1))
        if self.normal is not None:
            return NormalDist(*self.normal).inv_cdf(u)
        if self.log_uniform is not None:
            low, high = map(math.log, self.log_uniform)
            return min(max(math.exp(low + u * (high - low)), self.log_uniform[0]), self.log_uniform[1])
        assert self.uniform is not None
        low, high = self.uniform
        return low + u * (high - low)


def _unit(seed: int, key: str, index: int) -> float:
    """A number in (0, 1), the same with every version of NumPy, which keeps SeedSequence as it is."""
    bits = int(np.random.SeedSequence([seed, index, zlib.crc32(key.encode())]).generate_state(1, np.uint64)[0])
    return ((bits >> 12) + 0.5) * 2.0**-52
