"""YAML files that hold keys and values: their data, and the line of every key."""

from pathlib import Path

import yaml
from pydantic import BaseModel

from varos_warp.errors import InputError
from varos_warp.files import read_text
from varos_warp.scene.file import plain_yaml
from varos_warp.scene.file.source import Source

OPENCV = "%YAML:1.0"
"""What OpenCV writes, and reads, in the first line; in YAML it would be a directive without a blank."""


def parse_file(path: Path, what: str, remedy: str, model: type[BaseModel]) -> Source:
    """Data and line numbers of a YAML file.

    Args:
        path: The file.
        what: Its name in messages.
        remedy: What to do where there is no such file.
        model: What the data are to be.

    Raises:
        InputError: It cannot be read, is not YAML, repeats a key, or is no mapping of keys to values.
    """
    text = read_text(path, what, remedy)
    try:
        node = plain_yaml.compose(text.replace(OPENCV, "", 1) if text.startswith(OPENCV) else text)
        lines: dict[tuple, int] = {}
        if node is not None:
            _collect_lines(node, (), lines, path, set())
        data = plain_yaml.construct(node)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "cannot be parsed"
        raise InputError(f"is not valid YAML: {problem}", file=path, line=mark.line + 1 if mark else None,
                         remedy=escapes(problem) or "Check indentation, colons and brackets there.") from None
    except InputError:
        raise
    except (ValueError, RecursionError) as error:  # such as a date that does not exist
        raise InputError(f"is not valid YAML: {error}", file=path, remedy="Quote the value if it is text.") from None
    if data is None:
        raise InputError(f"the {what} is empty", file=path, remedy=remedy)
    if not isinstance(data, dict):
        raise InputError(f"a {what} is a mapping of keys to values, this is a {type(data).__name__}", file=path,
                         remedy=remedy)
    return Source(data, model, path, lines)


def escapes(problem: str) -> str | None:
    """The remedy for what YAML says of a backslash in double quotes, such as that of a path of Windows."""
    if "escape character" in problem or "hexdecimal" in problem:
        return "Write / instead of \\ in paths, and text with \\ in single quotes."
    return None


def _collect_lines(node, path, lines, file, seen):
    """Note the line of every key under a YAML node; a key given twice is an error, for the first would be lost."""
    if id(node) in seen:  # an alias
        return
    seen.add(id(node))
    if isinstance(node, yaml.SequenceNode):
        for i, item in enumerate(node.value):
            lines[*path, i] = item.start_mark.line + 1
            _collect_lines(item, (*path, i), lines, file, seen)
    elif isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            inner, line = (*path, key.value), key.start_mark.line + 1
            if inner in lines and key.value != "<<":
                raise InputError("is given twice", file=file, line=line, key=".".join(map(str, inner)),
                                 remedy=f"Keep one; the first is in line {lines[inner]}.")
            lines[inner] = line
            _collect_lines(value, inner, lines, file, seen)
