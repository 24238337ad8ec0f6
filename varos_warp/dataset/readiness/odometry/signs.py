"""What two images alone tell of the step between them, without truth: the signs that a failure is forecast from."""

import numpy as np

from varos_warp.dataset.readiness.frames.features import Keypoints, paired
from varos_warp.dataset.readiness.odometry.tracking import REPROJECTION_PX, View, corners, follow
from varos_warp.dataset.readiness.opencv import opencv


def verified(view: View, here: Keypoints, there: Keypoints) -> tuple[int, float | None]:
    """How many matches by descriptor agree with one motion of the camera, and the share of the matches that do.

    The motion is an essential matrix by RANSAC, with the camera's calibration. Five matches always agree with one.
    """
    pairs = paired(here, there)
    if len(pairs) < 6:
        return 0, 0.0 if len(pairs) else None
    a, b = view.normalised(here.points[pairs[:, 0]]), view.normalised(there.points[pairs[:, 1]])
    seen = np.isfinite(a).all(1) & np.isfinite(b).all(1)
    if seen.sum() < 6:
        return 0, 0.0
    cv2 = opencv()
    E, mask = cv2.findEssentialMat(
        a[seen], b[seen], np.eye(3), method=cv2.USAC_ACCURATE, prob=0.999, threshold=REPROJECTION_PX * view.pixel
    )
    count = 0 if E is None or mask is None else int(np.count_nonzero(mask))
    return count, count / len(pairs)


def signs(
    view: View, before: np.ndarray, now: np.ndarray, here: Keypoints, there: Keypoints
) -> dict[str, float | None]:
    """Measure the signs of the step between two images uint8 [H, W], with ORB's keypoints of both."""
    count, share = verified(view, here, there)
    start = corners(before, np.zeros((0, 2)))
    found = follow(before, now, start)[1]
    return {
        "verified_matches": count,
        "verified_share": share,
        "tracked": int(found.sum()),
        "tracked_share": float(found.mean()) if len(found) else None,
    }
