"""YAML files that hold keys and values: their data, and the line of every key."""

from pathlib import Path

from pydantic import BaseModel

from varos_warp.errors import InputError
from varos_warp.files import read_text
from varos_warp.scene import plain_yaml
from varos_warp.scene.file.source import Source

OPENCV = "%YAML:1.0"
"""What OpenCV writes, and reads, in the first line; in YAML it would be a directive without a blank."""


def parse_file(path: Path, what: str, remedy: str, model: type[BaseModel]) -> Source:
    """Data and line numbers of a YAML file.

    Raises:
        InputError: It cannot be read, is not YAML, repeats a key, or is no mapping of keys to values.
    """
    text = read_text(path, what, remedy)
    data, lines = plain_yaml.read(text.replace(OPENCV, "", 1) if text.startswith(OPENCV) else text, path)
    if data is None:
        raise InputError(f"the {what} is empty", file=path, remedy=remedy)
    if not isinstance(data, dict):
        raise InputError(
            f"a {what} is a mapping of keys to values, this is a {type(data).__name__}", file=path, remedy=remedy
        )
    return Source(data, model, path, lines)
