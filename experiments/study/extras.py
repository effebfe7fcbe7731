"""Arms of a study that need a package which is not installed."""

from collections.abc import Mapping
from dataclasses import replace

from experiments.study.file import Arm, Study
from laisn.errors import LaisnError
from laisn.navigators import NAVIGATORS

VARIANT = "navigation.variant"


def missing_for(variant: object) -> str:
    """What a navigator of this project needs that is not installed, and what to do; else empty."""
    spec = NAVIGATORS.get(variant) if isinstance(variant, str) else None
    return spec.missing if spec else ""


def arms_left_out(studies: Mapping[str, Study]) -> dict[str, str]:
    """What arms of studies lack that is not installed, by their titles."""
    arms = [arm for study in studies.values() for arm in study.arms.values()]
    reasons = {arm.title or arm.name: missing_for(arm.settings.get(VARIANT)) for arm in arms}
    return {title: reason for title, reason in reasons.items() if reason}


def _without_missing(study: Study) -> Study:
    arms: dict[str, Arm] = {
        name: arm for name, arm in study.arms.items() if not missing_for(arm.settings.get(VARIANT))
    }
    cases = {
        name: case.model_copy(update={"arms": [arm for arm in case.arms if arm in arms]})
        for name, case in study.cases.items()
    }
    return replace(study, arms=arms, cases=cases)


def installed(studies: Mapping[str, Study]) -> dict[str, Study]:
    """Parts of a study without the arms that cannot be flown here; a part without arms is left out.

    LaisnError if nothing remains.
    """
    parts = {
        name: _without_missing(study) if arms_left_out({name: study}) else study
        for name, study in studies.items()
    }
    remaining = {
        name: study for name, study in parts.items() if study.arms or not studies[name].arms
    }
    if not remaining:
        reasons = arms_left_out(studies)
        raise LaisnError("; ".join(f"{title} {reason}" for title, reason in reasons.items()))
    return remaining
