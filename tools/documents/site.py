"""The documents as a site that works from disk: `make docs` writes it to out/site.

Pages of README and docs with their formulas, the gallery of executed examples, and the API
reference. Fails if a link of a page leads nowhere, a formula is none, or an example fails.
"""

import logging
import re
import shutil
import sys
import tempfile
import time
from pathlib import Path

import yaml
from mkdocs.commands.build import build as build_pages
from mkdocs.config import load_config

from tools.documents import gallery, reference
from tools.documents.formulas import with_formulas

FOLDER = Path("out") / "site"
_FILES = Path(__file__).parent / "site_files"
_HOME, _OVERVIEW = "index.md", "overview.md"
_COMMENT = re.compile(r"<!--.*?-->", re.S)
_LINK = re.compile(r"(?<=\]\()([^)#\s]+)")
_CHAPTERS = {
    "Start": ("tutorial", "concepts", "glossary", "limits"),
    "Use": (
        "scenario", "studies", "stepping", "links", "sea", "vehicles", "own-data", "log", "ros",
        "onboard", "benchmark", "speed",
    ),
    "Extend": ("extending", "plug-ins", "architecture"),
    "Background": ("physics", "algorithm", "tight", "tracking", "rivals"),
    "Results": ("reproduction", "asymmetry", "closed-loop", "formation", "real-ranges"),
}  # fmt: skip


def page_name(target: str, *, in_docs: bool) -> str:
    """Where a link leads on the site: a link of a page in docs with `in_docs`, else of README."""
    if re.match(r"\w+:", target):
        return target
    path = target
    if in_docs:
        path = target[3:] if target.startswith("../") else f"docs/{target}"
    example = re.fullmatch(r"examples/(\w+)\.py", path)
    module = re.fullmatch(r"(\w+(?:/\w+)*)\.py", path)
    if path == "docs/index.md":
        return _OVERVIEW
    if path == "README.md":
        return _HOME
    if path in ("CONTRIBUTING.md", "CHANGELOG.md"):
        return path.lower()
    if example:
        return f"examples.md#{example[1].replace('_', '-')}"
    if path.rstrip("/") == "examples":
        return "examples.md"
    if module and module[1].split("/")[0] in reference.PACKAGES:
        return f"reference/{module[1]}.html"
    return path.removeprefix("docs/")


def converted(text: str, *, in_docs: bool) -> str:
    """A page of the repository as a page of the site."""
    linked = _LINK.sub(lambda link: page_name(link[1], in_docs=in_docs), text)
    return with_formulas(_COMMENT.sub("", linked))


def _write_sources(folder: Path) -> None:
    """Pages, pictures and the gallery in Markdown."""
    sources = {Path("README.md"): _HOME, Path("CONTRIBUTING.md"): "contributing.md"}
    sources[Path("CHANGELOG.md")] = "changelog.md"
    for path in sorted(Path("docs").glob("*.md")):
        sources[path] = _OVERVIEW if path.name == "index.md" else path.name
    for path, name in sources.items():
        text = converted(path.read_text(encoding="utf-8"), in_docs=path.parent.name == "docs")
        (folder / name).write_text(text, encoding="utf-8")
    shutil.copytree(Path("docs") / "pictures", folder / "pictures")
    shutil.copytree(_FILES, folder / "assets")
    examples = gallery.executed_examples()
    for example in examples:
        target = folder / "gallery" / example.name
        target.mkdir(parents=True)
        for picture in example.pictures:
            shutil.copy(picture, target / picture.name)
    text = gallery.page(examples, "gallery")
    (folder / "examples.md").write_text(text, encoding="utf-8")


def _navigation() -> list[object]:
    documents = {path.stem for path in Path("docs").glob("*.md")} - {"index"}
    names_in_chapters = {name for names in _CHAPTERS.values() for name in names}
    chapters = dict(_CHAPTERS)
    unlisted = tuple(sorted(documents - names_in_chapters))
    if unlisted:
        chapters["Further"] = unlisted
    entries: list[object] = [{"Home": _HOME}, {"Overview": _OVERVIEW}, {"Examples": "examples.md"}]
    entries += [
        {chapter: [f"{name}.md" for name in names if name in documents]}
        for chapter, names in chapters.items()
    ]
    entries.append({"Project": ["contributing.md", "changelog.md"]})
    entries.append({"API reference": "reference/index.html"})
    return entries


def _settings(source: Path, folder: Path) -> str:
    """The configuration of MkDocs."""
    scheme = {"primary": "custom", "accent": "custom"}
    palette = [
        {"media": "(prefers-color-scheme: light)", "scheme": "default", **scheme},
        {"media": "(prefers-color-scheme: dark)", "scheme": "slate", **scheme},
    ]
    features = ["navigation.tabs", "navigation.top", "content.code.copy", "toc.follow"]
    text: str = yaml.safe_dump(
        {
            "site_name": "LAISN-Sim",
            "docs_dir": str(source),
            "site_dir": str(folder.resolve()),
            "use_directory_urls": False,
            "theme": {
                "name": "material",
                "font": False,
                "palette": palette,
                "features": features,
                "icon": {"logo": "material/waves"},
            },
            "plugins": ["search", "offline"],
            # a worker for pages from disk that asks no host
            "extra": {"polyfills": ["assets/iframe-worker.js"], "generator": False},
            "extra_css": ["assets/site.css"],
            "nav": _navigation(),
            "validation": {"anchors": "warn", "links": {"not_found": "warn"}},
        },
        allow_unicode=True,
        sort_keys=False,
    )
    # names of headings as GitHub makes them
    return text + (
        "markdown_extensions:\n"
        "  - tables\n  - attr_list\n  - md_in_html\n  - sane_lists\n"
        "  - pymdownx.superfences\n  - pymdownx.highlight\n"
        "  - toc:\n      permalink: true\n"
        "      slugify: !!python/object/apply:pymdownx.slugs.slugify {kwds: {case: lower}}\n"
    )


class _Problems(logging.Handler):
    """Keeps warnings of MkDocs."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        line = record.getMessage()
        # the reference is added to the pages afterwards, and checked by itself
        if "reference/" not in line:
            self.lines.append(line)


def outside(folder: Path) -> list[str]:
    """What pages would ask another host for, a line each."""
    requests = re.compile(
        r'<(?:script|link|img|iframe|source)\b[^>]*?(?:src|href)="((?:https?:)?//[^"]+)"'
    )
    return [
        f"{path.relative_to(folder)}: asks for {address}"
        for path in sorted(folder.rglob("*.html"))
        for address in requests.findall(path.read_text(encoding="utf-8"))
    ]


def build(folder: Path = FOLDER) -> list[str]:
    """Write the site into a folder and list what is wrong with it."""
    problems = _Problems()
    logging.getLogger("mkdocs").addHandler(problems)
    with tempfile.TemporaryDirectory() as work:
        source = Path(work) / "pages"
        source.mkdir()
        _write_sources(source)
        settings = Path(work) / "mkdocs.yml"
        settings.write_text(_settings(source, folder), encoding="utf-8")
        build_pages(load_config(str(settings)))
    logging.getLogger("mkdocs").removeHandler(problems)
    broken = reference.build(folder / "reference")
    return [*problems.lines, *broken, *outside(folder)]


if __name__ == "__main__":
    start_s = time.monotonic()
    problems = build()
    seconds = time.monotonic() - start_s
    print(
        *problems, f"{FOLDER / 'index.html'}: {len(problems)} problems, {seconds:.0f} s", sep="\n"
    )
    sys.exit(bool(problems))
