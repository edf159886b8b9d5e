"""Every policy by its kind, and the types of a policy's block within another block."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Union

from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema
from pydantic_core.core_schema import no_info_before_validator_function

from ibdata.policies.adapter import can_act
from ibdata.policies.base import Deterministic, Policy

# By kind, in alphabetical order: the package fills it when all its modules are imported.
POLICIES: dict[str, type[Policy]] = {}


class OneOf:
    """An annotation of a policy: a block of one of these kinds, its bare name, or an object that acts.

    It asks for the kinds when a block is checked for the first time. All policies are known by then.
    """

    def __init__(self, is_allowed: Callable[[type[Policy]], bool]) -> None:
        self._is_allowed = is_allowed

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        kinds = tuple(filter(self._is_allowed, POLICIES.values()))
        block = handler.generate_schema(Annotated[Union[kinds], Field(discriminator="kind")])  # noqa: UP007
        return no_info_before_validator_function(_block_of, block)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        block = handler(schema)
        options = {kind: POLICIES[kind].model_fields.values() for kind in block["discriminator"]["mapping"]}
        complete = [kind for kind, fields in options.items() if not any(x.is_required() for x in fields)]
        return {"anyOf": [{"enum": complete, "type": "string"}, block]}


def _block_of(value: Any) -> Any:
    """The block {kind: name} of a name, or that of an object of Python's; anything else as it is."""
    if isinstance(value, str):
        return {"kind": value}
    if isinstance(value, Mapping) and value.get("kind") == "custom" and can_act(value.get("target")):
        return {**value, "kind": "live"}
    is_policy = type(value) in POLICIES.values()
    return {"kind": "live", "target": value} if can_act(value) and not is_policy else value


def _may_be_certain(policy: type[Policy]) -> bool:
    """Whether a policy's actions are certain, or may be so by its option `deterministic`."""
    return issubclass(policy, Deterministic) or "deterministic" in policy.model_fields


AnyPolicy = Annotated[Policy, OneOf(lambda policy: True)]
DeterministicBase = Annotated[Policy, OneOf(_may_be_certain)]
