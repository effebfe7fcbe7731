"""Tables of README and docs, made of records."""

from collections.abc import Callable, Mapping, Sequence

from experiments.flight.library import ROUTES
from experiments.studies.front.findings import ARMS as FRONT_ARMS
from experiments.studies.front.findings import CASES as FRONT_CASES
from experiments.studies.rivals.findings import (
    CONDITIONS,
    INTERVALS,
    NAVIGATORS,
    USUAL_INTERVAL_S,
    WITH_TWO,
)
from experiments.study.file import built_in_files, study_of
from reports.findings import Finding
from tools.documents.coverage import LAWS, RUNS
from tools.documents.hull_trials import (
    PUBLISHED_HULLS,
    PUBLISHED_PITCH,
    PUBLISHED_SPEED,
    PUBLISHED_TURN,
)
from tools.documents.speed import costs, peers, speed, waiting
from tools.documents.table_text import Records, markdown
from tools.documents.tight_limits import RIVALS
from tools.documents.vehicle_missions import ROLES

STEERING = {
    "laisn-2": "LAISN-2",
    "laisn-3-1": "LAISN-3(1)",
    "laisn-3-2": "LAISN-3(2)",
    "tight-2": "tight, 2 transmitters",
    "tight-3": "tight, 3",
}
"""Navigators that followers steer by, in the findings of the study of closed loops; words."""
RATIOS = (
    ("Table 1: messages every 1 s", ("base",)),
    ("Tables 2 to 4: every 5 s", ("5s",)),
    ("Tables 2 to 4: every 10 s, Δt = 0.1 s and 1 s", ("10s", "10s-slow")),
    ("Table 5: L = 1 m", ("L1",)),
    ("Table 6: H_T = 0.2 m", ("HT0.2",)),
    ("Table 7: τ = 0.06 m at the rear, 0.01 m elsewhere", ("asymmetric",)),
    ("Tables 8 and 9: leader's compass 2.5° and 5° off", ("heading2.5", "heading5")),
)
"""Rows of the README's table: words, and conditions by their names in the findings."""
VEHICLES = {"leader": "leader, L"} | {route: route for route in ROUTES} | {"T8-plan": "T8, plan"}
"""Rows of the table of tracking: vehicles by their names in the findings, and words."""
TRACKED = {
    "off-rms": ".2f",
    "off-max": ".2f",
    "arrival": ".1f",
    "speed": ".3f",
    "depth": ".3f",
    "pitch-max": ".1f",
    "pitch-sigma": ".2f",
    "roll-max": ".1f",
}
"""Columns of the table of tracking, and their formats."""
AMONG_BEACONS = {
    "dead-reckoning": "odometry alone",
    "laisn-2": "LAISN-2, one range at a time",
    "hull": "tight, as on a leader's hull",
    "tight": "tight, among beacons",
    "unknown-start": "the same, unknown start, after a minute",
    "steady-gyro": "the same without the gyro's drift",
    "known-scale": "the same, the scale of the ranges taken as known to 0.3 % in place of 10 %",
    "exact-speed": "the same without a scale of speed",
    "exact-beacons": "the same without beacons' own errors",
}
"""Rows of the table of real ranges: navigators of the record, and words."""


def _ratio(finding: Finding) -> str:
    return f"{finding:.2f} ({finding:low .2f} … {finding:high .2f})"


def ratios(records: Records) -> str:
    """Mean E_P over the paper's, median and range of the missions."""
    record = records["reproduce-physics"]
    rows = []
    for words, conditions in RATIOS:
        cells = []
        for variant in ("laisn-2", "laisn-3-2"):
            keys = [f"ratio {condition} {variant}" for condition in conditions]
            cells.append(", ".join(_ratio(record[key]) for key in keys if key in record.findings))
        rows.append([words, *cells])
    heads = [
        "mean E_P, ours over the paper's: median of eight missions (least … largest)",
        "LAISN-2",
        "LAISN-3(2)",
    ]
    return markdown(heads, rows)


def closed_loop(records: Records) -> str:
    """Followers that steer by their own estimates, route by route."""
    record = records["closed-loop"]
    heads = ["route", *STEERING.values()]
    rows = []
    for route in ROUTES:
        cells = [route]
        for name in STEERING:
            errors = (f"{record[f'{kind} {name} {route}']:.2f}" for kind in ("error", "off"))
            cells.append(f"{', '.join(errors)}, {record[f'lost-runs {name} {route}']:d}")
        rows.append(cells)
    total = [f"lost, of {record['missions']:d}"]
    total += [
        f"{record[f'lost-runs {name}']:d}, {record[f'lost {name}']:.0% i}" for name in STEERING
    ]
    return markdown(heads, [*rows, total])


def closed_loop_current(records: Records) -> str:
    """Followers that steer by their own estimates in currents, navigator by navigator."""
    record = records["closed-loop"]
    rows = []
    for name, words in STEERING.items():
        if f"off current {name}" not in record.findings:
            continue  # newer than the record
        errors = [f"{record[f'{kind} current {name}']:.2f}" for kind in ("off", "worst")]
        lost = f"{record[f'lost current {name}']:.0% i}", f"{record[f'lost-runs current {name}']:d}"
        rows.append([words, *errors, *lost])
    heads = [
        "in currents",
        "off its place, RMS [m]: median mission",
        "median run of the worst route",
        "lost",
        "missions",
    ]
    return markdown(heads, rows)


def tracking(records: Records) -> str:
    """How closely vehicles keep to their routes."""
    record = records["route-keeping"]
    heads = [
        "route",
        "off track, RMS [m]",
        "max",
        "arrival [s]",
        "speed [m/s]",
        "depth [m]",
        "pitch, max [°]",
        "σ",
        "roll, max [°]",
    ]
    rows = [
        [name, *(format(record[f"{quantity} {key}"], spec) for quantity, spec in TRACKED.items())]
        for key, name in VEHICLES.items()
    ]
    return markdown(heads, rows)


def real_ranges(records: Records) -> str:
    """Errors among the beacons of both drives, navigator by navigator."""
    record = records["real-ranges"]
    rows = []
    for navigator, words in AMONG_BEACONS.items():
        cells = [words]
        for name in ("Plaza1", "Plaza2"):
            cells.append(
                f"{record[f'pairs {navigator} {name}']:.2f} "
                f"({record[f'worst-pair {navigator} {name}']:.2f})"
            )
            cells.append(f"{record[f'all {navigator} {name}']:.2f}")
        rows.append(cells)
    heads = [
        f"{name}: {score}"
        for name in ("Plaza 1", "Plaza 2")
        for score in ("two beacons, median (worst pair)", "all four")
    ]
    return markdown(["mean error [m]", *heads], rows)


def benchmark(records: Records) -> str:
    """Scores of LAISN-Bench, navigator by navigator, the best first."""
    record = records["benchmark"]
    names = [key.removeprefix("score ") for key in record.findings if key.startswith("score ")]
    rows = [
        [
            name,
            f"{record[f'score {name}']:.2f}",
            f"{record[f'worst {name}']:.1f} ({record[f'worst-mission {name}']:s})",
            f"{record[f'far {name}']:.0%}",
            f"{record[f'mean {name} astern']:.2f i}",
            f"{record[f'mean {name} quarter-two-slow']:.2f i}",
            f"{record[f'relative {name} astern']:.2f}",
            f"{record[f'nees {name} astern']:.2g}",
            f"{record[f'step {name}']:.2g}",
        ]
        for name in sorted(names, key=lambda name: record[f"score {name}"].number)
    ]
    heads = [
        "navigator",
        "score",
        "worst mission",
        "runs beyond 10 m",
        "`astern` [m]",
        "`quarter-two-slow` [m]",
        "RPE, 50 m [m]",
        "NEES",
        "step [µs]",
    ]
    return markdown(heads, rows)


def _cases(records: Records, keys: Sequence[tuple[str, str]]) -> str:
    """A row of the study of the estimators for each pair of words and key."""
    findings = records["estimators"].findings
    rows = []
    for words, key in keys:
        bound = "–"
        if f"bound {key}" in findings:
            bound = f"{findings[f'bound {key}']:.2f} ({findings[f'bound-worst {key}']:.2f})"
        locked = findings[f"mirror-locked {key}"]
        rows.append(
            [
                words,
                f"{findings[f'error {key}']:.2f}",
                f"{findings[f'laisn-2 {key}']:.2f}",
                f"{findings[f'ratio {key}']:.2f i}",
                f"{findings[f'worst {key}']:.2f}",
                bound,
                f"{findings[f'nees {key}']:.2f} ({findings[f'nees-least {key}']:.1f} … "
                f"{findings[f'nees-most {key}']:.1f})",
                f"{locked:.1% i}" if locked.number else f"{locked:.1%}",
            ]
        )
    heads = [
        "",
        "mean E_P [m]",
        "LAISN-2 [m]",
        "over LAISN-2",
        "worst route",
        "bound (worst route)",
        "NEES (least … most)",
        "mirror-locked",
    ]
    return markdown(heads, rows)


def estimators(records: Records) -> str:
    """The seven cases of the study of the estimators, messages every 5 s."""
    study = study_of(str(built_in_files("estimators")["cases"]), {})
    return _cases(
        records, [(f"{case}: {study.title('case', case)}", f"{case} 5") for case in study.cases]
    )


def estimators_at_sea(records: Records) -> str:
    """Physical missions by both navigators, messages every 1 s."""
    study = study_of(str(built_in_files("estimators")["sea"]), {})
    return _cases(records, [(study.title("case", sea), f"sea {sea}") for sea in study.cases])


def coverage(records: Records) -> str:
    """How often a 95 % interval of a mean holds it, law by law."""
    record = records["coverage"]
    rows = [
        [law.words, *(f"{record[f'{name} {runs}']:.1%}" for runs in RUNS)]
        for name, law in LAWS.items()
    ]
    return markdown(["coverage of 95 % intervals", *(f"{runs} runs" for runs in RUNS)], rows)


def _rivals(records: Records, columns: Mapping[str, tuple[str, str]]) -> str:
    """A row for each navigator of the study of rival methods: heads, findings with NAME for the
    navigator, formats.
    """
    findings = records["rivals"].findings
    rows = []
    for name, title in NAVIGATORS.items():
        cells = ((findings.get(key.replace("NAME", name)), spec) for key, spec in columns.values())
        rows.append(
            [title, *("–" if finding is None else f"{finding:{spec}}" for finding, spec in cells)]
        )
    return markdown(["", *columns], rows)


def tight_limits(records: Records) -> str:
    """Errors of the leader's position and slots of pings, with three and with two transmitters."""
    findings = records["tight-limits"]
    study = study_of("leader-errors", {})
    rows = []
    for transmitters, (ours, (plain_filter, laisn)) in zip((3, 2), RIVALS.items(), strict=True):
        for case in study.cases:
            errors = [
                f"{findings[f'error {arm} {case}']:.2f}" for arm in (ours, plain_filter, laisn)
            ]
            lowest, highest = (findings[f"nees-{end} {ours} {case}"] for end in ("least", "most"))
            rows.append(
                [
                    f"{study.title('case', case)}; {transmitters} transmitters",
                    *errors,
                    f"{findings[f'worst {ours} {case}']:.2f}",
                    f"{findings[f'least {plain_filter} {case}']:.3f i}",
                    f"{lowest:.1f} … {highest:.1f}",
                ]
            )
    heads = ["mean E_P [m]", "tight", "EKF", "LAISN-3(2), LAISN-2", "tight, worst route"]
    return markdown([*heads, "EKF less tight, least", "NEES of tight"], rows)


def rivals(records: Records) -> str:
    """Calm water by the interval of messages, consistency, losses and time."""
    columns = {
        f"mean E_P [m], every {t:g} s": (
            f"error NAME calm {t:g}",
            ".2f i" if t == USUAL_INTERVAL_S else ".2f",
        )
        for t in INTERVALS
    }
    columns_of_one_interval = {
        "worst route [m]": ("worst NAME calm 5", ".2f"),
        "less tightly coupled, every 5 s [m]": ("less tight NAME calm 5", ".3f i"),
        "95 % below [m]": ("high NAME calm 5", ".2f"),
        "NEES": ("nees NAME calm 5", ".3g"),
        "mirror-locked": ("locked NAME calm 5", ".0%"),
        "lost": ("lost NAME calm 5", ".0%"),
        "µs per step": ("step NAME", ".1f"),
    }
    return _rivals(records, columns | columns_of_one_interval)


def rivals_two(records: Records) -> str:
    """With two transmitters: means, worst routes and paired differences, messages every 5 s."""
    findings = records["rivals"].findings
    columns = {
        "mean E_P [m], every 1 s": ("error NAME two 1", ".2f"),
        "every 5 s": ("error NAME two 5", ".2f i"),
        "every 10 s": ("error NAME two 10", ".2f"),
        "worst route, every 5 s [m]": ("worst NAME two 5", ".2f"),
        "NEES": ("nees NAME two 5", ".3g"),
        "less tightly coupled, every 5 s [m]": ("less tight NAME two 5", ".3f i"),
    }
    rows = []
    for name, title in WITH_TWO.items():
        cells = ((findings.get(key.replace("NAME", name)), spec) for key, spec in columns.values())
        rows.append(
            [title, *("–" if finding is None else f"{finding:{spec}}" for finding, spec in cells)]
        )
    return markdown(["", *columns], rows)


def rivals_conditions(records: Records) -> str:
    """Mean errors in all conditions but calm water, messages every 5 s."""
    other = {name: title for name, title in CONDITIONS.items() if name != "calm"}
    return _rivals(
        records, {title: (f"error NAME {name} 5", ".2f") for name, title in other.items()}
    )


def rivals_closed(records: Records) -> str:
    """The same in closed loop, and how many are lost."""
    findings = records["rivals"].findings
    rows = []
    for name, title in NAVIGATORS.items():
        keys = [f"NAME {name} {condition}" for condition in CONDITIONS]
        cells = (
            "–"
            if k.replace("NAME", "closed-error") not in findings
            else f"{findings[k.replace('NAME', 'closed-error')]:.2f}, "
            f"{findings[k.replace('NAME', 'closed-lost')]:.0%}"
            for k in keys
        )
        rows.append([title, *cells])
    return markdown(["mean E_P [m], lost", *CONDITIONS.values()], rows)


REMUS_TERMS = {
    "published": "Fossen's model as published",
    "hull": "with the hull's normal force in place of lift and induced drag",
    "advance": "with the propeller's inflow along the axis in place of the whole speed",
    "fins": "with the incidence of the flow at the fins in place of the deflection alone",
    "slopes": "the same with slopes of 1.2 and 0.81 in place of his C_L of 0.5 and 0.7",
    "all": "with all of these",
    "ours": "this project, `remus100.xml`",
    "munk": "as published, with the eight Coriolis terms it removes",
    "damping": "as published, with damping that does not fade",
}
"""Rows of the table of `fossen`: models by their names in the findings, and words."""


def fossen(records: Records) -> str:
    """Fossen's REMUS 100 term by term."""
    record = records["hull-trials"]
    rows = [
        [words, *(f"{record[f'remus {key} {quantity}']:{spec}}" for quantity, spec in
                  (("turn", ".3f"), ("pitch", ".2f"), ("speed", ".3f"), ("apart", ".2f")))]
        for key, words in REMUS_TERMS.items()
    ]  # fmt: skip
    return markdown(
        ["model", "turn rate [°/s]", "pitch [°]", "speed [m/s]", "apart from ours [m]"], rows
    )


def remus_figures(records: Records) -> str:
    """REMUS 100: published figures, his propeller and fins on his hull here, and the shipped
    vehicle.
    """
    record = records["hull-trials"]
    rows = []
    for rpm, turns in PUBLISHED_TURN.items():
        figures = {"speed": ("final speed [m/s]", PUBLISHED_SPEED[rpm], ".3f")}
        for rudder, rate in turns.items():
            figures[f"turn {{}} {rudder}"] = (f"turn rate, {rudder}° of rudder [°/s]", rate, ".3f")
        figures["pitch"] = ("pitch, −5° of stern plane [°]", PUBLISHED_PITCH[rpm], ".2f")
        for key, (words, published, spec) in figures.items():
            name = key.format(rpm) if "{}" in key else f"{key} {rpm}"
            cells = (format(record[prefix + name], spec) for prefix in ("", "shipped "))
            rows.append([f"{words} at {rpm} /min", format(published, spec), *cells])
    return markdown(
        ["", "Fossen's code", "his hull, propeller and fins, here", "shipped `remus100`"], rows
    )


def hull_estimates(records: Records) -> str:
    """Estimated over published coefficients of slender vehicles."""
    record = records["hull-trials"]
    models = {name: hull.title for name, hull in PUBLISHED_HULLS.items()}
    names = dict.fromkeys(
        key.split(" ", 2)[2] for key in record.findings if key.startswith("estimate ")
    )
    rows = [
        [
            name,
            *(
                f"{record[key]:.2f}"
                if (key := f"estimate {model} {name}") in record.findings
                else "–"
                for model in models
            ),
        ]
        for name in names
    ]
    return markdown(["estimated / published", *models.values()], rows)


def routes_kept(records: Records) -> str:
    """Errors of the shipped vehicles on their routes in calm water."""
    record = records["hull-trials"]
    rows = [
        [
            f"`{model}`",
            *(
                f"{record[f'route {model} {role} {kind}']:.3f}"
                for role in ("follower", "leader")
                for kind in ("off", "depth")
            ),
        ]
        for model in ("leader", "follower", "remus100", "lauv", "bluerov2_heavy")
    ]
    return markdown(
        ["vehicle", "T5: off route [m]", "depth [m]", "L: off route [m]", "depth [m]"], rows
    )


def vehicle_missions(records: Records) -> str:
    """How each shipped vehicle keeps to routes and stations of the built-in scenarios."""
    record = records["vehicle-missions"]
    rows = []
    for model in ("leader", "follower", "remus100", "lauv", "bluerov2_heavy"):
        cells = [f"`{model}`"]
        for role in ("leader", "follower"):
            cells += [
                f"{record[f'{model} {role} {quantity}']:.2f}" for quantity in ("route", "depth")
            ]
        cells.append(f"{record[f'{model} station station']:.2f}")
        cells += [
            " / ".join(f"{record[f'{model} {role} {quantity}']:d}" for role in ROLES)
            for quantity in ("refused", "warned")
        ]
        rows.append(cells)
    heads = [
        "vehicle",
        "leader: off route [m]",
        "depth [m]",
        "follower: off route [m]",
        "depth [m]",
        "off station [m]",
        "refused",
        "warned",
    ]
    return markdown(heads, rows)


def bluerov_speeds(records: Records) -> str:
    """Steady speeds of the BlueROV2 beside those of the published code."""
    record = records["hull-trials"]
    trials = {
        "turn": "turn on the spot, full",
        "ascent": "ascent, full",
        "descent": "descent, full",
        "surge": "surge, a quarter",
        "sway": "sway, a quarter",
    }
    rows = [
        [
            label,
            *(f"{record[f'bluerov {trial} {source}']:.3f}" for source in ("published", "ours")),
            record.findings[f"bluerov {trial} ours"].unit,
        ]
        for trial, label in trials.items()
    ]
    return markdown(["motion, voltage", "published code", "simulation", "unit"], rows)


# of the tables of the thermocline: ranges, depths of leader and follower, navigators
_RANGES_M = ("50", "100", "200")
_DEPTHS = {"8-20": "8 and 20 m", "16-16": "16 and 16 m", "20-20": "20 and 20 m"}
_NAVIGATORS = {"laisn-2": "LAISN-2", "laisn-3-2": "LAISN-3(2)", "tight": "tightly coupled"}


def thermocline_fixes(records: Records) -> str:
    """Shifts of fixes without noise, by depths and range."""
    findings = records["bending"].findings
    fixed = ("laisn-2", "laisn-3-2")
    heads = [f"{_NAVIGATORS[name]}, {range_m} m [m]" for name in fixed for range_m in _RANGES_M]
    rows = [
        [
            label,
            *(
                f"{findings[f'fix {name} strong {depths} {range_m} 2']:.2f}"
                for name in fixed
                for range_m in _RANGES_M
            ),
        ]
        for depths, label in _DEPTHS.items()
    ]
    return markdown(["depths of leader and follower", *heads], rows)


def thermocline_legs(records: Records) -> str:
    """Errors of navigators on a leg, and what the mean speed adds."""
    findings = records["thermocline"].findings
    rows = [
        [
            f"{title}, {label}",
            *(
                f"{findings[f'{key} {name} strong {depths} {range_m}']:.2f}"
                for range_m in _RANGES_M
                for key in ("error", "added")
            ),
        ]
        for name, title in _NAVIGATORS.items()
        for depths, label in _DEPTHS.items()
    ]
    heads = [f"{key}{range_m} m [m]" for range_m in _RANGES_M for key in ("", "added at ")]
    return markdown(["navigator, depths", *heads], rows)


_SEASONS = ("weak", "moderate", "strong")
"""Seasons of the study, named after the strength of their thermoclines."""


def thermocline_seasons(records: Records) -> str:
    """What the mean speed adds to errors at 100 m, by thermocline and baseline."""
    findings = records["thermocline"].findings
    rows = [
        [
            f"{title}, {label}",
            *(
                f"{findings[f'added {name} {season} {depths} 100{baseline}']:.2f i}"
                for baseline in (" 1", "")
                for season in _SEASONS
            ),
        ]
        for name, title in _NAVIGATORS.items()
        for depths, label in _DEPTHS.items()
    ]
    heads = [f"{season}, baseline {b} m [m]" for b in (1, 2) for season in _SEASONS]
    return markdown(["navigator, depths", *heads], rows)


def thermocline_closed(records: Records) -> str:
    """Distances of a follower that steers by its estimate."""
    findings = records["thermocline"].findings
    rows = []
    for name, title in _NAVIGATORS.items():
        for season in _SEASONS:
            key = f"off {name} {season}".removesuffix(" strong")
            numbers = [f"{findings[f'{key} {sound}']:.2f}" for sound in ("straight", "profile")]
            rows.append([f"{title}, {season}", *numbers, f"{findings[f'{key} added']:.2f i}"])
    heads = ["by the mean speed [m]", "by the profile [m]", "difference [m]"]
    return markdown(["navigator, thermocline", *heads], rows)


def thermocline_formation(records: Records) -> str:
    """Distances of followers from their stations."""
    findings = records["thermocline"].findings
    rows = []
    for name, title in _NAVIGATORS.items():
        for season in _SEASONS:
            cells = []
            for size in ("near", "wide"):
                key = f"station {name} {season} {size}"
                cells += [f"{findings[f'{key} straight']:.2f}", f"{findings[f'{key} added']:.2f i}"]
            rows.append([f"{title}, {season}", *cells])
    heads = ["within 43 m [m]", "added [m]", "within 107 m [m]", "added there [m]"]
    return markdown(["navigator, thermocline", *heads], rows)


def front(records: Records) -> str:
    """A formation in still water, in a current and through a front."""
    findings = records["front"].findings
    rows = [
        [
            title,
            *(f"{findings[f'station {name} {case}']:.2f i}" for case in FRONT_CASES),
            f"{findings[f'largest {name} front']:.1f}",
        ]
        for name, title in FRONT_ARMS.items()
    ]
    heads = ["still water [m]", "current everywhere [m]", "front [m]", "largest at the front [m]"]
    return markdown(["steered by", *heads], rows)


TABLES: dict[str, Callable[[Records], str]] = {
    "ratios": ratios,
    "coverage": coverage,
    "closed-loop": closed_loop,
    "closed-loop-current": closed_loop_current,
    "tracking": tracking,
    "real-ranges": real_ranges,
    "benchmark": benchmark,
    "speed": speed,
    "peers": peers,
    "costs": costs,
    "waiting": waiting,
    "estimators": estimators,
    "estimators-at-sea": estimators_at_sea,
    "tight-limits": tight_limits,
    "rivals": rivals,
    "thermocline-fixes": thermocline_fixes,
    "thermocline-legs": thermocline_legs,
    "thermocline-seasons": thermocline_seasons,
    "thermocline-closed": thermocline_closed,
    "thermocline-formation": thermocline_formation,
    "front": front,
    "rivals-two": rivals_two,
    "rivals-conditions": rivals_conditions,
    "rivals-closed": rivals_closed,
    "fossen": fossen,
    "remus-figures": remus_figures,
    "hull-estimates": hull_estimates,
    "routes-kept": routes_kept,
    "vehicle-missions": vehicle_missions,
    "bluerov-speeds": bluerov_speeds,
}
"""Tables by their names in documents."""
