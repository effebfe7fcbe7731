"""What a study found, number by number: `results.json`, from which documents take every number
that they print.
"""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from laisn.arrays import Bools, Floats
from laisn.errors import LaisnError
from reports.intervals import Interval, proportion
from reports.version import version_of as version_of
from sim.system import atomic_write

SCHEMA = 1  # version of the file's layout
RESULTS_FILE = "results.json"
KEPT_DIGITS = 6  # significant digits that are kept: more than is ever printed


def _rounded(value: float | None) -> float | None:
    return None if value is None or math.isnan(value) else float(f"{value:.{KEPT_DIGITS}g}")


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A number, or a word, that a study came to."""

    value: float | int | str | None
    """None: undecided."""
    low: float | None = None
    high: float | None = None
    unit: str = ""
    what: str = ""
    """What it is, and what its limits are."""

    @property
    def number(self) -> float:
        """The value as a number; NaN of a word, and where it is undecided."""
        return float(self.value) if isinstance(self.value, int | float) else math.nan

    def __format__(self, spec: str) -> str:
        """Format as text by a Python format, with a space before the percent sign and a typographic
        minus sign.

        `low` or `high` before it: a limit; ` i` after it: with the limits; ` ±`: with half of the
        interval; a finding without limits is its value alone.
        """
        match = re.fullmatch(r"(?:(low|high) ?)?(\S*?)( i| ±)?", spec)
        if match is None:
            raise ValueError(
                f"{spec!r} is no format of a finding, such as '.2f', 'low .0%' or '.1f i'"
            )
        limit, number_format, interval = match.groups()
        number = getattr(self, limit) if limit else self.value
        value, low, high = (_value_text(v, number_format) for v in (number, self.low, self.high))
        if interval == " i" and (self.low is not None or self.high is not None):
            return f"{value} ({low.removesuffix(' %')} to {high})"
        if interval == " ±" and self.low is not None and self.high is not None:
            return f"{value} ± {_value_text((self.high - self.low) / 2, number_format)}"
        return value


def _value_text(value: float | int | str | None, spec: str) -> str:
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    text = format(round(value) if spec in ("d", ",d") else value, spec)
    # what is rounded to nothing has no sign
    negative = text.startswith("-") and any(digit in "123456789" for digit in text)
    return ("−" if negative else "") + text.removeprefix("-").replace("%", " %")


def interval_finding(interval: Interval, meaning: str, unit: str = "") -> Finding:
    """A finding with its confidence interval."""
    value, low, high = (_rounded(v) for v in interval)
    return Finding(value=value, low=low, high=high, unit=unit, what=meaning)


def plain_finding(value: float | int | str | None, meaning: str, unit: str = "") -> Finding:
    """A finding without limits."""
    return Finding(
        value=_rounded(value) if isinstance(value, float) else value, unit=unit, what=meaning
    )


def median_finding(values: Floats | Sequence[float], meaning: str, unit: str = "") -> Finding:
    """The median of values."""
    return plain_finding(float(np.median(values)), meaning, unit)


def share_finding(flags: Floats | Bools, meaning: str) -> Finding:
    """Share of the trials whose flag is not 0, with its exact limits; flags of any shape."""
    return interval_finding(proportion(int(np.count_nonzero(flags)), np.size(flags)), meaning)


@dataclass(frozen=True, kw_only=True)
class Findings:
    """All that a study found, the command that computes it again, and the modules that do, with
    their version.
    """

    study: str
    command: str
    modules: tuple[str, ...]  # names, as Python imports them
    version: str  # `version_of` these modules
    findings: Mapping[str, Finding] = field(default_factory=dict)

    def __getitem__(self, key: str) -> Finding:
        """A finding by its name; LaisnError naming those that are alike if there is none."""
        if key not in self.findings:
            similar_names = [
                name for name in self.findings if name.partition(" ")[0] == key.partition(" ")[0]
            ]
            raise LaisnError(
                f"the study {self.study!r} found no {key!r}; it found "
                f"{', '.join(similar_names or self.findings)}"
            )
        return self.findings[key]

    def write(self, path: Path) -> None:
        """Write the record, in a folder that is made if it is not there: the same findings give
        the same bytes.
        """
        text = partial(json.dumps, ensure_ascii=False)
        lines = []
        head, _, rest = text(
            {"schema": SCHEMA} | asdict(replace(self, findings={})), indent=1
        ).rpartition("{}")
        # a line for each finding, so that a difference of records can be read
        for name, finding in self.findings.items():
            table = {
                key: value
                for key, value in asdict(finding).items()
                if value not in ("", None) or key == "value"
            }
            lines.append(f"  {text(name)}: {text(table)}")
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary:
            temporary.write_text(
                head + "{\n" + ",\n".join(lines) + "\n }" + rest + "\n", encoding="utf-8"
            )


def record(
    study: str, command: str, modules: tuple[str, ...], findings: Mapping[str, Finding]
) -> Findings:
    """The record of what a study found, with the version of the sources that are here; arguments
    as of `Findings`.
    """
    return Findings(
        study=study,
        command=command,
        modules=modules,
        version=version_of(modules),
        findings=findings,
    )


def read_findings(path: Path) -> Findings:
    """A record; LaisnError if it is not there, or no record of this schema."""
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
        if table.pop("schema", None) != SCHEMA:
            raise LaisnError(f"its schema is not {SCHEMA}; make it anew with make studies")
        findings = {name: Finding(**finding) for name, finding in table.pop("findings").items()}
        return Findings(**table | {"modules": tuple(table["modules"])}, findings=findings)
    except (OSError, ValueError, RecursionError, KeyError, TypeError, AttributeError) as error:
        raise LaisnError(f"{path}: no record of a study: {error}") from None
