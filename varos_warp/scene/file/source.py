"""File and line of every key of a scene, for messages, also about what is found long after it was loaded."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from varos_warp.errors import InputError
from varos_warp.scene.description import Scene


@dataclass
class Source:
    """What a file says, and where. Two are always equal: where a scene stands is no part of what it is."""

    data: Any = field(compare=False)
    model: type[BaseModel] = field(compare=False)
    """What the data are to be."""
    file: Path | None = field(default=None, compare=False)
    lines: dict[tuple, int] = field(default_factory=dict, compare=False)
    """Line of every key, by its path."""
    overridden: dict[tuple, str] = field(default_factory=dict, compare=False)
    """What set a key instead of the file, such as ``--set seed=3``, by its path."""

    def where(self, path: tuple) -> dict[str, Any]:
        """File, line and key for a message about ``path``, or about the nearest block around it that has a line."""
        key = ".".join(str(part) for part in path) or None
        for end in range(len(path), -1, -1):
            if path[:end] in self.overridden:
                return {"file": self.overridden[path[:end]], "key": key}
            if path[:end] in self.lines:
                return {"file": self.file, "line": self.lines[path[:end]], "key": key}
        return {"file": self.file, "key": key}

    def value(self, path: tuple) -> Any:
        """What the file has at ``path``; None if nothing."""
        value = self.data
        for part in path:
            try:
                value = value[part]
            except (LookupError, TypeError):
                return None
        return value


@contextmanager
def located(scene: Scene) -> Iterator[None]:
    """Errors about keys of a scene that was loaded before name its file and the line, as those of loading do."""
    try:
        yield
    except InputError as error:
        found = _located(scene, error)
        if found is error:
            raise
        raise found from error


def _located(scene: Scene, error: InputError) -> InputError:
    """The error with file and line of its key in the scene file; itself if it is about something else."""
    source: Source | None = scene._source
    if source is None or source.file is None or error.key is None or error.line is not None:
        return error
    path = tuple(int(part) if part.isdecimal() else part for part in scene.key_in_file(error.key).split("."))
    if path[0] not in source.model.model_fields:
        return error
    if error.file is None:
        return error.but(**source.where(path))
    given = source.value(path)
    names = {(*path, i): name for i, name in enumerate(given)} if isinstance(given, list) else {path: given}
    for at, name in names.items():
        if isinstance(name, str) and scene.resolve(name) == Path(error.file):
            return error.but(problem=f"{error.problem} ({error.file})", **source.where(at), value=name)
    return error  # about the file of a dataset, or one that another file names
