"""The examples, executed: what each prints and draws, kept as long as neither it nor the program
changes.
"""

import ast
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = _ROOT / "examples"
OUTPUT = _ROOT / "out" / "gallery"
_PACKAGES = ("laisn", "sim", "reports", "experiments", "laisn_sim", "models")
_RESULT = "result.json"
_PICTURES = (".png", ".jpg", ".svg")
_TIMEOUT_S = 600
_CONCURRENT_EXAMPLES = 2  # examples that run at a time


@dataclass(frozen=True, kw_only=True)
class Executed:
    """An example, what it printed, and the pictures that it left."""

    name: str
    code: str
    output: str
    pictures: list[Path]

    @property
    def title(self) -> str:
        return self.name.replace("_", " ").capitalize()

    @property
    def description(self) -> str:
        """Its docstring."""
        return ast.get_docstring(ast.parse(self.code)) or ""

    @property
    def body(self) -> str:
        """Its code without the docstring."""
        lines = self.code.splitlines()
        first = ast.parse(self.code).body[0]
        return "\n".join(lines[first.end_lineno or 0 :]).strip("\n")


@cache
def _program_digest() -> str:
    """SHA-256 of the sources of the program."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted((_ROOT / package).rglob("*")):
            if path.suffix in (".py", ".xml", ".toml", ".j2"):
                digest.update(path.read_bytes())
    return digest.hexdigest()


def _key(code: str) -> str:
    """Of an example with this code and this program."""
    return hashlib.sha256(f"{_program_digest()}{code}".encode()).hexdigest()


def execute(path: Path, work: Path) -> Executed:
    """Run an example in an empty folder; RuntimeError with the end of what it reported if it
    fails.
    """
    code = path.read_text(encoding="utf-8")
    environment = os.environ | {"MPLBACKEND": "agg", "PYTHONPATH": str(_ROOT)}
    command = [sys.executable, str(path.resolve())]
    run = subprocess.run(
        command, cwd=work, env=environment, capture_output=True, text=True, timeout=_TIMEOUT_S
    )
    if run.returncode:
        raise RuntimeError(f"{path}: {run.stderr[-2000:]}")
    pictures = sorted(file for file in work.iterdir() if file.suffix in _PICTURES)
    return Executed(name=path.stem, code=code, output=run.stdout, pictures=pictures)


def keep(example: Executed) -> None:
    """Keep what an example has printed and drawn, until it or the program changes; RuntimeError if
    it left no picture.
    """
    if not example.pictures:
        raise RuntimeError(f"{example.name}: left no picture; it printed: {example.output[-500:]}")
    folder = OUTPUT / example.name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for picture in example.pictures:
        shutil.copy(picture, folder / picture.name)
    names = [picture.name for picture in example.pictures]
    result = {"key": _key(example.code), "output": example.output, "pictures": names}
    (folder / _RESULT).write_text(json.dumps(result), encoding="utf-8")


def _kept_or_run(path: Path) -> Executed:
    """An example as it was run with this program before, or run now."""
    code = path.read_text(encoding="utf-8")
    folder = OUTPUT / path.stem
    record = folder / _RESULT
    if not record.exists() or json.loads(record.read_text(encoding="utf-8"))["key"] != _key(code):
        print(f"running {path.parent.name}/{path.name}", flush=True)
        with tempfile.TemporaryDirectory() as work:
            keep(execute(path, Path(work)))
    result = json.loads(record.read_text(encoding="utf-8"))
    pictures = [folder / name for name in result["pictures"]]
    return Executed(name=path.stem, code=code, output=result["output"], pictures=pictures)


def executed_examples() -> list[Executed]:
    """All examples in the order of their names; those run before with this program are taken from
    what was kept.
    """
    first, *others = sorted(EXAMPLES.glob("*.py"))
    # the first one alone: it stores compiled code that the others have in common
    examples = [_kept_or_run(first)]
    with ThreadPoolExecutor(_CONCURRENT_EXAMPLES) as pool:
        examples += pool.map(_kept_or_run, others)
    return examples


def page(examples: list[Executed], pictures_folder: str) -> str:
    """The gallery as Markdown; `pictures_folder` is that of the pictures, beside the page."""
    lines = [
        "# Examples",
        "",
        "Each was run when these pages were built; the files are in the folder `examples`.",
        "",
        '<div class="gallery">',
    ]
    for example in examples:
        picture = f"{pictures_folder}/{example.name}/{example.pictures[0].name}"
        words = example.title
        lines.append(
            f'<a href="#{anchor(example)}"><img src="{picture}" alt="" loading="lazy">'
            f"<span>{words}</span></a>"
        )
    lines += ["</div>", ""]
    for example in examples:
        lines += [f"## {example.title} {{ #{anchor(example)} }}", "", example.description, ""]
        lines += [f'``` {{ .python title="examples/{example.name}.py" }}', example.body, "```", ""]
        if example.output:
            lines += ['``` { .text title="prints" }', example.output.rstrip("\n"), "```", ""]
        for drawn in example.pictures:
            source = f"{pictures_folder}/{example.name}/{drawn.name}"
            lines += [f"![{example.title}: {drawn.stem}]({source})", ""]
    return "\n".join(lines)


def anchor(example: Executed) -> str:
    """The anchor (id of the heading) of an example on the page."""
    return example.name.replace("_", "-")
