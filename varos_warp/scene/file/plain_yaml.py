"""YAML of plain values: what a scene file needs, and nothing that can grow, recurse or make anything else.

Aliases count as often as what they stand for is repeated. Tags make nothing but the types of JSON.
"""

import re
from typing import Any

import yaml

MOST_NODES = 1_000_000
"""Values of a file, each alias counted with all that it stands for; a scene of 100 000 poses has 800 000."""
DEEPEST = 100
"""Blocks within blocks."""


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
            raise yaml.constructor.ConstructorError(None, None, "text with a character that no file holds",
                                                    node.start_mark)
        return text


for _tag in ("binary", "set", "omap", "pairs"):
    PlainLoader.add_constructor(f"tag:yaml.org,2002:{_tag}", yaml.SafeLoader.construct_undefined)


def parse(text: str) -> Any:
    """Data of a YAML document; raises `yaml.YAMLError` if it is not valid, or beyond the limits."""
    return construct(compose(text))


def compose(text: str) -> yaml.Node | None:
    """Node of a YAML document, for lines; raises as `parse` does."""
    _check_size(text)
    node = yaml.compose(text, Loader=PlainLoader)
    _check_keys(node, set())
    return node


def construct(node: yaml.Node | None) -> Any:
    """Data of a node, whose merged blocks are then written out in it; raises as `parse` does."""
    return None if node is None else PlainLoader("").construct_document(node)


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
    """Keys of all blocks are words, before anything looks at them."""
    if not isinstance(node, yaml.CollectionNode) or id(node) in seen:
        return
    seen.add(id(node))
    for item in node.value:
        if isinstance(item, tuple) and not isinstance(item[0], yaml.ScalarNode):
            raise yaml.constructor.ConstructorError(None, None, "a key is a word, not a block", item[0].start_mark)
        for inner in item if isinstance(item, tuple) else (item,):
            _check_keys(inner, seen)
