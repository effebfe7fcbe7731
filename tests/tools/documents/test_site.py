"""The site of the documents: formulas, links, executed examples, and the pages from disk."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from tests import browser
from tools.documents import gallery, reference, site
from tools.documents.formulas import mathml, with_formulas

DOCS = sorted(Path("docs").glob("*.md"))
MATHML = "{http://www.w3.org/1998/Math/MathML}"


def test_a_formula_becomes_mathml() -> None:
    root = ElementTree.fromstring(mathml(r"\frac{a_1}{2}"))
    (fraction,) = root.iter(f"{MATHML}mfrac")
    above, below = fraction
    assert [part.text for part in above.iter() if part.text] == ["a", "1"]
    assert "".join(below.itertext()) == "2"


def test_formulas_of_text_and_fences_are_converted_and_code_is_not() -> None:
    text = "At $`x`$.\n\n```math\ny = 1\n```\n\n```bash\necho $`date`$\n```\n\nand $`z`$\n"
    converted = with_formulas(text)
    assert converted.count("<math") == 3
    assert converted.count('display="block"') == 1
    assert "echo $`date`$" in converted


@pytest.mark.parametrize("path", DOCS, ids=lambda path: path.stem)
def test_each_formula_of_the_documents_is_understood(path: Path) -> None:
    converted = with_formulas(path.read_text(encoding="utf-8"))
    for formula in re.findall(r"<math.*?</math>", converted):
        ElementTree.fromstring(formula)  # well-formed
    assert "```math" not in converted
    # commands that were not understood remain as text
    assert not re.search(r"<m[ion]>\\", converted)


@pytest.mark.parametrize(
    ("target", "in_docs", "expected"),
    [
        ("docs/physics.md", False, "physics.md"),
        ("docs/pictures/swarm.jpg", False, "pictures/swarm.jpg"),
        ("index.md", True, "overview.md"),
        ("../README.md", True, "index.md"),
        ("../CHANGELOG.md", True, "changelog.md"),
        ("../examples/own_vehicle.py", True, "examples.md#own-vehicle"),
        ("../sim/vehicle/effector_kinds.py", True, "reference/sim/vehicle/effector_kinds.html"),
        ("https://example.org/a.md", True, "https://example.org/a.md"),
    ],
)
def test_links_lead_to_pages_of_the_site(target: str, in_docs: bool, expected: str) -> None:
    assert site.page_name(target, in_docs=in_docs) == expected


EXAMPLE = '''"""Draws."""

from PIL import Image

print("drawn")
Image.new("RGB", (2, 2)).save("a.png")
'''


def test_an_example_is_run_once_until_it_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    examples = tmp_path / "examples"
    examples.mkdir()
    (examples / "one.py").write_text(EXAMPLE)
    monkeypatch.setattr(gallery, "EXAMPLES", examples)
    monkeypatch.setattr(gallery, "OUTPUT", tmp_path / "cache")
    for _ in range(2):
        (executed,) = gallery.executed_examples()
        assert (executed.output, executed.description, executed.pictures[0].name) == (
            "drawn\n",
            "Draws.",
            "a.png",
        )
        assert executed.pictures[0].is_file()
        assert executed.body.startswith("from PIL")
    assert capsys.readouterr().out.count("running") == 1
    (examples / "one.py").write_text(EXAMPLE.replace('"drawn"', '"anew"'))
    (executed,) = gallery.executed_examples()
    assert executed.output == "anew\n"
    (examples / "one.py").write_text('print("nothing")')
    with pytest.raises(RuntimeError, match="left no picture"):
        gallery.executed_examples()
    (examples / "one.py").write_text('raise SystemExit("no")')
    with pytest.raises(RuntimeError, match="no"):
        gallery.executed_examples()


@pytest.mark.system
@pytest.mark.skipif(browser.executable() is None, reason="no Chromium is installed")
def test_the_site_works_from_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    picture = tmp_path / "a.png"
    (tmp_path / "one.py").write_text(EXAMPLE)
    picture.write_bytes(Path("docs/pictures/swarm.jpg").read_bytes())
    examples = [
        gallery.Executed(name=path.stem, code=EXAMPLE, output="drawn\n", pictures=[picture])
        for path in sorted(Path("examples").glob("*.py"))
    ]
    monkeypatch.setattr(gallery, "executed_examples", lambda: examples)
    monkeypatch.setattr(reference, "build", lambda folder: [])
    folder = tmp_path / "site"
    assert site.build(folder) == []
    with browser.chromium() as page:
        page.open(folder / "algorithm.html")
        _, _, width, height = page.box("math[display=block]")
        assert width > 100
        assert height > 15
        left, top, width, height = page.box(".md-search__input")
        page.click(left + width / 2, top + height / 2)
        page.command("Input.insertText", text="mirror")
        page.command("Input.dispatchKeyEvent", type="keyUp", key="r")
        page.wait("document.querySelectorAll('.md-search-result__item').length > 3")
        page.open(folder / "examples.html")
        assert page.run("document.querySelectorAll('.gallery a').length") >= 20
        assert page.run("[...document.images].every((image) => image.complete)")
        assert all(url.startswith(("file:", "about:", "data:")) for url in page.requests)
        assert page.problems == []
