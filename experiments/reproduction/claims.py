"""The paper's claims, each with the criterion and the test that judge it.

A claim is judged on missions: the eight of the paper, or many drawn ones. Where the published tables have the figures
that a test needs, the same test is made on them too, so that a criterion which the paper itself would fail shows.
"""

from collections.abc import Callable
from dataclasses import dataclass

from experiments.intervals import Interval, proportion
from experiments.reproduction import claim_tests as tests
from experiments.reproduction.replications import (
    ASTERN_DEG,
    LATERAL_DEG,
    NEAR_BURST_S,
    REPLICATIONS,
    VERDICT_CONFIDENCE,
    limits,
)
from experiments.reproduction.verdict import MARGIN, Criterion, Evaluated, Judged, Judgement, Results, verdict_of


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A claim of the paper, its criterion in words, and the test."""

    number: int
    text: str
    criterion: str
    test: Callable[[Results], Evaluated]

    def judge(self, results: Results, drawn: Results | None = None, replications: int = REPLICATIONS) -> Judgement:
        """The verdict on figures.

        Args:
            results: the figures.
            drawn: the same in resamples of so many replications, which give every criterion its interval; None: the
                figures are taken as exact.
            replications: how many.
        """
        try:
            tested = self.test(results)
            spread = [None] * len(tested.criteria) if drawn is None else self.test(drawn).criteria
        except tests.NoDataError:
            missing = "the rows that this test needs were not run, or are not in the tables"
            return Judgement(verdict="no data", figures=missing)
        judged = [_judged(*pair, replications) for pair in zip(tested.criteria, spread, strict=True)]
        verdict = verdict_of([one.outcome for one in judged])
        return Judgement(verdict=verdict, figures=tested.figures(), criteria=judged)


def _judged(point: Criterion, spread: Criterion | None, replications: int) -> Judged:
    value, margin = float(point.value), MARGIN
    if spread is None:
        interval, margin = Interval(value, value, value), 0.0
    elif point.kind == "replications":
        interval = proportion(round(value * replications), replications, VERDICT_CONFIDENCE)
    else:
        interval = Interval(value, *limits(value, spread.value, replications, is_share=point.kind == "share"))
    return Judged(what=point.what, interval=interval, relation=point.relation, bound=point.bound, margin=margin)


CLAIMS = (
    Claim(
        number=1, text="Followers abeam of the leader are located better than followers astern.", test=tests.lateral,
        criterion="E_P max on T3 and T4 is below the median of the other routes, and in most replications below each "
        f"of them; where steps are kept, mean E_P at {LATERAL_DEG[0]:.0f}–{LATERAL_DEG[1]:.0f}° off the bow is below "
        f"that within {ASTERN_DEG:.0f}° of astern on most missions that have both.",
    ),
    Claim(
        number=2, text="A message interval of 5 s costs little, 10 s much.", test=tests.interval,
        criterion="Mean E_P of LAISN-2 over that at 1 s: median at most 2 for 5 s, and at least 4 for 10 s.",
    ),
    Claim(
        number=3, text="A baseline of L = 1 m costs little.", test=tests.baseline,
        criterion="Mean E_P over that with L = 2 m: median at most 1.25, nine tenths at most 1.5.",
    ),
    Claim(
        number=4, text="H_T = 0.2 m changes nothing.", test=tests.offset,
        criterion="Mean E_P of LAISN-3(2) over that with 0.1 m: median within 10 %, nine tenths within 20 %.",
    ),
    Claim(
        number=5, text="With equal range errors the third transmitter does not help.", test=tests.third,
        criterion="Mean E_P of LAISN-3(2) over LAISN-2 at 1 and at 5 s: median at least 0.95, below 0.9 on at most a "
        "tenth of the missions.",
    ),
    Claim(
        number=6, text="LAISN-3(1) is worse than LAISN-2.", test=tests.worse,
        criterion="Mean and maximum of E_P over those of LAISN-2, Stage 1: median above 1, and above 1 on nine tenths "
        "of the missions.",
    ),
    Claim(
        number=7, text="With unequal range errors LAISN-3(2) wins on T2 and T5.", test=tests.asymmetric,
        criterion="Mean E_P of LAISN-3(2) at most 0.8 of that of LAISN-2: in the median, and on nine tenths of them.",
    ),
    Claim(
        number=8, text="A shared range error of μ_D = 0.3 m barely matters.", test=tests.shared,
        criterion="Mean E_P of LAISN-2 over that with 0.1 m: median at most 1.25, nine tenths at most 1.5.",
    ),
    Claim(
        number=9, text="The leader's heading error dominates T3 and T4, in proportion to distance.",
        test=tests.heading,
        criterion="At 5° mean E_P grows more on T3 and T4 than on the others, over fivefold (medians); a line through "
        "the origin over mean distance explains 80 % of its variance over missions.",
    ),
    Claim(
        number=10, text="The burst of T8 gives the largest bearing error.", test=tests.burst,
        criterion="E_B max of T8 (LAISN-2, Stage 1) is above the median of the others, and in most replications the "
        f"largest; where steps are kept, it occurs within {NEAR_BURST_S:.0f} s of the burst in most replications.",
    ),
)  # fmt: skip
