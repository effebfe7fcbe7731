"""Pages from templates: headings, paragraphs, notices, numbers by name, and blocks in their
places.
"""

import sys
from pathlib import Path
from typing import Any

import jinja2
import pytest

from laisn.errors import LaisnError
from reports.findings import Finding, Findings
from reports.page import Code, Figures, Notice, Page, PageTable, TableCell, Text, page_of

FINDINGS = Findings(
    study="",
    command="",
    modules=(),
    version="",
    findings={"share": Finding(value=0.25, low=0.2, high=0.3)},
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


def test_a_question_stands_before_the_summary_that_answers_it(page: Any) -> None:
    rendered = page("# Title\n\n> question: Does it\n> float?\n\nIt does.\n\n## Why\n\nBuoyancy.\n")
    assert (rendered.title, rendered.question, rendered.summary) == (
        "Title",
        "Does it float?",
        "It does.",
    )
    assert page("# Title\n\nIt does.\n").question == ""


def test_headings_paragraphs_and_blocks_stand_in_order(page: Any) -> None:
    code = Code(text="laisn fly T5")
    rendered = page(
        '# Title\n\nOne\nline.\n\n## First section\n\nWith `code`,\nand {{ n("share", ".0% i") '
        "}}.\n\n"
        "> warning: Mind {{ what }}.\n\n## Last\n\n{{ code }}\n\n{% if more %}{{ more }}{% endif "
        "%}\n\nEnd.\n",
        code=code,
        what="this",
        more=[Notice(text="one"), Notice(text="two")],
    )
    assert (rendered.title, rendered.summary, rendered.facts) == (
        "Title",
        "One line.",
        [("seed", "1")],
    )
    assert [section.title for section in rendered.sections] == ["First section", "Last"]
    assert rendered.sections[0].blocks == [
        Text(text="With `code`, and 25 % (20 to 30 %)."),
        Notice(text="Mind this.", tone="warning"),
    ]
    assert rendered.sections[1].blocks == [
        code,
        Notice(text="one"),
        Notice(text="two"),
        Text(text="End."),
    ]


def test_tables_are_rows_of_text_numbers_and_cells(page: Any) -> None:
    coloured = TableCell(text="2.0", sort=2.0, tone="yes")
    rendered = page(
        "# T\n\nS.\n\n## A\n\n| | E_P [m] || of |\n| what | paper | ours | all "
        "|\n|---|---|---|---|\n"
        '{% for name in names %}\n| {{ name }} | 1,200 | {{ cell }} | {{ n("share", ".0% i") }} '
        "|\n{% endfor %}\n"
        '| T3 | – | −0.5 (−1 to 2) | {{ n("shore", ".2f", "–") }} |\nA caption\nof two lines.\n',
        names=["T2"],
        cell=coloured,
    )
    (table,) = rendered.sections[0].blocks
    share = TableCell(text="25 % (20 to 30 %)", sort=25.0)
    missing = TableCell(text="–", sort=float("inf"))
    assert table == PageTable(
        heads=["what", "paper", "ours", "all"],
        groups=[("", 1), ("E_P [m]", 2), ("of", 1)],
        rows=[
            [TableCell(text="T2"), TableCell(text="1,200", sort=1200.0), coloured, share],
            [TableCell(text="T3"), missing, TableCell(text="−0.5 (−1 to 2)", sort=-0.5), missing],
        ],
        caption="A caption of two lines.",
    )
    plain = page("# T\n\nS.\n\n## A\n\n| a |\n|---|\n| 1 |\n").sections[0].blocks[0]
    assert (plain.heads, plain.groups, plain.caption) == (["a"], [], "")


def test_a_block_takes_its_caption_from_the_template(page: Any) -> None:
    rendered = page(
        '# T\n\nS.\n\n## A\n\n{{ drawn | caption("All\nroutes.") }}\n',
        drawn=Figures(panels=["<svg>"]),
    )
    assert rendered.sections[0].blocks == [Figures(panels=["<svg>"], caption="All routes.")]


def test_missing_values_findings_and_titles_are_errors(page: Any) -> None:
    with pytest.raises(jinja2.UndefinedError, match="table"):
        page("# T\n\nS.\n\n## A\n\n{{ table }}\n")
    with pytest.raises(LaisnError, match="no 'shore'"):
        page('# T\n\nS.\n\n## A\n\n{{ n("shore", ".2f") }}\n')
    for text in ("No title.\n\nS.", "# T\n", "# T\n\nS.\n\nMore.\n\n## A\n"):
        with pytest.raises(ValueError, match=r"page\.md\.j2"):
            page(text)
