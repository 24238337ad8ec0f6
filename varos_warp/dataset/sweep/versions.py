"""The versions of a sweep: what each changes in the scene, from a file or from options ``KEY=VALUE,VALUE``."""

import itertools
import json
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import yaml
from pydantic import Discriminator, Field, Tag, ValidationError, model_validator

from varos_warp.dataset.sweep.draws import Distribution
from varos_warp.errors import InputError
from varos_warp.files import is_file
from varos_warp.scene import plain_yaml
from varos_warp.scene.block import Block
from varos_warp.scene.file.load import Change, takes_the_place, validated
from varos_warp.scene.file.source import Source
from varos_warp.scene.file.yaml_files import parse_file

MOST = 10_000
"""Versions of a sweep."""
LONGEST = 80
"""Letters of a version's name."""
_NAME = re.compile(r"[0-9A-Za-z][0-9A-Za-z._=+-]*")
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?|sweep\.json|.*\.", re.IGNORECASE)
"""Names that Windows does not take for folders, and that of our own file."""
EXAMPLE = "For example --over 'water.jerlov.type=IB,II,1C', or a file with `versions:`."


class Version(NamedTuple):
    """One version of a scene."""

    name: str
    """Name of the version's folder."""
    changes: list[Change]
    """Changes that it makes to the scene."""

    @property
    def overrides(self) -> dict[str, Any]:
        """Values by key."""
        return {change.key: change.value for change in self.changes}


Values = Annotated[
    Annotated[list[Any], Tag("list")] | Annotated[Distribution, Tag("drawn")],
    Discriminator(lambda values: "drawn" if isinstance(values, dict) else "list"),
]


class SweepFile(Block):
    """What a file of a sweep may say: named versions, or values of keys, or distributions with a seed and a count."""

    versions: dict[str, dict[str, Any] | None] | None = None
    """Changes of each version, by its name: keys with dots, or blocks in which they stand, with values."""
    over: dict[str, Values] | None = None
    """Values of each key: a list, of all of which there is every combination; or what its values are drawn from."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] | None = None
    """Seed that all draws follow from."""
    count: Annotated[int, Field(ge=1, le=MOST)] | None = None
    """How many versions are drawn."""

    @model_validator(mode="after")
    def _one_form(self):
        if (self.versions is None) == (self.over is None):
            raise ValueError("give either versions or over")
        if not (self.versions or self.over):
            raise ValueError(f"{'over' if self.versions is None else 'versions'}: is empty; name at least one")
        drawn = [key for key, values in (self.over or {}).items() if isinstance(values, Distribution)]
        if drawn and len(drawn) < len(self.over or {}):
            raise ValueError("over: has lists and distributions; write a list that is drawn from as {choice: [...]}")
        for key in ("seed", "count"):
            if drawn and getattr(self, key) is None:
                raise ValueError(f"{key} is missing, which distributions need; add it")
            if not drawn and getattr(self, key) is not None:
                raise ValueError(f"{key}: is of distributions, and there are none; leave it out")
        return self


def read_versions(over: Sequence[str]) -> list[Version]:
    """The versions that options ``--over`` ask for: one file, or keys with values.

    Raises:
        InputError: If there are none, or one twice, or too many, or what asks for them is not of their form.
    """
    files = [text for text in over if "=" not in text or is_file(Path(text))]
    if not over or (files and len(over) > 1):
        problem = "is missing" if not over else "is a file, beside which nothing else can be given"
        raise InputError(problem, key="--over", value=next(iter(files), None), remedy=EXAMPLE)
    versions = _of_file(Path(files[0])) if files else _of_options(over)
    _check_names(versions, Path(files[0]) if files else None)
    return versions


def _of_file(path: Path) -> list[Version]:
    source = parse_file(path, "file of a sweep", EXAMPLE, SweepFile)
    _check_words(source)
    given = validated(source)

    def changes(above: tuple, block: dict[str, Any], of: str = "") -> list[Change]:
        return [Change(key, value, _place(source, above, key) + of) for key, value in _leaves(block)]

    if given.versions is not None:
        return [Version(name, changes(("versions", name), block or {})) for name, block in given.versions.items()]
    if given.seed is None:
        return _combined(given.over, {key: _place(source, ("over",), key) for key in given.over}, path)
    return [
        Version(
            f"{i:04d}",
            changes(
                ("over",),
                {key: values.draw(given.seed, key, i) for key, values in given.over.items()},
                f", version {i:04d}",
            ),
        )
        for i in range(given.count)
    ]


def _check_words(source: Source) -> None:
    """Refuse names and keys that YAML takes for numbers: what was written is not known any more."""
    for name in ("versions", "over"):
        block = source.data.get(name)
        for key in block if isinstance(block, dict) else ():
            if not isinstance(key, str):
                raise InputError(
                    "is read as a number, not as a name", **source.where((name, str(key))), remedy=f"Quote it: '{key}'."
                )


def _place(source: Source, above: tuple, key: str) -> str:
    """File and line of a key; ``above``: the block in which it stands, as it is written or in parts."""
    parts = key.split(".")
    known = [
        line
        for end in range(len(parts) + 1)
        for path, line in source.lines.items()
        if path[: len(above)] == above and ".".join(map(str, path[len(above) :])) == ".".join(parts[:end])
    ]
    return f"{source.file}:{known[-1]}" if known else str(source.file)


def _of_options(over: Sequence[str]) -> list[Version]:
    values: dict[str, list] = {}
    for text in over:
        key, _, listed = text.partition("=")
        key = key.strip()
        try:
            found = plain_yaml.parse(f"[{listed}]")
        except (yaml.YAMLError, ValueError, RecursionError):
            found = None
        if not found or not key:
            raise InputError("is not of the form KEY=VALUE,VALUE", key="--over", value=text, remedy=EXAMPLE)
        if key in values:
            raise InputError("is given twice", key=f"--over {key}", remedy="Give all its values at once.")
        if drawn := [value for value in found if _is_distribution(value)]:
            raise InputError(
                "is a distribution, which stands in a file, with a seed and a count",
                key=f"--over {key}",
                value=drawn[0],
                remedy="Write a file as docs/howto/sweeps.md shows, and give that: --over drawn.yaml.",
            )
        values[key] = found
    return _combined(values, {key: f"--over {key}" for key in values}, None)


def _is_distribution(value: Any) -> bool:
    try:
        return isinstance(value, dict) and bool(Distribution.model_validate(value))
    except ValidationError:
        return False


def _combined(values: dict[str, list], where: dict[str, str], file: Path | None) -> list[Version]:
    """A version for each combination of the values of keys; the last key changes first."""
    for key, listed in values.items():
        if not listed:
            raise InputError("is empty", file=file, key=f"over.{key}", remedy="Give at least one value.")
        for i, value in enumerate(listed):
            if value in listed[:i]:
                name = f"over.{key}" if file else where[key]
                raise InputError("is given twice", file=file, key=name, value=value, remedy="Keep one.")
    if (count := math.prod(map(len, values.values()))) > MOST:
        raise InputError(
            f"asks for {count} versions, and {MOST} are the most",
            file=file,
            key="over",
            remedy="Give fewer values, or distributions with a count.",
        )
    labels = {key: [_label(value, i) for i, value in enumerate(listed)] for key, listed in values.items()}
    return [
        Version(
            "-".join(labels[key][i] for key, i in zip(values, chosen, strict=True)),
            [
                Change(inner, value, where[key])
                for key, i in zip(values, chosen, strict=True)
                for inner, value in _leaves({key: values[key][i]})
            ],
        )
        for chosen in itertools.product(*(range(len(listed)) for listed in values.values()))
    ]


def _label(value: Any, number: int) -> str:
    """A value as a part of a name; a block or a list by its number."""
    if isinstance(value, dict | list):
        return str(number)
    text = json.dumps(value) if value is None or isinstance(value, bool) else str(value)
    return re.sub(r"[^0-9A-Za-z._=+-]+", "_", re.sub("^-", "minus", text)).strip("_.") or str(number)


def _leaves(block: dict[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Keys with dots and values of a block: of what blocks in it hold, each for itself."""
    for key, value in block.items():
        path = f"{above}{key}"
        if isinstance(value, dict) and value:
            yield from _leaves(value, f"{path}.")
        else:
            yield path, value


def _check_names(versions: list[Version], file: Path | None) -> None:
    """Refuse names that are no names of folders, or the same where upper and lower case are one."""
    seen: dict[str, str] = {}
    for name, changes in versions:
        if not _NAME.fullmatch(name) or _RESERVED.fullmatch(name) or len(name) > LONGEST:
            raise InputError(
                "is no name of a folder on every system",
                file=file,
                key="versions",
                value=name,
                remedy="Use letters, digits, -, _ and dots, the first a letter or digit; a file with "
                "`versions:` names them.",
            )
        if name.lower() in seen:
            but_for_case = ", but for upper and lower case" * (seen[name.lower()] != name)
            raise InputError(
                f"is the name of two versions{but_for_case}",
                file=file,
                key="versions",
                value=name,
                remedy="Give each a name of its own, in a file with `versions:`.",
            )
        seen[name.lower()] = name
        _check_changes(changes, f"versions.{name}." if file else "--over ", file)


def _check_changes(changes: list[Change], above: str, file: Path | None) -> None:
    """Refuse a change of which another of the same version would leave nothing."""
    for earlier, later in itertools.combinations(changes, 2):
        if takes_the_place(later.key, of=earlier):
            same = earlier.key == later.key
            raise InputError(
                "is given twice" if same else f"has no effect beside {later.key}, which takes its place",
                file=file,
                key=f"{above}{earlier.key}",
                value=None if same else earlier.value,
                remedy="Keep one.",
            )
