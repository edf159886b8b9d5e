"""Lists of the options of a block of YAML, from its JSON Schema."""

import json
import re
from typing import Any

from ibdata.experiment import Experiment

SCHEMA = Experiment.model_json_schema()
SMALL = {"BurnIn", "Drifting", "EpisodeRange", "SetpointRange"}  # blocks that their options explain
NUMBERS = {"integer": "whole number", "number": "number", "string": "text", "boolean": "`true` or `false`"}


def options(definition: dict[str, Any], leave_out: tuple[str, ...] = ()) -> str:
    """A Markdown list of the options of a block, which fits a phone as a table would not."""
    items = []
    for name, option in definition["properties"].items():
        default, facts = option.get("default"), _form(option)
        if name in definition.get("required", []):
            facts += ", **required**"
        elif default is not None and not isinstance(default, dict):
            facts += f", default {_code(default)}"
        if name not in leave_out:
            items.append(f"- `{name}` ({facts}): {option.get('description', '')}".removesuffix(": "))
    return "\n".join(items)


def blocks_of(name: str) -> list[str]:
    """The names of the definitions that a definition refers to."""
    return sorted(set(re.findall(r'"#/\$defs/(\w+)"', json.dumps(SCHEMA["$defs"][name]))))


def _form(schema: dict[str, Any]) -> str:
    """The values of an option in words."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        keys = SCHEMA["$defs"][name]["properties"]
        return f"`{{{', '.join(keys)}}}`" if name in SMALL else f"[{name}](#{name.lower()})"
    if any("discriminator" in option for option in (schema, *schema.get("anyOf", ()))):
        return "[policy](policies.md)"
    if choices := schema.get("oneOf") or schema.get("anyOf"):
        return " or ".join(_form(choice) for choice in choices if choice.get("type") != "null")
    if "const" in schema or "enum" in schema:
        return " or ".join(_code(x) for x in schema.get("enum", [schema.get("const")]))
    if "prefixItems" in schema:
        forms = [_form(item) for item in schema["prefixItems"]]
        return f"list of {len(forms)}: {forms[0]}" if len({*forms}) == 1 else f"[{', '.join(forms)}]"
    if schema["type"] == "array":
        return f"list of: {_form(schema['items'])}"
    if schema["type"] == "object":
        patterns = schema.get("patternProperties", {})
        values = schema.get("additionalProperties") or next(iter(patterns.values()), True)
        return f"mapping of names to {_form(values) if isinstance(values, dict) else 'anything'}"
    return NUMBERS[schema["type"]] + _bounds(schema)


def _code(value: Any) -> str:
    """A value as YAML spells it, in backticks."""
    return f"`{json.dumps(value).strip(chr(34))}`"


def _bounds(schema: dict[str, Any]) -> str:
    """The range of a number in words."""
    words = {"minimum": "from", "exclusiveMinimum": "above", "maximum": "to", "exclusiveMaximum": "below"}
    found = [(word, schema[key]) for key, word in words.items() if schema.get(key) is not None]
    return "".join(f" {word} {_number(value)}" for word, value in found)


def _number(value: float) -> str:
    power = isinstance(value, int) and value > 2**16 and value.bit_count() == 1
    return f"2^{int(value).bit_length() - 1}" if power else f"{value:g}"
