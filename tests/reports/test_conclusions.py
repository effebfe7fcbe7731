"""Conclusions in words of README and docs follow from the records: comparisons, effects and losses.

Numbers in documents are filled in from the records; words are not. Each conclusion stands here with
the words that a document has for it, and with the condition on the record for them to be true. A
record that contradicts one fails.
"""

from collections.abc import Callable
from typing import NamedTuple

import pytest

from reports.findings import Findings, read_findings
from tools.documents.markers import RECORDS, ROOT


class Record(NamedTuple):
    """Findings as numbers, by their names."""

    findings: Findings

    def value(self, name: str) -> float:
        return float(self.findings[name].value or 0.0)

    def values(self, name: str, *words: str) -> list[float]:
        """Those of several findings whose names differ in the words that fill the braces."""
        return [self.value(name.format(word)) for word in words]

    def low(self, name: str) -> float:
        """Lower limit of the finding's confidence interval."""
        return float(self.findings[name].low or 0.0)

    def high(self, name: str) -> float:
        """Upper limit of the finding's confidence interval."""
        return float(self.findings[name].high or 0.0)


class Conclusion(NamedTuple):
    """Words of a document, the study that they rest on, and what must hold of its record."""

    document: str
    words: str
    study: str
    holds: Callable[[Record], bool]


CAUSES = ("trim", "dive", "waves")
"""Of a leader's pitch, in the study of asymmetric ranges."""
ASSUMED = ("leader", "late", "drift")
"""Errors that the settings of the tightly coupled navigator must include."""
NEAR_AXIS = ("T2", "T5", "T7", "T8", "T9")
"""Routes that lie near the leader's axis."""

CONCLUSIONS = (
    Conclusion(
        "docs/reproduction.md",
        "then jump to the mirror image of the truth",
        "reproduce-physics",
        lambda r: (
            r.low("mirror-locked asymmetric laisn-2") > 2 * r.high("mirror-locked 5s laisn-2")
        ),
    ),
    Conclusion(
        "docs/reproduction.md",
        "with the error of Eq. 28 centred",
        "reproduce-physics",
        lambda r: all(
            0.8 < r.value(f"ratio asymmetric-centred {v}") < 1.25 < r.value(f"ratio asymmetric {v}")
            for v in ("laisn-2", "laisn-3-2")
        ),
    ),
    Conclusion(
        "docs/reproduction.md",
        "But LAISN-2 collapses as well",
        "reproduce-physics",
        lambda r: (
            r.value("error 10s-slow-beta300 laisn-2 T3")
            > 5 * r.value("printed 10s-slow-beta300 laisn-2 T3")
        ),
    ),
    Conclusion(
        "docs/reproduction.md",
        "collapses at 10 s as printed",
        "reproduce-physics",
        lambda r: (
            0.7 < r.value("ratio 10s-slow-beta300 laisn-3-2") < 1.4
            and r.high("ratio 10s-slow laisn-3-2") < 0.2
        ),
    ),
    Conclusion(
        "README.md",
        "Broadcasting pitch and roll takes the error away",
        "asymmetry",
        lambda r: all(r.low(f"least attitude-0 {cause}") > 0.9 for cause in CAUSES),
    ),
    Conclusion(
        "docs/asymmetry.md",
        "off it removes only",
        "asymmetry",
        lambda r: r.high("least attitude-0.5 waves") < r.low("least ahrs-0.5 waves"),
    ),
    Conclusion(
        "docs/asymmetry.md",
        "takes the error away, if its sensor is good enough",
        "asymmetry",
        lambda r: (
            all(
                r.low(f"removed {arm} laisn-2 {c}") > 0.9
                for arm in ("attitude-0", "ahrs-0.5")
                for c in CAUSES
            )
            and r.high("removed attitude-2 laisn-2 waves") < 0.0
        ),
    ),
    Conclusion(
        "docs/asymmetry.md",
        "A third transmitter does not reveal the tilt",
        "asymmetry",
        lambda r: (
            r.low("mirror-locked real laisn-3-2 all") > r.high("mirror-locked level laisn-3-2 all")
        ),
    ),
    Conclusion(
        "docs/tight.md",
        "make the covariance invalid",
        "estimators",
        lambda r: (
            min(r.values("nees wrong {} unaware", *ASSUMED)) > 5
            and 1.2
            < min(r.values("nees wrong {} aware", *ASSUMED))
            <= max(r.values("nees wrong {} aware", *ASSUMED))
            < 3
        ),
    ),
    Conclusion(
        "docs/tight.md",
        "Echoes and losses need no setting",
        "estimators",
        lambda r: all(
            1.2 < nees < 2.8 for nees in r.values("nees wrong {} aware", "echoes", "losses")
        ),
    ),
    Conclusion(
        "docs/tight.md",
        "Unneeded states",
        "estimators",
        lambda r: r.low("error G7 5") > r.high("error G1 5"),
    ),
    Conclusion(
        "docs/tight.md",
        "are the σ of a range and that of the log",
        "estimators",
        lambda r: (
            min(r.values("nees sigma {}_sigma 0.5", "range", "speed"))
            > max(
                r.values(
                    "nees sigma {}_sigma 0.5",
                    "heading",
                    "range_scale",
                    "speed_bias",
                    "heading_bias",
                )
            )
            and max(r.values("nees sigma {}_sigma 2", "range", "speed")) < 1.5
        ),
    ),
    Conclusion(
        "docs/tight.md",
        "errors grow by less than a fifth",
        "estimators",
        lambda r: (
            max(
                r.values(
                    "error sigma {}",
                    *(f"{s}_sigma {f}" for s in ("range", "speed") for f in ("0.5", "2")),
                )
            )
            < 1.2 * r.value("error offset 0.1")
        ),
    ),
    Conclusion(
        "docs/tight.md",
        "weaves by 5° makes the side observable with two transmitters",
        "estimators",
        lambda r: all(
            r.value(f"rms weaving {t}") < 0.8 * r.value(f"rms straight {t}") for t in ("T2", "T5")
        ),
    ),
    Conclusion(
        "docs/tight.md",
        "Place it far aside",
        "estimators",
        lambda r: (
            r.high("error offset 0.5") < r.low("error offset 0.1") < r.low("error offset 0.02")
        ),
    ),
    Conclusion(
        "docs/tight.md",
        "Assumed errors that do not occur lower NEES below 2",
        "estimators",
        lambda r: r.high("nees G7 5") < 2,
    ),
    Conclusion(
        "docs/closed-loop.md",
        "by hundreds of metres",
        "closed-loop",
        lambda r: min(r.values("off laisn-2 {}", "T2", "T5")) > 200,
    ),
    Conclusion(
        "docs/closed-loop.md",
        "they fail on most routes",
        "closed-loop",
        lambda r: (
            r.low("lost laisn-3-1") > r.high("lost laisn-3-2")
            and min(r.values("lost laisn-3-1 {}", *NEAR_AXIS)) > 0.1
        ),
    ),
    Conclusion(
        "docs/closed-loop.md",
        "Two transmitters do suffice",
        "closed-loop",
        lambda r: r.high("lost tight-2") < 0.01,
    ),
    Conclusion(
        "docs/closed-loop.md",
        "farther off its place than it errs",
        "closed-loop",
        lambda r: all(
            r.value(f"off tight-2 {route}") > r.value(f"error tight-2 {route}")
            for route in NEAR_AXIS
        ),
    ),
    Conclusion(
        "docs/real-ranges.md",
        "else matters as much",
        "real-ranges",
        lambda r: (
            r.value("pairs steady-gyro Plaza2")
            > max(
                r.values("pairs {} Plaza2", "tight", "known-scale", "exact-speed", "exact-beacons")
            )
        ),
    ),
)


@pytest.mark.parametrize("conclusion", CONCLUSIONS, ids=lambda c: f"{c.document}: {c.words}")
def test_words_of_documents_follow_from_the_records(conclusion: Conclusion) -> None:
    text = " ".join((ROOT / conclusion.document).read_text(encoding="utf-8").split())
    assert conclusion.words in text, (
        "the words are not there any more: change or drop the conclusion"
    )
    assert conclusion.holds(Record(read_findings(RECORDS / f"{conclusion.study}.json"))), (
        f"docs/results/{conclusion.study}.json differs"
    )
