"""The paper's tables with our figures beside the published ones."""

from collections.abc import Mapping, Sequence

import numpy as np

from experiments.pages.page import Block, Cell, Table, Text, number, ratio_tone, words
from experiments.reproduction.record import Reproduction, ratios
from experiments.reproduction.stages import METRICS, Key, Setting
from laisn.settings import Variant

VARIANT_NAMES: dict[Variant, str] = {"laisn-2": "LAISN-2", "laisn-3-1": "LAISN-3(1)", "laisn-3-2": "LAISN-3(2)"}
METRIC_NAMES = dict(
    zip(METRICS, ("E_P max [m]", "E_B max [°]", "E_P mean [m]", "E_B mean [°]", "σ E_P [m]", "σ E_B [°]"), strict=True)
)
FAR = 2.0
"""A row whose mean E_P differs by more than this factor is listed as far off."""
SLOW_S = 10.0
"""Message interval at which the paper's settings are not known [s]."""


def _pair(result: Reproduction, key: Key, metric: str) -> list[Cell]:
    """The published figure and ours, coloured by their ratio."""
    ours = float(result.rows[key][metric])
    theirs = result.published.get(key, {}).get(metric)
    if theirs is None:
        return [number(None), number(ours)]
    ratio = ours / theirs
    title = f"{ours:.4g} / {theirs:g} = {ratio:.2f}"
    return [number(theirs, tone="theirs"), number(ours, tone=ratio_tone(ratio), title=title)]


def missions(result: Reproduction) -> list[str]:
    """Names of the missions, in order."""
    return list(dict.fromkeys(mission for _, mission, _ in result.rows))


def _name(mission: str, variant: Variant) -> Cell:
    return words(f"{mission} {VARIANT_NAMES[variant]}".replace("-", "\N{NON-BREAKING HYPHEN}"))


def one_setting(result: Reproduction, setting: Setting, caption: str) -> Table:
    """A table of one setting: six figures in pairs, or ours alone where nothing was published."""
    rows, published = [], setting.table not in {"text", "alternative"}
    for mission in missions(result):
        for variant in setting.variants:
            cells = [_name(mission, variant)]
            for metric in METRICS:
                pair = _pair(result, (setting.name, mission, variant), metric)
                cells += pair if published else pair[1:]
            rows.append(cells)
    if not published:
        return Table(heads=["", *METRIC_NAMES.values()], rows=rows, caption=caption)
    groups = [("", 1), *((name, 2) for name in METRIC_NAMES.values())]
    return Table(heads=["", *["paper", "ours"] * len(METRICS)], rows=rows, caption=caption, groups=groups)


def several_settings(result: Reproduction, settings: Sequence[Setting], metrics: Sequence[str], caption: str) -> Table:
    """A table of several settings, as Tables 2 to 4: two figures of each."""
    rows = []
    for mission in missions(result):
        for variant in settings[0].variants:
            cells = [_name(mission, variant)]
            for setting in settings:
                for metric in metrics:
                    cells += _pair(result, (setting.name, mission, variant), metric)
            rows.append(cells)
    groups = [("", 1), *((f"{s.title}: {METRIC_NAMES[m]}", 2) for s in settings for m in metrics)]
    heads = ["", *["paper", "ours"] * (len(settings) * len(metrics))]
    return Table(heads=heads, rows=rows, caption=caption, groups=groups)


def median_ratios(result: Reproduction) -> Table:
    """Median ratio over missions of every setting and variant."""
    rows = []
    for setting in (s for s in result.settings if s.table not in {"text", "alternative"}):
        for variant in setting.variants:
            cells = [words(f"Table {setting.table}"), words(setting.title), words(VARIANT_NAMES[variant])]
            for metric in METRICS:
                found = ratios(result.rows, result.published, setting, variant, metric)
                median = float(np.median(found))
                cells.append(number(median, tone=ratio_tone(median), title=f"{found.min():.2f} … {found.max():.2f}"))
            rows.append(cells)
    caption = (
        "Ours over the paper's, median over the missions; where the pointer rests, the least and the largest of them."
    )
    return Table(heads=["", "setting", "variant", *METRIC_NAMES.values()], rows=rows, caption=caption)


def alternatives_table(result: Reproduction, alternatives: Sequence[Setting]) -> Table:
    """Mean E_P with alternative settings beside the published rows of the same intervals."""
    rows = []
    for setting in alternatives:
        for variant in setting.variants:
            cells = [words(setting.title), words(VARIANT_NAMES[variant])]
            for mission in missions(result):
                theirs = result.published[setting.like, mission, variant]["e_p_mean_m"]
                ours = result.rows[setting.name, mission, variant]["e_p_mean_m"]
                ratio = ours / theirs
                cells += [number(theirs, tone="theirs"), number(ours, tone=ratio_tone(ratio), title=f"{ratio:.2f}")]
            rows.append(cells)
    names = missions(result)
    groups = [("", 2), *((m, 2) for m in names)]
    heads = ["setting", "variant", *["paper", "ours"] * len(names)]
    return Table(heads=heads, rows=rows, groups=groups, caption="Mean E_P [m] with the alternative settings.")


def _reason(setting: Setting, row: Mapping[str, float], theirs: float) -> str:
    """What is known about a row that is far off."""
    known = []
    free = row.get("e_p_mean_uncaptured_m")
    if row["captured_runs"]:
        known.append(f"{row['captured_runs']:.0f} of {row['runs']:.0f} runs were on the mirror side for a while")
        if free is not None:
            known.append(f"the others have {free:.2f} m ({free / theirs:.2f} of the paper's)")
    if setting.name == "asymmetric":
        known.append("unequal errors act most near astern, where the published route is not known to a metre")
    return "; ".join(known) or "the follower's route is only like the published one"


def far_off(result: Reproduction) -> list[Block]:
    """Rows that differ much from the published ones, and what is known about each."""
    rows, slow = [], 0
    by_name = {setting.name: setting for setting in result.settings}
    for key, theirs in ((key, result.published[key]["e_p_mean_m"]) for key in result.rows if key in result.published):
        setting, ours = by_name[key[0]], result.rows[key]["e_p_mean_m"]
        ratio = ours / theirs
        if 1 / FAR < ratio < FAR:
            continue
        if setting.scenario.timing.message_interval_s == SLOW_S:
            slow += 1
            continue
        cells = [words(f"Table {setting.table}"), words(setting.title), _name(key[1], key[2])]
        cells += [number(theirs), number(ours), number(ratio, tone=ratio_tone(ratio))]
        rows.append([*cells, words(_reason(setting, result.rows[key], theirs))])
    published = sum(key in result.published for key in result.rows)
    text = f"{slow + len(rows)} of {published} rows differ by more than a factor of {FAR:g} in mean E_P. "
    if slow:
        text += (
            f"{slow} of them have a message interval of {SLOW_S:g} s: there none of the listed β and T fits the "
            "paper's rows (Stage 2 shows alternatives). "
        )
    if not rows:
        return [Text(text=text)]
    heads = ["", "setting", "row", "paper", "ours", "ratio", "what is known"]
    return [Text(text=f"{text}The other {len(rows)}:"), Table(heads=heads, rows=rows)]


def all_rows(result: Reproduction) -> Table:
    """What the paper does not print: percentiles, consistency, mirror captures, the worst run."""
    rows = []
    names = {s.name: s.title for s in result.settings}
    for key, row in result.rows.items():
        cells = [words(names[key[0]]), _name(key[1], key[2])]
        cells += [number(row["e_p_p50_m"]), number(row["e_p_p95_m"]), number(row["e_b_p95_deg"])]
        cells += [number(row["nees"], 1), number(row["nis"], 1), number(int(row["captured_runs"]))]
        cells += [number(int(row["fixes_gated"])), number(int(row["worst_run"]))]
        rows.append(cells)
    heads = ["setting", "row", "E_P 50 % [m]", "95 %", "E_B 95 % [°]", "NEES", "NIS", "captured", "rejected"]
    heads.append("worst run")
    caption = (
        "Percentiles of all steps and runs; NEES and NIS of the position (2 if the covariance is right; here it is no "
        "covariance: σ_p is β over the distance of two intersections, millimetres where errors are decimetres, so that "
        "NEES goes into the thousands and beyond); runs "
        "that were on the mirror side for a message interval; fixes that the gate rejected; the run with the largest "
        "E_P, which "
        "the command in tables.csv flies."
    )
    return Table(heads=heads, rows=rows, caption=caption)
