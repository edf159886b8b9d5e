"""The dynamics of an experiment: a published variant, or one with single fields replaced."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from pydantic import AfterValidator, Field, Tag, create_model

from ibdata.dynamics import PAPER, SIEMENS, VARIANTS, Variant
from ibdata.dynamics.variants import VariantError
from ibdata.experiment.fields import WHOLE, Real, by_type
from ibdata.policies.base import FrozenModel


class ReplacedFields(FrozenModel):
    """Base of `CustomDynamics`, which adds an optional field for each field of `Variant`."""

    base: Literal["siemens", "paper"]

    def variant(self) -> Variant:
        """The variant. Raises ValueError if its fields are invalid."""
        options = {field.name: getattr(self, field.name) for field in dataclasses.fields(Variant)}
        replacements = {name: value for name, value in options.items() if value is not None}
        return dataclasses.replace(VARIANTS[self.base], **replacements)


def _fitting(name: str) -> AfterValidator:
    """A validator of one field, which applies the rules of `Variant`; each rule concerns one field."""

    def check(value: Any) -> Any:
        try:
            dataclasses.replace(SIEMENS, **{name: value})
        except VariantError as error:
            raise ValueError(f"found {value}, expected it to {error.broken[name]}") from None
        return value

    return AfterValidator(check)


def _strict(hint: Any) -> Any:
    """The type of a field of `Variant`, with strict numbers as in the other models."""
    if get_origin(hint) is tuple:
        return tuple[tuple(_strict(part) for part in get_args(hint))]  # type: ignore[misc]  # known at run time
    return {float: Real, int: Annotated[int, WHOLE, Field(strict=True)]}[hint]


CustomDynamics = create_model(
    "CustomDynamics",
    __base__=ReplacedFields,
    __doc__="A published variant with single fields replaced.",
    **{
        name: (
            Annotated[_strict(hint), _fitting(name)] | None,
            Field(
                default=None, description=f"paper: {getattr(PAPER, name)}; siemens: {getattr(SIEMENS, name)}"
            ),
        )
        for name, hint in get_type_hints(Variant).items()
    },
)  # type: ignore[call-overload]  # the fields are those of Variant, known at run time only

Dynamics = Annotated[
    Annotated[Literal["siemens", "paper"], Tag("<word>")] | Annotated[CustomDynamics, Tag("<mapping>")],
    by_type("<word>", "<mapping>"),
]
