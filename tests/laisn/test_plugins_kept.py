"""Results that are kept as long as plugins stay as they are."""

from pathlib import Path

import pytest

from laisn.plugins import PLUGINS_VARIABLE, kept_with_plugins, load_plugin, plugins_version


@kept_with_plugins(2)
def pair_of(first: int, second: int) -> list[int]:
    return [first, second]


def test_equal_arguments_give_the_object_that_was_made_first() -> None:
    kept = pair_of(1, 2)
    assert pair_of(1, 2) is kept
    assert pair_of(2, 1) == [2, 1]
    assert pair_of(1, 3) == [1, 3]
    # two are kept at most
    assert pair_of(1, 2) == kept
    assert pair_of(1, 2) is not kept


def test_an_error_is_not_kept() -> None:
    answers = iter([ValueError("first"), 5])

    @kept_with_plugins(2)
    def answer(_question: str) -> int:
        value = next(answers)
        if isinstance(value, Exception):
            raise value
        return value

    with pytest.raises(ValueError, match="first"):
        answer("same")
    assert answer("same") == 5
    assert answer("same") == 5


def test_what_was_made_before_a_plugin_changed_does_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(PLUGINS_VARIABLE, "")
    file = tmp_path / "kept_with_plugins_example.py"
    file.write_text("FACTOR = 2\n", encoding="utf-8")
    load_plugin(file)
    before = pair_of(7, 7)
    assert pair_of(7, 7) is before
    file.write_text("FACTOR = 33\n", encoding="utf-8")
    # a source that was not imported anew is not used either
    assert pair_of(7, 7) is before
    plugins_version(refresh=True)
    assert pair_of(7, 7) is not before
