"""Pages from templates: headings, paragraphs, notices, numbers by name, and blocks in their places."""

import sys
from pathlib import Path
from typing import Any

import jinja2
import pytest

from experiments.findings import Finding, Findings
from experiments.pages.page import Code, Notice, Page, Text
from experiments.pages.template import page_of
from laisn.failure import LaisnError

FINDINGS = Findings(
    study="", command="", modules=(), version="", findings={"share": Finding(value=0.25, low=0.2, high=0.3)}
)


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A function that renders a template text."""
    package = tmp_path / "templated"
    package.mkdir()
    (package / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)

    def render(text: str, **values: Any) -> Page:
        sys.modules.pop("templated", None)
        (package / "page.md.j2").write_text(text)
        return page_of("templated", [("seed", "1")], values, FINDINGS)

    return render


def test_headings_paragraphs_and_blocks_stand_in_order(page: Any) -> None:
    code = Code(text="laisn fly T5")
    made = page(
        '# Title\n\nOne\nline.\n\n## First\nsection\n\nWith `code`,\nand {{ n("share", ".0% i") }}.\n\n'
        "> warning: Mind {{ what }}.\n\n## Last\n\n{{ code }}\n\n{% if more %}{{ more }}{% endif %}\n\nEnd.\n",
        code=code,
        what="this",
        more=[Notice(text="one"), Notice(text="two")],
    )
    assert (made.title, made.summary, made.facts) == ("Title", "One line.", [("seed", "1")])
    assert [section.title for section in made.sections] == ["First section", "Last"]
    assert made.sections[0].blocks == [
        Text(text="With `code`, and 25 % (20 to 30 %)."),
        Notice(text="Mind this.", tone="warning"),
    ]
    assert made.sections[1].blocks == [code, Notice(text="one"), Notice(text="two"), Text(text="End.")]


def test_what_is_missing_is_an_error(page: Any) -> None:
    with pytest.raises(jinja2.UndefinedError, match="table"):
        page("# T\n\nS.\n\n## A\n\n{{ table }}\n")
    with pytest.raises(LaisnError, match="no 'shore'"):
        page('# T\n\nS.\n\n## A\n\n{{ n("shore", ".2f") }}\n')
    for text in ("No title.\n\nS.", "# T\n", "# T\n\nS.\n\nMore.\n\n## A\n"):
        with pytest.raises(ValueError, match=r"page\.md\.j2"):
            page(text)
