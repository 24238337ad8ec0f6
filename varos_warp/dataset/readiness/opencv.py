"""OpenCV, which only readiness needs."""

from types import ModuleType

from varos_warp.errors import optional


def opencv() -> ModuleType:
    """Return the module cv2; an `InputError` says that it is not installed."""
    return optional("cv2", "OpenCV", "readiness", key="readiness")
