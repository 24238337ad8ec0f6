"""The report: one HTML page of a whole dataset that needs no other file and no network, and the contact sheet.

Made of the templates in ``data/report``, with style and scripts put in; what the scripts show stands in it as JSON.
"""

import base64
import hashlib
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

import varos_warp
from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.report import facts
from varos_warp.dataset.report.course import course_pictures, scene_parts
from varos_warp.dataset.report.curves import attenuation, curves
from varos_warp.dataset.write.pictures import Filmstrip, filmstrip
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.scene.description.image_types import DEPTH

SCRIPTS = ("app.js", "plots.js", "start.js")
PAGES = Environment(loader=PackageLoader("varos_warp", "data/report"), autoescape=True, undefined=StrictUndefined)
PAGES.policies["json.dumps_kwargs"] = {"ensure_ascii": False, "allow_nan": False, "separators": (",", ":")}


def write_report(data: Dataset, path: Path, quiet: bool = True) -> Path:
    """Write one HTML page that needs no other file; its size stays below 20 MB however long the dataset is.

    Raises:
        InputError: If something in the dataset cannot be read.
    """
    strip, scene = filmstrip(data, quiet), scene_parts(data)
    return write_page(
        path,
        "report.html",
        title=data.meta["name"],
        root=data.root.absolute().name,
        tiles=facts.headline(data),
        content=_content(data, strip),
        data=data,
        facts=facts,
        warnings=facts.warnings(data, scene.warnings),
        course=course_pictures(data, scene),
        missing=scene.missing,
        strip=strip,
        depths=_depths() if DEPTH in data.outputs else None,
    )


def write_page(path: Path, template: str, *, content: dict[str, Any], **shown: Any) -> Path:
    """Write a page of the report's form, with a template of data/report.

    ``content`` is what its scripts draw, as data/report/start.js has it; ``shown`` what else the template names: its
    ``title``, ``root``, of what it tells, and ``tiles``, (value, name) of what stands first.
    """
    script = "\n".join(map(_text, SCRIPTS))
    script_hash = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    page = PAGES.get_template(template).render(
        version=varos_warp.__version__,
        style=Markup(_text("page.css")),
        script=Markup(script),
        script_hash=script_hash,
        content=content,
        **shown,
    )
    files.write_bytes(path, page.encode())
    return path


def _text(name: str) -> str:
    return (resources.files("varos_warp") / "data" / "report" / name).read_text(encoding="utf-8")


# ------------------------------------------------------------------------------------------------- what scripts draw


def _content(data: Dataset, strip: Filmstrip) -> dict[str, Any]:
    """Everything that the page's scripts show."""
    times = data.views()[0][np.searchsorted(data.frames, strip.frames)] * 1e-9
    return {
        "frames": strip.frames,
        "times": times.tolist(),
        "cameras": [{"id": camera} for camera in data.cameras],
        "images": strip.images,
        "outputs": [{"letter": o, "content": OUTPUTS[o].content} for o in data.outputs],
        "plots": curves(data, times),
        "attenuation": attenuation(data),
    }


def _depths() -> str:
    """Colours of D from near to far, for a gradient in CSS."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return ", ".join(to_hex(colormaps["viridis"](1 - i / 8)) for i in range(9))
