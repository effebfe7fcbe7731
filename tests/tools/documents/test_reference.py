"""Broken references of the API reference are found; `make docs` builds the whole reference and
fails on any.
"""

from pathlib import Path

from tools.documents.reference import broken_references


def test_broken_links_anchors_and_names_are_listed(tmp_path: Path) -> None:
    (tmp_path / "sim").mkdir()
    (tmp_path / "sim.html").write_text(
        '<p id="wave"><a href="sim/water.html#Tide">x</a><a href="sim/water.html#Moon">x</a><a '
        'href="no.html">x</a>'
        '<a href="https://example.org/#any">x</a><a href="#wave">x</a></p>'
    )
    (tmp_path / "sim" / "water.html").write_text(
        '<p id="Tide"><code>laisn.geometry</code><code>laisn.geometry.wrap_nothing</code>'
        "<code>sim.tides</code></p>"
    )
    assert sorted(broken_references(tmp_path)) == [
        "sim.html: no.html# does not exist",
        "sim.html: sim/water.html#Moon does not exist",
        "sim/water.html: laisn.geometry.wrap_nothing does not exist",
        "sim/water.html: sim.tides does not exist",
    ]
