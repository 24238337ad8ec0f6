"""The registry of image types: a line each. What makes, writes, checks and shows one is its product.

It stands below the products, which it names only, so that a scene file's ``outputs`` follow from it.
"""

from typing import TYPE_CHECKING, Literal, NamedTuple

WATER, AMBIENT, NORMALS, DEPTH, SEGMENTS, TWIN, FLOW, SNOW = "ABCDSPFN"
"""Letters of the types that code outside of products/images means in particular."""
OF_NEXT_FRAME = {FLOW, SNOW}
"""Letters of the types that tell where things are seen in the next frame, which is simulated for them."""


class ImageType(NamedTuple):
    """One line of the registry."""

    product: str
    """Module of products/images, and the product's name in it."""
    words: str
    """What it shows, for the help of scene files."""


IMAGE_TYPES = {
    WATER: ImageType("radiance.WATER_IMAGE", "underwater"),
    AMBIENT: ImageType("radiance.AMBIENT_IMAGE", "without water in uniform light"),
    NORMALS: ImageType("normals.NORMAL_IMAGE", "normals"),
    DEPTH: ImageType("depth.DEPTH_IMAGE", "depth"),
    SEGMENTS: ImageType("segments.SEGMENT_IMAGE", "objects"),
    TWIN: ImageType("radiance.TWIN_IMAGE", "the twin of A without port, distortion, vignetting and shutter"),
    FLOW: ImageType("flow.FLOW_IMAGE", "optical flow"),
    "T": ImageType("transmittance.TRANSMITTANCE_IMAGE", "transmittance of the water"),
    SNOW: ImageType("snow.SNOW_IMAGE", "bodies in the water: marine snow"),
    "U": ImageType("purity.PURITY_IMAGE", "purity: share of the pixel that shows its object of S"),
}
"""The image types by letter, in the order in which images are made, written and listed."""

if TYPE_CHECKING:
    ImageLetter = str
else:
    ImageLetter = Literal[tuple(IMAGE_TYPES)]
