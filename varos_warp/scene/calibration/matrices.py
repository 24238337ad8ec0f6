"""Cameras as OpenCV's FileStorage and ROS's camera_info have them: a matrix K and coefficients D.

What the programs and samples of OpenCV, and people after them, call K, D and the image's size differs by case,
underscores and a few words. Of two cameras in one file, as those of OpenCV's stereo sample, names end in 1 and 2, or in
left and right. ROS names the model, OpenCV's samples at most whether it is a fisheye.
"""

import re
from collections.abc import Iterator
from dataclasses import replace

from varos_warp.scene.calibration.documents import Entry
from varos_warp.scene.calibration.models import OPENCV, Calibration, distortion
from varos_warp.scene.optics.distortion import KANNALA_BRANDT, canonical

K_NAMES = ("cameramatrix", "k", "m", "intrinsicmatrix", "cameraintrinsics")
D_NAMES = tuple(
    "distcoeffs distcoeff distcoefs distortioncoefficients distortioncoeffs distortioncoefs distortion dist d".split()
)
SIZE_NAMES, WIDTH_NAMES, HEIGHT_NAMES = ("imagesize", "resolution"), ("imagewidth", "width"), ("imageheight", "height")
SIDES = ("", "1", "2", "left", "right")
"""What names of one camera among several end in."""


class Names:
    """Entries of a block by what their names mean."""

    def __init__(self, block: Entry):
        self.block = block
        self.by_word: dict[str, list[Entry]] = {}
        for name, entry in block.items():
            self.by_word.setdefault(re.sub(r"[\s_\-.]", "", name).lower(), []).append(entry)

    def one(self, words: tuple[str, ...], side: str = "") -> Entry | None:
        """The entry whose name is one of some words, with a side behind it; None: there is none.

        Raises:
            InputError: There are several.
        """
        found = [entry for word in words for entry in self.by_word.get(word + side, ())]
        if len(found) > 1:
            found[1].refuse(f"stands beside {found[0].key}", "Keep one of them.")
        return found[0] if found else None


def cameras_of(block: Entry) -> Iterator[tuple[str, "Names"]]:
    """Name of each camera of a block, empty if it is the only one, and the block's entries."""
    names = Names(block)
    for side in SIDES:
        entry = names.one(K_NAMES, side)
        if entry is not None and isinstance(entry.value, dict | list):
            yield side, names


def read_camera(names: "Names", side: str) -> Calibration:
    """The calibration of one camera of a block.

    Raises:
        InputError: It is not had here, or something is missing or contradicts itself.
    """
    K, D = names.one(K_NAMES, side), names.one(D_NAMES, side)
    assert K is not None
    _of_whole_image(names)
    if D is None:
        names.block.refuse(
            f"has {K.key} but no coefficients of distortion",
            "Add them, as distortion_coefficients; without distortion, five zeros.",
        )
    return Calibration(_intrinsics(K), distortion(_model(names, side), D), _resolution(names, side))


def _intrinsics(K: Entry) -> tuple[float, float, float, float]:
    numbers = K.numbers()
    if len(numbers) != 9:
        K.refuse(f"has {len(numbers)} numbers, but a matrix of intrinsics has 9, row by row")
    fx, skew, cx, zero, fy, cy, *last = numbers
    if skew != 0.0:
        K.refuse(f"has a skew of {skew:g}, which no camera has here", "Calibrate without it (CALIB_FIX_SKEW).")
    if zero != 0.0 or last != [0.0, 0.0, 1.0]:
        K.refuse("is not of the form [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    return fx, fy, cx, cy


def _model(names: Names, side: str) -> Entry | None:
    """The entry that names the model; None: nothing does."""
    stated, flag, camera = (
        names.one(words, side) or names.one(words)
        for words in (("distortionmodel",), ("fisheyemodel", "fisheye"), ("cameramodel", "lensmodel"))
    )
    if camera is not None and canonical(camera.text().lower()) == "none":
        camera = None  # a pinhole, with whatever distortion
    if flag is not None:
        fisheye = flag.value if isinstance(flag.value, bool) else flag.whole()
        if fisheye not in (0, 1):
            flag.refuse("should be 0 or 1")
        named = stated.text().lower() if stated is not None else ""
        if stated is not None and named and bool(fisheye) != (canonical(named) == KANNALA_BRANDT):
            flag.refuse(f"contradicts {stated.key} = {stated.text()!r}", "Keep one of them.")
        flag = replace(flag, value=KANNALA_BRANDT if fisheye else OPENCV)
    return next((entry for entry in (stated, flag, camera) if entry is not None and entry.text()), None)


def _resolution(names: Names, side: str) -> tuple[int, int] | None:
    size = names.one(SIZE_NAMES, side) or names.one(SIZE_NAMES)
    width, height = (names.one(words, side) or names.one(words) for words in (WIDTH_NAMES, HEIGHT_NAMES))
    found = [] if width is None or height is None else [(width.whole(), height.whole())]
    if size is not None:
        sides = size.numbers()
        if len(sides) != 2 or any(number != int(number) for number in sides):
            size.refuse("should be width and height, two whole numbers")
        found.append((int(sides[0]), int(sides[1])))
    if len(set(found)) > 1:
        names.block.refuse(f"has the sizes {found[0]} and {found[1]}", "Keep one of them.")
    return found[0] if found else None


def _of_whole_image(names: Names) -> None:
    """Refuse binning and regions of interest of ROS, which leave a part of the image that K and D are of."""
    for word in ("binningx", "binningy"):
        entry = names.one((word,))
        if entry is not None and entry.whole() not in (0, 1):
            entry.refuse("bins pixels, for which K is not", "Write the camera_info of the full resolution.")
    region, whole = names.one(("roi",)), _resolution(names, "") or (0, 0)
    for word, uncut in zip(("x_offset", "y_offset", "width", "height"), (0, 0, *whole), strict=True):
        if region is not None and word in region and region[word].whole() not in (0, uncut):
            region[word].refuse(
                "cuts a region out of the image, for which K is not",
                "Write the camera_info of the full resolution, with 0 in all of roi.",
            )
