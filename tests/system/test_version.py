"""The version of results: it changes with every source that may change a number, and with no
other.
"""

import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from experiments.study.file import built_in_files, shipped
from reports import version
from reports.version import OWN_PACKAGES, ROOT
from tools.documents import route_keeping


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("tree")
    for package in OWN_PACKAGES:
        shutil.copytree(
            ROOT / package, root / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    return root


@pytest.fixture(scope="module")
def version_before(tree: Path) -> str:
    return version.version_of(root=tree)


def version_after_edits(root: Path, *names: str, text: str = "\n# edited\n") -> str:
    """The version while `text` is appended to these files."""
    contents = {name: (root / name).read_bytes() for name in names}
    try:
        for name, content in contents.items():
            (root / name).write_bytes(content + text.encode())
        return version.version_of(root=root)
    finally:
        for name, content in contents.items():
            (root / name).write_bytes(content)


@pytest.mark.system
@pytest.mark.parametrize(
    "name",
    [
        "sim/water/currents.py",
        "sim/sensing/noise.py",
        "sim/scenario/file.py",
        "laisn/fix.py",
        "laisn/metrics.py",
        "experiments/campaign/montecarlo.py",
        "experiments/campaign/plans.py",
        "models/follower.xml",
        "sim/scenario/data/followers_T2_T9.json",
    ],
)
def test_an_edit_of_what_computes_makes_another_version(
    tree: Path, version_before: str, name: str
) -> None:
    assert version_after_edits(tree, name) != version_before


@pytest.mark.system
def test_a_docstring_is_no_part_of_the_version(tree: Path, version_before: str) -> None:
    assert version_after_edits(
        tree, "sim/water/currents.py", text='\n"""Other\n\nwords."""\n'
    ) == version_after_edits(tree, "sim/water/currents.py", text='\n"""Words."""\n')
    assert (
        version_after_edits(tree, "sim/water/currents.py", text='\nclass Tide: "words"\n')
        != version_before
    )
    assert (
        version_after_edits(tree, "sim/water/currents.py", text='\nTIDE = """words"""\n')
        != version_before
    )


def test_edits_of_what_draws_writes_or_compares_keep_the_version(
    tree: Path, version_before: str
) -> None:
    edited = [
        "sim/film/render.py",
        "sim/film/overlay.py",
        "sim/film/scene.py",
        "sim/log/writer.py",
        "sim/log/scene.py",
        "reports/page.py",
        "reports/flight_report.py",
        "reports/templates/page.css",
        "laisn_sim/cli/main.py",
        "experiments/studies/reproduce/published_tables.csv",
    ]
    assert version_after_edits(tree, *edited) == version_before


@pytest.mark.system
@pytest.mark.parametrize(
    "text",
    [
        "\nimport sim.tides\n",
        "\nfrom sim import tides\n",
        "\nfrom sim.tides import HEIGHT\n",
        "\nfrom .. import tides\n",
        "\nfrom ..tides import HEIGHT\n",
        "\ndef late():\n    from sim.tides import HEIGHT\n    return HEIGHT\n",
    ],
)
def test_a_module_counts_from_its_first_import_on(tree: Path, text: str) -> None:
    module = tree / "sim" / "tides.py"
    try:
        module.write_text("HEIGHT = 1.0\n")
        version_with_import = version_after_edits(tree, "sim/sensing/noise.py", text=text)
        module.write_text("HEIGHT = 2.0\n")
        assert version_after_edits(tree, "sim/sensing/noise.py", text=text) != version_with_import
    finally:
        module.unlink()


def test_a_module_that_nothing_imports_does_not_count(tree: Path, version_before: str) -> None:
    module = tree / "sim" / "tides.py"
    try:
        module.write_text("HEIGHT = 1.0\n")
        assert version.version_of(root=tree) == version_before
    finally:
        module.unlink()


def test_a_renamed_entry_is_detected(tree: Path) -> None:
    entry = tree / "sim" / "scenario" / "file.py"
    entry.rename(tree / "file.py")
    try:
        with pytest.raises(ImportError, match=r"sim\.scenario\.file"):
            version.version_of(root=tree)
    finally:
        (tree / "file.py").rename(entry)


@pytest.fixture
def lookup(
    tree: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[], str]]:
    """Looks the version of the tree up as another process would."""
    monkeypatch.setattr(version, "ROOT", tree)
    monkeypatch.setattr(version, "_folder", lambda: tmp_path / "versions")

    def look_up() -> str:
        version._version_here.cache_clear()
        return version.version_of(root=tree)

    yield look_up
    version._version_here.cache_clear()


def test_a_process_reads_the_version_that_another_has_stored(
    lookup: Callable[[], str], version_before: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert lookup() == version_before
    with monkeypatch.context() as patched:
        patched.delattr(version, "_version")
        assert lookup() == version_before


@pytest.mark.parametrize("name", ["sim/water/currents.py", "models/follower.xml"])
def test_no_stored_version_hides_an_edit(
    tree: Path, lookup: Callable[[], str], version_before: str, name: str
) -> None:
    assert lookup() == version_before
    content = (tree / name).read_bytes()
    try:
        (tree / name).write_bytes(content + b"\n")
        assert lookup() != version_before
    finally:
        (tree / name).write_bytes(content)


@pytest.mark.parametrize("content", [b"", b"0123", b"\xff\x00"])
def test_a_damaged_stored_version_is_replaced(
    tmp_path: Path, lookup: Callable[[], str], version_before: str, content: bytes
) -> None:
    lookup()
    [file] = (tmp_path / "versions").iterdir()
    file.write_bytes(content)
    assert lookup() == version_before
    assert file.read_text() == version_before


@pytest.mark.system
def test_every_module_loaded_for_a_campaign_is_among_the_sources() -> None:
    """The modules that Python has loaded are all among the sources of the version."""
    code = f"import sys, experiments.campaign.campaign\nown = {OWN_PACKAGES!r}\n"
    code += "print(*(m for m in sys.modules if m.partition('.')[0] in own), sep='\\n')\n"
    loaded = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    files = {
        path.relative_to(ROOT).with_suffix("").as_posix()
        for path in version.sources()
        if path.suffix == ".py"
    }
    source_modules = {file.removesuffix("/__init__").replace("/", ".") for file in files}
    assert {"sim.simulation", "experiments.campaign.montecarlo"} <= set(loaded.split())
    assert set(loaded.split()) <= source_modules


@pytest.mark.system
@pytest.mark.parametrize(
    "modules",
    [
        ("experiments.study.measure",),
        route_keeping.MODULES,
        *(
            (f"experiments.studies.{name.replace('-', '_')}.findings", "experiments.study.run")
            for name in shipped()
            if built_in_files(name)
        ),
    ],
)
def test_no_result_of_a_study_depends_on_how_pages_are_drawn(modules: tuple[str, ...]) -> None:
    drawing = ("reports.page", "reports.figures", "laisn_sim.cli", "sim.film")
    assert not [name for name in version.reachable(modules) if name.startswith(drawing)]


def test_the_version_names_package_and_sources() -> None:
    name, _, digits = version.code_version().partition("+")
    assert name.count(".") == 2
    assert digits == version.version_of()
    assert len(digits) == 12
