"""The API reference, built from docstrings by pdoc: a part of the site of `make docs`.

Fails if a link leads nowhere, or if a docstring names a module or member of this project that does
not exist.
"""

import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import mujoco  # noqa: F401  (it runs a program when it is imported, which pdoc refuses)
import pdoc

PACKAGES = ("laisn_sim", "laisn", "sim", "reports", "experiments", "models")
FOLDER = Path("out") / "reference"
_REFERENCES = re.compile(rf"<code>((?:{'|'.join(PACKAGES)})(?:\.\w+)+)</code>")
"""A dotted name in back quotes that pdoc did not turn into a link."""
_LINK = re.compile(r'href="([^":$]*?)(?:#([^"]*))?"')


def _exists(name: str) -> bool:
    """Whether a dotted name is a module, or a member of one."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            target: object = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for name_part in parts[count:]:
            if not hasattr(target, name_part):
                return False
            target = getattr(target, name_part)
        return True
    return False


def broken_references(folder: Path) -> Iterator[str]:
    """A line for each link of the pages in a folder that leads nowhere, and for each unknown
    name.
    """
    pages = {path: path.read_text(encoding="utf-8") for path in sorted(folder.rglob("*.html"))}
    anchors = {path: set(re.findall(r'id="([^"]*)"', text)) for path, text in pages.items()}
    for path, text in pages.items():
        for target, anchor in set(_LINK.findall(text)):
            page = (path.parent / target).resolve() if target else path
            # pdoc names private base classes and leaves them out of the pages
            if page not in anchors or (
                anchor and not anchor.startswith("_") and anchor not in anchors[page]
            ):
                yield f"{path.relative_to(folder)}: {target}#{anchor} does not exist"
        for name in set(_REFERENCES.findall(text)):
            if not _exists(name):
                yield f"{path.relative_to(folder)}: {name} does not exist"


def build(folder: Path = FOLDER) -> list[str]:
    """Write the reference into a folder and list its broken references."""
    pdoc.render.configure(docformat="google", show_source=False)
    pdoc.pdoc(*PACKAGES, output_directory=folder.resolve())
    return list(broken_references(folder.resolve()))


if __name__ == "__main__":
    broken = build()
    print(*broken, f"{FOLDER / 'index.html'}: {len(broken)} broken references", sep="\n")
    sys.exit(bool(broken))
