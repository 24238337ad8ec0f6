"""Scene files that come with the package, to begin with."""

from varos_warp.errors import InputError, did_you_mean
from varos_warp.scene.file.load import DATA

SCHEMA_FILE = "varos-warp.schema.json"
"""What the JSON Schema is called that `varos-warp init` writes beside a scene."""
TEMPLATES = {
    "starter": "a pipe on supports over sand; every block with comments",
    "pipeline_inspection": "along a pipeline with field joints, an anode, a flange and boulders",
    "harbour_wall": "along a wall of sheet piles with fenders, a ladder, a chain and rubble, in coastal water",
    "hull": "along a ship's side with draught figures, anodes, a sea chest and a bilge keel, in harbour water",
    "kelp_reef": "over boulders with kelp, crusts and animals, and seagrass between them, by night",
    "calibration": "a checkerboard before a stereo pair behind flat ports, in poses that a calibration needs",
    "calibration_camera": "a checkerboard in water before a camera without a port, to all corners of its image",
    "calibration_imu": "a checkerboard before a camera and an IMU that are moved and turned about all axes",
    "stereo_survey": "a lawn mower over a boulder field, a stereo pair looking down",
    "static_observer": "a camera that stands in the world watches a vehicle's lights at a valve",
    "turbid_water": "a valve in turbid coastal water, where backscatter hides most",
}
"""Names of the templates, and what they show."""


def template_text(name: str = "starter") -> str:
    """A commented scene file that loads and renders without any other file.

    It begins with the comment by which editors find the JSON Schema beside it.

    Args:
        name: One of TEMPLATES; hyphens count as underscores.

    Raises:
        InputError: There is no such template.
    """
    known = name.replace("-", "_")
    if known not in TEMPLATES:
        raise InputError(
            "there is no such template",
            key="--template",
            value=name,
            remedy=did_you_mean(known, TEMPLATES) or f"Use one of {', '.join(TEMPLATES)}.",
        )
    path = DATA / ("starter.yaml" if known == "starter" else f"templates/{known}.yaml")
    return f"# yaml-language-server: $schema={SCHEMA_FILE}\n{path.read_text(encoding='utf-8')}"
