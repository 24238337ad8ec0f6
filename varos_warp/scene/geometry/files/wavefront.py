"""Lines of Wavefront files (OBJ and MTL): comments, continued lines, and names in any encoding."""

import re

GEOMETRY = rb"v|vt|vn|vp|f|fo|l|p|curv2?|surf|cstype|deg|step|bmat|parm|trim|hole|scrv|sp|end|con"
"""Keywords of OBJ whose lines are numbers."""
STATEMENTS = rb"(?!newmtl)[^\s#\\]+"
"""Keywords of MTL whose lines a backslash continues: all but that of a name."""


def text_of(data: bytes) -> bytes:
    """The text of a file without a byte order mark, its lines ended by line feeds alone."""
    return data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def joined(text: bytes, keywords: bytes) -> bytes:
    r"""The text with the lines of some keywords in one, where a backslash at the end continues them.

    Comments and names end with their line, even in a backslash: ``o C:\models\`` swallows nothing.
    """
    if b"\\\n" not in text:
        return text
    lines = re.compile(rb"^[ \t]*(?:" + keywords + rb")(?=[ \t\\])(?:[^\n#]*\\\n)+", re.M | re.I)
    return lines.sub(lambda match: match[0].replace(b"\\\n", b" "), text)


def without_comments(text: bytes, keywords: bytes) -> bytes:
    """The text without what follows # in the lines of some keywords; in names, # is a letter like others."""
    if b"#" not in text:
        return text
    return re.sub(rb"^([ \t]*(?:" + keywords + rb")[ \t][^\n#]*)#[^\n]*", rb"\1", text, flags=re.M)


def name_of(rest: bytes) -> str:
    """A name in a file; bytes that are not UTF-8 stay what they are, so that files are found by them."""
    return rest.strip().decode("utf-8", "surrogateescape")


def shown(name: str) -> str:
    r"""A name for a message: bytes that are not UTF-8 as ``\xe9``."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def without_comment(name: str) -> str:
    """A name without what stands behind a blank and #: a comment, unless it belongs to the name."""
    return re.split(r"\s#", name, maxsplit=1)[0].rstrip()
