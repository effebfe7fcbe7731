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
from pathlib import Path

EXAMPLES = Path("examples")
OUTPUT = Path("out") / "gallery"
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


def _program_digest() -> str:
    """SHA-256 of the sources of the program."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted(Path(package).rglob("*")):
            if path.suffix in (".py", ".xml", ".toml", ".j2"):
                digest.update(path.read_bytes())
    return digest.hexdigest()


def execute(path: Path, folder: Path) -> Executed:
    """Run an example in a folder of its own, which is emptied; RuntimeError with the end of what
    it reported if it fails, or if it leaves no picture.
    """
    code = path.read_text(encoding="utf-8")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as work:
        environment = os.environ | {"MPLBACKEND": "agg", "PYTHONPATH": str(Path.cwd())}
        command = [sys.executable, str(path.resolve())]
        run = subprocess.run(
            command, cwd=work, env=environment, capture_output=True, text=True, timeout=_TIMEOUT_S
        )
        if run.returncode:
            raise RuntimeError(f"{path}: {run.stderr[-2000:]}")
        pictures_left = sorted(file for file in Path(work).iterdir() if file.suffix in _PICTURES)
        if not pictures_left:
            raise RuntimeError(f"{path}: left no picture; it printed: {run.stdout[-500:]}")
        pictures = [Path(shutil.copy(file, folder / file.name)) for file in pictures_left]
    return Executed(name=path.stem, code=code, output=run.stdout, pictures=pictures)


def _kept_or_run(path: Path, folder: Path, program_digest: str) -> Executed:
    """An example as it was run with this program before, or run now."""
    code = path.read_text(encoding="utf-8")
    key = hashlib.sha256(f"{program_digest}{code}".encode()).hexdigest()
    record = folder / _RESULT
    if record.exists():
        result = json.loads(record.read_text(encoding="utf-8"))
        if result["key"] == key:
            pictures = [folder / name for name in result["pictures"]]
            return Executed(name=path.stem, code=code, output=result["output"], pictures=pictures)
    print(f"running {path}", flush=True)
    example = execute(path, folder)
    names = [picture.name for picture in example.pictures]
    result = {"key": key, "output": example.output, "pictures": names}
    record.write_text(json.dumps(result), encoding="utf-8")
    return example


def executed_examples(folder: Path = OUTPUT) -> list[Executed]:
    """All examples in the order of their names; those run before with this program are taken from
    what was kept.
    """
    program_digest = _program_digest()
    first, *others = sorted(EXAMPLES.glob("*.py"))
    # the first one alone: it stores compiled code that the others have in common
    examples = [_kept_or_run(first, folder / first.stem, program_digest)]
    with ThreadPoolExecutor(_CONCURRENT_EXAMPLES) as pool:
        examples += pool.map(
            lambda path: _kept_or_run(path, folder / path.stem, program_digest), others
        )
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
