"""What the benchmarks measure, and the command of each."""

import ast
from pathlib import Path

HERE = Path(__file__).parent
HIDDEN = ("benchmarks", "benchmarks.peers.worker")
"""This page, and what only others run."""


def commands() -> dict[str, str]:
    """Name of a module that can be run -> the first sentence of its text, without importing any."""
    found = {}
    for path in sorted(HERE.rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        name = ".".join(path.relative_to(HERE.parent).with_suffix("").parts).removesuffix(".__main__")
        if 'if __name__ == "__main__":' in source and name not in HIDDEN:
            found[name] = (ast.get_docstring(ast.parse(source)) or "").splitlines()[0]
    return found


if __name__ == "__main__":
    print("docs/benchmarks.md says more; `python -m NAME --help` lists the options.\n")
    for name, text in commands().items():
        print(f"python -m {name:<28} {text}")
