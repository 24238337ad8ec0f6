"""Keypoints of ORB and SIFT: how many, whether they are found again, and whether their matches are right."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from varos_warp.dataset.readiness.frames.truth import Moves
from varos_warp.dataset.readiness.opencv import opencv

REPEATED_PX = 1.5
"""A keypoint is repeated if one of the next frame lies so near to its true place (Schmid et al. 2000)."""
INLIER_PX = 3.0
"""A match is right if it lies so near to the true place."""
MOST_ORB = 10_000
"""ORB keeps the strongest so many; SIFT keeps all."""
MOST_MATCHED = 2000
"""The strongest so many are matched."""
ORB_EDGE, ORB_PATCH = 19, 31
"""Pixels, of its pyramid's levels: ORB finds nothing nearer to the border (19 as in ORB-SLAM); size of a keypoint."""
BORDER = {"orb": ORB_EDGE / ORB_PATCH, "sift": 1.25}
"""Width of the image's border without keypoints, over their size. SIFT leaves out 5 pixels of an octave, where the
least size is 4.03."""


@dataclass(frozen=True)
class Keypoints:
    """Keypoints of one image, the strongest first; places as OpenCV counts them."""

    kind: str
    points: np.ndarray
    size: np.ndarray
    descriptors: np.ndarray | None


def detect(kind: str, gray: np.ndarray) -> Keypoints:
    """Keypoints at different places of uint8 [H, W]; ``kind``: orb or sift, with OpenCV's own thresholds."""
    cv2 = opencv()
    detector = (
        cv2.ORB_create(MOST_ORB, edgeThreshold=ORB_EDGE, patchSize=ORB_PATCH) if kind == "orb" else cv2.SIFT_create()
    )
    found, descriptors = detector.detectAndCompute(gray, None)
    if not found:
        return Keypoints(kind, np.zeros((0, 2)), np.zeros(0), None)
    table = np.array([(*p.pt, p.size, p.response) for p in found])
    _, first = np.unique(table[:, :3], axis=0, return_index=True)  # SIFT gives a place several orientations
    first = first[np.argsort(-table[first, 3], kind="stable")]
    return Keypoints(kind, table[first, :2], table[first, 2], descriptors[first])


def repeatability(here: Keypoints, there: Keypoints, moved: Moves) -> tuple[float | None, float | None]:
    """Share of keypoints that are found again in the next frame, and the share that chance alone would give.

    Those count that are not hidden there, and whose place there is not so near to the border that none is found.
    None where there are no such.
    """
    place, hidden = moved.of(here.points)
    edge, (height, width) = BORDER[here.kind] * here.size, moved.hidden.shape
    with np.errstate(invalid="ignore"):
        inside = ((place >= edge[:, None]) & (place <= np.array([width, height]) - 1 - edge[:, None])).all(1)
    counted = place[inside & ~hidden]
    if not len(counted):
        return None, None
    chance = 1.0 - np.exp(-len(there.points) * np.pi * REPEATED_PX**2 / (width * height))
    if not len(there.points):
        return 0.0, 0.0
    distance, _ = cKDTree(there.points).query(counted)
    return float((distance <= REPEATED_PX).mean()), float(chance)


def paired(here: Keypoints, there: Keypoints) -> np.ndarray:
    """Numbers [N, 2] of keypoints that are each other's nearest by descriptor."""
    if here.descriptors is None or there.descriptors is None:
        return np.zeros((0, 2), int)
    cv2 = opencv()
    norm = cv2.NORM_HAMMING if here.kind == "orb" else cv2.NORM_L2
    first, second = here.descriptors[:MOST_MATCHED], there.descriptors[:MOST_MATCHED]
    found = cv2.BFMatcher(norm, crossCheck=True).match(first, second)
    return np.array([(m.queryIdx, m.trainIdx) for m in found], int).reshape(-1, 2)


def matches(here: Keypoints, there: Keypoints, moved: Moves) -> tuple[int, float | None]:
    """How many keypoints are each other's nearest by descriptor, and the share of them that true flow confirms.

    Matches of points whose true place is not known are left out; those of what hides are wrong.
    """
    pairs = paired(here, there)
    place, hidden = moved.of(here.points[pairs[:, 0]])
    known = np.isfinite(place).all(1)
    if not known.any():
        return 0, None
    off = np.linalg.norm(place - there.points[pairs[:, 1]], axis=1)[known]
    return int(known.sum()), float(((off <= INLIER_PX) & ~hidden[known]).mean())
