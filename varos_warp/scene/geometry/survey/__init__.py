"""Survey files become a sea floor: heights on a grid and points, read in float64 as their formats say."""

from varos_warp.scene.geometry.survey.read import Survey, read_survey

__all__ = ["Survey", "read_survey"]
