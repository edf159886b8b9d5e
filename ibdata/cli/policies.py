"""ibdata policies."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import click

from ibdata.cli._shared import json_option, print_json, say


@click.command("policies")
@json_option
def command(as_json: bool) -> None:
    """List the policies and their options.

    \b
    ibdata policies
    ibdata policies --json
    """
    from ibdata.policies import described

    found = described()
    if as_json:
        print_json({"policies": found})
        return
    for policy in found:
        say(f"{policy['kind']}: {policy['summary']}")
        for option in policy["options"]:
            say(f"    {option['name']} ({_default(option)}): {option['description']}")


def _default(option: Mapping[str, Any]) -> str:
    return "required" if option["required"] else f"default {json.dumps(option['default'])}"
