"""Numbers in README and docs: taken from the records of the studies, by `make figures`; judged by
`make check`.

A number stands in a document between two comments, which no reader sees,

    removes <!--= asymmetry removed ahrs-0.5 laisn-2 dive .0% i -->99 % (98 to 100 %)<!--/--> of it

that name the study, the finding and how it is printed (`reports.findings.Finding.__format__`).
A table stands between `<!-- table NAME -->` and `<!-- /table -->` on lines of their own, and is
made by a function of `TABLES`. The finding `version` of any record is the version of the sources
that made it.
"""

import argparse
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from laisn.errors import LaisnError
from reports.findings import Findings, plain_finding, read_findings, version_of
from tools.documents.tables import TABLES

ROOT = Path(__file__).resolve().parents[2]
RECORDS = ROOT / "docs" / "results"
DOCUMENTS = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))

MEASURED = ("benchmarks", "mutants")
"""Records that depend on the machine or on a random draw, so that other sources do not make them
wrong.
"""

_NUMBER = re.compile(
    r"<!--= (\S+) ((?:\S+ )*?)((?:(?:low|high) )?[.,]?\d*[fdsg%]+(?: i)?) -->.*?<!--/-->", re.DOTALL
)
_TABLE = re.compile(r"(<!-- table (\S+) -->\n).*?(<!-- /table -->)", re.DOTALL)
_ANY = re.compile(r"<!--= .*?-->|<!-- table .*?-->", re.DOTALL)


def records(folder: Path = RECORDS) -> dict[str, Findings]:
    """All records by the name of their study."""
    return {path.stem: read_findings(path) for path in sorted(folder.glob("*.json"))}


def filled(
    text: str, records: Mapping[str, Findings], tables: Mapping[str, Callable[..., str]] = TABLES
) -> str:
    """A document with every number and table as the records have it.

    Raises:
        LaisnError: a marker that cannot be understood, or a study, finding or table that is not
            there.
    """

    def study(name: str) -> Findings:
        if name not in records:
            raise LaisnError(
                f"there is no record of {name!r}; there are {', '.join(records)}: make studies"
            )
        return records[name]

    def number(match: re.Match[str]) -> str:
        name = match[1]
        key = match[2].strip()
        spec = match[3]
        finding = (
            plain_finding(study(name).version, "version") if key == "version" else study(name)[key]
        )
        return f"<!--= {name} {key} {spec} -->{finding:{spec}}<!--/-->"

    def table(match: re.Match[str]) -> str:
        if match[2] not in tables:
            raise LaisnError(f"there is no table {match[2]!r}; there are {', '.join(tables)}")
        return f"{match[1]}\n{tables[match[2]](records)}\n{match[3]}"

    understood = len(_NUMBER.findall(text)) + len(_TABLE.findall(text))
    if understood != len(_ANY.findall(text)):
        wrong = [
            m
            for m in _ANY.findall(text)
            if not any(m in match[0] for match in _NUMBER.finditer(text))
        ]
        raise LaisnError(f"a marker is not closed or not understood, one of: {'; '.join(wrong)}")
    first = re.search(r"^[\s>*-]*<!--=.*", text, flags=re.MULTILINE)
    if first:
        raise LaisnError(
            "a line may not begin with a number's marker, or its text is shown as it is: "
            f"{first[0]}"
        )
    return _TABLE.sub(table, _NUMBER.sub(number, text))


def is_stale(record: Findings) -> bool:
    """Whether the modules of a record have changed since it was made, or do not exist any more."""
    try:
        return bool(record.modules) and record.version != version_of(record.modules)
    except (FileNotFoundError, ImportError):
        return True


def check(*, strict: bool = False) -> tuple[list[str], list[str]]:
    """Errors and notices: documents that differ from the records, and records of other sources.

    Args:
        strict: stale records of studies, which can be computed again exactly, are errors and not
            notices.

    Returns:
        Errors; notices, among them stale measurements.
    """
    findings = records()
    errors = [
        f"{path.relative_to(ROOT)} has not the numbers of docs/results: run make figures"
        for path in DOCUMENTS
        if filled(path.read_text(encoding="utf-8"), findings) != path.read_text(encoding="utf-8")
    ]
    stale = [name for name, record in findings.items() if is_stale(record)]
    studies, measured = (
        [n for n in stale if (n in MEASURED) is measured] for measured in (False, True)
    )
    notices: list[str] = []
    if studies:
        text = (
            f"docs/results of {', '.join(studies)}: the sources have changed since: run make "
            "studies figures"
        )
        (errors if strict else notices).append(text)
    if measured:
        notices.append(
            f"notice: docs/results of {', '.join(measured)}: measured before the sources changed"
        )
    return errors, notices


def write() -> None:
    """Bring every document up to its records."""
    findings = records()
    for path in DOCUMENTS:
        path.write_text(filled(path.read_text(encoding="utf-8"), findings), encoding="utf-8")


def main() -> None:
    """Fill in the numbers of README and docs, or with --check print which differ from the
    records.
    """
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument(
        "--check", action="store_true", help="change nothing; fail if anything would change"
    )
    parser.add_argument(
        "--strict", action="store_true", help="with --check: fail if a study has to be run again"
    )
    arguments = parser.parse_args()
    if not arguments.check:
        write()
        return
    errors, notices = check(strict=arguments.strict)
    for line in (*errors, *notices):
        print(line, file=sys.stderr)
    sys.exit(bool(errors))


if __name__ == "__main__":
    main()
