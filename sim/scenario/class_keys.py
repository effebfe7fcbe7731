"""Keys of a table that are fields of a class: of navigators, sensors, currents and disturbances,
the user's own and those of the project, by one rule.
"""

import difflib
import inspect
import math
from collections.abc import Mapping
from dataclasses import InitVar, is_dataclass
from typing import Annotated, Any, get_type_hints

from pydantic import BeforeValidator, ConfigDict, PydanticUserError, TypeAdapter, ValidationError
from pydantic_core import to_json

from laisn.errors import LaisnError, printable, shortened
from sim.scenario.section import in_si, quoted_bool_hint, split_unit

_VALUES = "a number, text, true, false, or a list of such"
_STRICT = ConfigDict(strict=True, allow_inf_nan=False)


def _value_or_tuple(value: Any) -> Any:
    """A value as it is, a list as a tuple, so that tables stay hashable."""
    if isinstance(value, list | tuple):
        return tuple(map(_value_or_tuple, value))
    if not isinstance(value, bool | int | float | str):
        raise ValueError(f"expected {_VALUES}")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("Input should be a finite number")
    return value


ClassValue = Annotated[Any, BeforeValidator(_value_or_tuple)]
"""What a table may hold for a field of a class, before the class is known."""


def _type_by_default(default: Any) -> Any:
    """Type of an argument that declares none that can be checked."""
    for kind, argument_type in ((bool, bool), (int, int | float), (float, int | float), (str, str)):
        if isinstance(default, kind):
            return argument_type
    return Any


class _Field:
    """What a class declares of one argument of its constructor."""

    def __init__(self, hint: Any, default: Any) -> None:
        """`hint` is its annotation, `inspect.Parameter.empty` if it has none, or none is known."""
        annotation = hint.type if isinstance(hint, InitVar) else hint
        if annotation is inspect.Parameter.empty:
            annotation = _type_by_default(default)
        try:
            self._type: TypeAdapter[Any] = TypeAdapter(annotation, config=_STRICT)
        except (PydanticUserError, NameError, TypeError):
            # of a type that cannot be checked, such as an array: the default shows what it is
            annotation = _type_by_default(default)
            self._type = TypeAdapter(annotation, config=_STRICT)
        self._takes_any_list = annotation in (tuple, Any)

    def checked(self, value: Any) -> Any:
        """A value as its type has it, whole numbers as `float` where that is the type, lists as
        lists or tuples; ValidationError if it is of another type.
        """
        # as from JSON, where a list is valid for a tuple, and a whole number for a float
        checked = self._type.validate_json(to_json(value, inf_nan_mode="constants"))
        return _value_or_tuple(value) if self._takes_any_list else checked


def _fields_of(kind: Any) -> tuple[dict[str, _Field], bool]:
    """Arguments that a class, or a function that makes objects, takes by name, and whether it takes
    any others, too.
    """
    try:
        parameters = inspect.signature(kind).parameters.values()
    except (TypeError, ValueError):
        return {}, True
    declared = kind
    if isinstance(kind, type) and not is_dataclass(kind):
        declared = kind.__init__  # type: ignore[misc]
    try:
        hints = get_type_hints(declared, include_extras=True)
    except (NameError, TypeError, AttributeError, SyntaxError):
        # names in annotations that are not there at run time
        hints = {}
    empty = inspect.Parameter.empty
    by_name = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    fields = {
        p.name: _Field(hints.get(p.name, empty), p.default) for p in parameters if p.kind in by_name
    }
    return fields, any(p.kind is inspect.Parameter.VAR_KEYWORD for p in parameters)


def _is_number(value: Any) -> bool:
    """Whether a value is a number, or a list of numbers, which a unit can have."""
    if isinstance(value, list | tuple):
        return all(map(_is_number, value))
    return isinstance(value, int | float) and not isinstance(value, bool)


def _problem(error: ValidationError) -> tuple[str, str]:
    """Where in a value the first error is, as `[1]`, and what should be there."""
    errors = error.errors(include_url=False, include_context=False)
    place = "".join(f"[{n}]" for n in errors[0]["loc"] if isinstance(n, int))
    # one for each type of a union
    messages = dict.fromkeys(detail["msg"].removeprefix("Value error, ") for detail in errors)
    first, *others = messages
    return place, " or ".join([first, *(text.removeprefix("Input should be ") for text in others)])


def class_arguments(
    kind: Any,
    name: str,
    table: Mapping[str, Any],
    where: str,
    *,
    hidden: frozenset[str] = frozenset(),
) -> dict[str, Any]:
    """Arguments for a class in SI units and radians by the keys of a table, which are its fields
    with or without unit; lists of numbers have the unit too.

    Args:
        kind: the class, or a function that makes objects.
        name: what messages call it.
        table: values by keys: numbers, texts, true, false, and lists of such.
        where: key of the table, for messages.
        hidden: fields that messages do not list.

    Raises:
        LaisnError: there is no such field, or a value is not of the type that the class declares.
    """
    fields, takes_others = _fields_of(kind)
    arguments = {}
    for key, value in table.items():
        field_name, unit, scale = (key, "", 1.0) if key in fields else split_unit(key)
        if field_name not in fields and not takes_others:
            close = difflib.get_close_matches(field_name, fields, n=1)
            hint = f"did you mean {close[0]!r}? " if close else ""
            names = ", ".join(field for field in fields if field not in hidden) or "none"
            raise LaisnError(f"{where}: {name} has no key {field_name!r}; {hint}it has: {names}")
        place = ""
        problem = ""
        if scale != 1.0 and not _is_number(value):
            problem = f"expected a number, or a list of numbers [{unit}]"
        else:
            [(_, argument)] = in_si({key: value}, fields).items()
            try:
                field = fields.get(field_name)
                arguments[field_name] = argument if field is None else field.checked(argument)
            except ValidationError as error:
                place, problem = _problem(error)
        if problem:
            given = shortened(printable(repr(value)), 80)
            raise LaisnError(
                f"{where}.{key}{place}: {problem} (given: {given}; {name}){quoted_bool_hint(value)}"
            )
    return arguments
