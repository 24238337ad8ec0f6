"""YAML of plain values: what a scene file needs, and nothing that can grow, recurse or make anything else.

Aliases count as often as what they stand for is repeated. Tags make nothing but the types of JSON.
"""

import re
from pathlib import Path
from typing import Any

import yaml

from varos_warp.errors import InputError

MOST_NODES = 1_000_000
"""Most values of a file, each alias counted with all that it stands for; a scene of 100 000 poses has 800 000."""
DEEPEST = 100
"""Most levels of blocks within blocks."""
BOOL, TEXT = "tag:yaml.org,2002:bool", "tag:yaml.org,2002:str"


class PlainLoader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]  # libyaml where it is there
    """Reads what `yaml.SafeLoader` reads, and refuses what no file can hold as text."""

    def construct_object(self, node, deep=False):
        """Whatever a tag cannot be made of is an error of the file."""
        try:
            return super().construct_object(node, deep)
        except (LookupError, ValueError, TypeError, AttributeError, OverflowError) as error:
            problem = f"this is no {node.tag.rpartition(':')[2]} ({error})"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark) from error

    def construct_scalar(self, node):
        """Text that can be written: neither half of a surrogate pair, nor NUL."""
        text = super().construct_scalar(node)
        if isinstance(text, str) and ("\0" in text or re.search("[\ud800-\udfff]", text)):
            raise yaml.constructor.ConstructorError(
                None, None, "text with a character that no file holds", node.start_mark
            )
        return text


for _tag in ("binary", "set", "omap", "pairs"):
    PlainLoader.add_constructor(f"tag:yaml.org,2002:{_tag}", yaml.SafeLoader.construct_undefined)


def read(text: str, file: Path, loader: type = PlainLoader) -> tuple[Any, dict[tuple, int]]:
    """Data of a file's YAML document, and the line of every key by its path.

    Args:
        loader: `PlainLoader`, or one that knows more tags.

    Raises:
        InputError: It is not valid YAML, beyond the limits, or gives a key twice.
    """
    try:
        node = compose(text, loader)
        lines: dict[tuple, int] = {}
        if node is not None:
            _collect_lines(node, (), lines, file, set())
        return construct(node, loader), lines
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "cannot be parsed"
        raise InputError(
            f"is not valid YAML: {problem}",
            file=file,
            line=mark.line + 1 if mark else None,
            remedy=escapes(problem) or "Check indentation, colons and brackets there.",
        ) from None
    except InputError:
        raise
    except (ValueError, RecursionError) as error:  # such as a date that does not exist
        raise InputError(f"is not valid YAML: {error}", file=file, remedy="Quote the value if it is text.") from None


def escapes(problem: str) -> str | None:
    """The remedy for what YAML says of a backslash in double quotes, such as that of a path of Windows."""
    if "escape character" in problem or "hexdecimal" in problem:
        return "Write / instead of \\ in paths, and text with \\ in single quotes."
    return None


def parse(text: str) -> Any:
    """Data of a YAML document; raises `yaml.YAMLError` if it is not valid, or beyond the limits."""
    return construct(compose(text))


def compose(text: str, loader: type = PlainLoader) -> yaml.Node | None:
    """Node of a YAML document, for lines; raises as `parse` does."""
    _check_size(text)
    node = yaml.compose(text, Loader=loader)
    _check_keys(node, set())
    return node


def construct(node: yaml.Node | None, loader: type = PlainLoader) -> Any:
    """Data of a node, whose merged blocks are then written out in it; raises as `parse` does."""
    return None if node is None else loader("").construct_document(node)


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
                raise InputError(
                    "is given twice",
                    file=file,
                    line=line,
                    key=".".join(map(str, inner)),
                    remedy=f"Keep one; the first is in line {lines[inner]}.",
                )
            lines[inner] = line
            _collect_lines(value, inner, lines, file, seen)


def _check_size(text: str) -> None:
    """Count values, before any is made: an alias counts as all that it stands for."""
    count, sizes, open_blocks = 0, {}, []
    for event in yaml.parse(text, Loader=PlainLoader):
        problem = None
        if isinstance(event, yaml.CollectionStartEvent):
            open_blocks.append((event.anchor, count))
            problem = f"more than {DEEPEST} blocks within blocks" if len(open_blocks) > DEEPEST else None
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_blocks.pop()
            sizes[anchor] = count + 1 - before
        elif isinstance(event, yaml.AliasEvent):
            count += sizes.get(event.anchor, 0)
            if event.anchor in (anchor for anchor, _ in open_blocks):
                problem = "an alias stands for a block that it lies in"
        elif isinstance(event, yaml.ScalarEvent):
            sizes[event.anchor] = 1
        count += isinstance(event, yaml.NodeEvent)
        if count > MOST_NODES:
            problem = f"more than {MOST_NODES} values, with aliases written out"
        if problem:
            raise yaml.composer.ComposerError(None, None, problem, event.start_mark)


def _check_keys(node: yaml.Node | None, seen: set[int]) -> None:
    """Keys of all blocks are words, before anything looks at them; ``on`` is one too, though YAML 1.1 calls it true."""
    if not isinstance(node, yaml.CollectionNode) or id(node) in seen:
        return
    seen.add(id(node))
    for item in node.value:
        if isinstance(item, tuple) and not isinstance(item[0], yaml.ScalarNode):
            raise yaml.constructor.ConstructorError(None, None, "a key is a word, not a block", item[0].start_mark)
        if isinstance(item, tuple) and item[0].tag == BOOL:
            item[0].tag = TEXT
        for inner in item if isinstance(item, tuple) else (item,):
            _check_keys(inner, seen)
