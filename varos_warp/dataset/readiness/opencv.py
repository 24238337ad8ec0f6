"""OpenCV, which only readiness needs."""

from types import ModuleType

from varos_warp.errors import InputError


def opencv() -> ModuleType:
    """The module cv2.

    Raises:
        InputError: If it is not installed.
    """
    try:
        import cv2
    except ImportError as error:
        raise InputError(
            "OpenCV is not installed", key="readiness", remedy='Install it with `pip install "varos_warp[readiness]"`.'
        ) from error
    return cv2
