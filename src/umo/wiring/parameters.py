"""The arguments of a user's function, made from plain data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from umo.errors import OptionError
from umo.signature import is_converted, parameters_of


def arguments_for(function: Callable[..., Any], taker: str, given: Mapping[str, Any], skip: int = 0) -> dict[str, Any]:
    """Return the options that the function takes. A string is converted to the Enum or Path of its parameter. Raises
    OptionError for a string that cannot be converted or is not a choice of a Literal, and for a missing value of a
    parameter without a default. Other numbers and strings are passed on unchanged."""
    parameters = parameters_of(function, skip)
    for name, parameter in parameters.items():
        if parameter.default is parameter.empty and name not in given:
            raise OptionError(f"{flag(name)} is missing: the {taker} requires it")
    accepted = {name: parameter for name, parameter in parameters.items() if name in given}
    if not accepted:
        return {}
    from pydantic import ValidationError

    from umo.wiring.schema import options_of
    from umo.wiring.schema_mistakes import mistakes_of

    checked = {
        name: each if is_converted(each.annotation) else each.replace(annotation=Any) for name, each in accepted.items()
    }
    try:
        return options_of(taker, checked, {name: given[name] for name in accepted})
    except ValidationError as error:
        name, message = next(mistakes_of(error, list(accepted)))
        raise OptionError(f"{flag(name)}: {message}") from None


def flag(name: str) -> str:
    """Return the option of a parameter on the command line."""
    return f"--{name.replace('_', '-')}"


def option_words(name: str, value: Any) -> list[str]:
    """Return an option with its value as words of a command; for a list, the option with one value after another."""
    if isinstance(value, bool):
        return [flag(name if value else f"no_{name}")]
    if isinstance(value, list | tuple):
        return [word for each in value for word in option_words(name, each)]
    return [flag(name), str(value)]
