"""The card of a publication: README.md with the header that Hugging Face reads. Its numbers come from the datasets."""

from pathlib import Path

import numpy as np
import yaml
from facts import LICENCES, Facts

import varos_warp as vw
from varos_warp.dataset.write.checksums import sha256
from varos_warp.errors import counted

SIZES = ((1e3, "n<1K"), (1e4, "1K<n<10K"), (1e5, "10K<n<100K"), (1e6, "100K<n<1M"), (np.inf, "n>1M"))
"""Names that Hugging Face has for numbers of rows."""

BODY = """
# {name}

{what} All have the same course, seed and geometry, and only the water differs. The images that do not
depend on it, and the readings of the sensors, are the same byte by byte: in the archive they are hard links.

![Frames of {first}, with every type of image](contact_sheet.png)

## Files

{files}

`SHA256SUMS` has the sums of all files: `sha256sum -c SHA256SUMS`. Each dataset in the archive has a list `checksums` of
its own.

## Waters

Coefficients of red, green and blue in 1/m; attenuation is scattering and absorption together.

{waters}

## Cameras

{cameras}

{baseline}. Poses of the vehicle and the cameras are exact.

## What each image is

{images}

Each sequence has {frames} frames, {rate:g} per second; {sensors}. `README.txt` in each dataset has all conventions, and
`dataset.json` the whole scene.

## Read it

    tar xf {archive}

```python
import varos_warp as vw                  # of version {version}, or newer

data = vw.Dataset("{name}/{first}")
frame = data[0]                          # data[0, "{second}"]: through another camera
frame.A, frame.D, frame.T_w_c, frame.K   # sRGB, metres, camera to world, intrinsics
```

numpy and Pillow are enough, too: see the end of README.txt.

## How it was made

By varos_warp {version}{commit}, on {machine}:

    {command}

This renders the scene `{scene}`, of which dataset.json has every key. Light is scattered any number of times; A has
{spp}; its denoiser: {denoiser}.{noise}

Surfaces, course and waters are made up, and no sun shines: check on footage of your own what you conclude.

Licence: [{licence}]({licence_url}). Please cite varos_warp, and the VAROS paper whose layout it follows (Zwilgmeyer et
al., ICCV Workshops 2021).
"""


def write_card(facts: Facts, archive: Path, index: Path, place: Path) -> Path:
    """Write the card, and return its path."""
    path = place / "README.md"
    header = yaml.safe_dump(yaml_header(facts, index), sort_keys=False, allow_unicode=True)
    path.write_text(f"---\n{header}---\n{BODY.format(**words(facts, archive, index))}", encoding="utf-8")
    return path


def yaml_header(facts: Facts, index: Path) -> dict:
    """What Hugging Face reads."""
    return {
        "pretty_name": facts.name,
        "license": facts.licence,
        "task_categories": ["depth-estimation", "image-to-image", "object-detection"],
        "tags": ["underwater", "synthetic", "stereo", "optical-flow", "visual-odometry", "croissant"],
        "size_categories": [next(name for most, name in SIZES if facts.rows < most)],
        "configs": [{"config_name": "frames", "data_files": index.name}],
    }


def words(facts: Facts, archive: Path, index: Path) -> dict[str, object]:
    """What stands in the places of the text."""
    data = facts.datasets[0]
    meta = data.meta
    return {
        "name": facts.name,
        "kind": facts.kind,
        "version": facts.version,
        "archive": archive.name,
        "commit": f", commit {facts.commit}" if facts.commit else "",
        "licence": facts.licence,
        "licence_url": LICENCES[facts.licence],
        "scene": meta["name"],
        "first": data.root.name,
        "second": data.cameras[-1],
        "frames": len(data),
        "rate": meta["frames"]["rate_hz"],
        "what": f"{facts.images} images in {len(facts.datasets)} waters: {len(data)} frames through "
        f"{len(data.cameras)} cameras in each.",
        "files": files(facts, archive, index),
        "waters": waters(facts),
        "cameras": cameras(data),
        "baseline": baseline(data),
        "images": images(facts),
        "sensors": sensors(data),
        "machine": meta["device"]["model"],
        "command": facts.command,
        **quality(facts),
    }


def table(head: list[str], rows: list[list[object]]) -> str:
    """A table of Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def files(facts: Facts, archive: Path, index: Path) -> str:
    """Sizes and checksums of what is published."""
    rows = [
        [f"`{path.name}`", what, f"{path.stat().st_size:,}", f"`{sha256(path)}`"]
        for path, what in ((archive, f"{len(facts.datasets)} datasets"), (index, f"{facts.rows} views"))
    ]
    return table(["file", "what", "bytes", "SHA-256"], rows)


def waters(facts: Facts) -> str:
    """Coefficients of each water; none of what is no water."""

    def numbers(values: list[float]) -> str:
        return ", ".join(f"{value:.4g}" for value in values)

    rows = []
    for data in facts.datasets:
        water = data.meta["water"]
        about = [numbers(water[key]) for key in ("sigma_s", "sigma_a", "sigma_t")]
        bodies = "yes" if water.get("particles") else "no"
        phase = water["phase"] if any(water["sigma_s"]) else "none"
        rows.append([f"`{data.root.name}`", kind(data), *about, phase, bodies])
    return table(["folder", "water", "scattering", "absorption", "attenuation", "phase function", "marine snow"], rows)


def kind(data: vw.Dataset) -> str:
    """Which water it is: its form in the scene, with the Jerlov type."""
    given = data.meta["scene"]["water"]
    return (
        f"Jerlov {given['jerlov']['type']}"
        if isinstance(given, dict) and given.get("jerlov")
        else (data.meta["water"]["source"])
    )


def cameras(data: vw.Dataset) -> str:
    """Resolution and intrinsics of each."""
    rows = []
    for camera in data.cameras:
        about, K = data.camera(camera), data.intrinsics(camera, "opencv")
        rows.append(
            [
                f"`{camera}`",
                f"{about['width']} x {about['height']}",
                f"{K[0, 0]:.6g}, {K[1, 1]:.6g}",
                f"{K[0, 2]:.6g}, {K[1, 2]:.6g}",
            ]
        )
    return table(["camera", "pixels", "focal lengths [px]", "principal point [px], OpenCV's"], rows)


def baseline(data: vw.Dataset) -> str:
    """How far the last camera is from the first."""
    first, last = (data[0, camera].T_w_c[:3, 3] for camera in (data.cameras[0], data.cameras[-1]))
    return f"{data.cameras[-1]} is {np.linalg.norm(last - first):.4g} m from {data.cameras[0]}"


def images(facts: Facts) -> str:
    """What the dataset says of each type."""
    rows = [[f"`{letter}`", facts.meaning(letter)] for letter in facts.datasets[0].outputs]
    return table(["type", "what it is"], rows)


def sensors(data: vw.Dataset) -> str:
    """Names and rates."""
    each = [f"`{name}` at {about['rate_hz']:g} Hz" for name, about in data.meta["sensors"].items()]
    return f"sensors: {', '.join(each) or 'none'}"


def quality(facts: Facts) -> dict[str, str]:
    """Samples, denoiser, and noise of the sensor."""
    spp = sorted({data.meta["samples"]["plan"]["spp"] for data in facts.datasets})
    meta = facts.datasets[0].meta
    noise = " A has the noise of a camera's sensor; `A_clean` is the same without." if meta.get("noise") else ""
    many = counted(spp[0], "sample") if len(spp) == 1 else f"{spp[0]} to {spp[-1]} samples"
    return {
        "spp": f"{many} per pixel",
        "denoiser": meta["samples"]["denoise"],
        "noise": noise,
    }
