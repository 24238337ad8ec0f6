"""When a camera's shutter is open, and when a strobe flashes."""

from typing import Annotated

from pydantic import Field, model_validator

from varos_warp.scene.description.block import Block, outside

SHORTEST_S = 1e-9
"""Times are counted in nanoseconds."""
Duration = Annotated[float, Field(ge=0.0, le=60.0), outside(0.0, SHORTEST_S, "is 0 or at least 1e-9 s, a nanosecond")]
"""[s]"""


class Shutter(Block):
    """While it is open A and B are blurred by the vehicle's motion; C, D, S and F are of the middle of the exposure."""

    exposure_s: Duration = 0.0
    """How long each pixel is exposed [s]; 0 is an instant."""
    readout_s: Duration = 0.0
    """Time that a rolling shutter takes to read all rows, first row first: their number times the time from one row to
    the next [s]; 0 is a global shutter. Time stamps are of the middle of the exposure of the middle row."""

    @model_validator(mode="after")
    def _is_open(self):
        if self.exposure_s == 0.0 == self.readout_s:
            raise ValueError("a shutter has an exposure_s or a readout_s above 0; leave it out for sharp images")
        return self


class Strobe(Block):
    """A light that flashes with every frame instead of shining all the time."""

    on_s: Annotated[float, Field(ge=SHORTEST_S, le=60.0, examples=[0.002])]
    """How long [s]."""
    delay_s: Annotated[float, Field(ge=-60.0, le=60.0)] = 0.0
    """From the frame's time stamp to the middle of the flash [s]."""
