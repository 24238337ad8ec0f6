"""Reads a whole dataset back and checks it against itself: what does not agree is listed, the rest is measured.

Every check states its limit beside its measure. Limits come from rounding, quantisation, the order of a difference or
of an integration. What is held against what:

* `completeness`: files against dataset.json and ``checksums``; what a run has still to make is no damage.
* `metadata`: dataset.json against the scene in it; segments, rays and time stamps against both.
* `meshes`: the area of what was built against that of the faces in the mesh files, where these are at hand.
* `motion`: poses in three forms, cameras and sensors against the vehicle.
* `sensors`: readings of the sensors against the poses, by the check in each sensor's own file.
* `images`: PNG against EXR against the table of exposures; S against its table.
* `surfaces`: C against the slopes of D, borders of C and S against the jumps of D, holes.
* `objects`: S against the boxes of the scene's objects, by D and the poses.
* `views`: D, B, C and S of each frame against those of its neighbours, through K and the poses.
* `flows`: F against D and the poses of two frames.
* `blur`: how far an exposure blurs B, which `views` and `alignment` leave out where they could not tell.
* `alignment`: B warped into other frames and cameras by D, K and the poses, to a hundredth of a pixel.

Without checksums some damage cannot be seen, since nothing else tells of it: an A whose PNG, EXR and exposure row were
all replaced alike; images of frames between which nothing moves, or of a plane that is seen alike; all sensors deleted,
which leaves what `varos-warp render` makes; A_linear of another frame where A is denoised; notes, water and lights of
dataset.json that were changed together with the scene in it; changes below the limits that are printed.
"""

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.validate import alignment, completeness, images, meshes, metadata, motion, views
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.scene.description.image_types import DEPTH

__all__ = ["Validation", "validate"]


def validate(root, quiet: bool = False) -> Validation:
    """Read everything in a dataset back and check it against itself.

    Args:
        root: Folder of the dataset.
        quiet: No progress on stderr.

    Raises:
        InputError: If it is not a dataset at all.
    """
    data = Dataset(root)
    result, pending = Validation(data.root), completeness.Pending.of(data)
    for check in (
        completeness.check_complete,
        completeness.check_files,
        completeness.check_checksums,
        metadata.check_times,
    ):
        result.guard(check, data, result, pending)
    for check in (
        metadata.check_metadata,
        metadata.check_segments,
        metadata.check_rays,
        meshes.check_meshes,
        *motion.CHECKS,
    ):
        result.guard(check, data, result)
    images.check_images(data, result, pending, quiet)
    if DEPTH in data.outputs:
        result.guard(views.check_residuals, data, result, pending.ready(data))
        result.guard(views.check_neighbours, data, result, pending.ready(data), quiet)
    if not pending.files:  # B is exposed
        result.guard(alignment.check_alignment, data, result, data.frames, quiet)
    return result
