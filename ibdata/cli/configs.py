"""ibdata configs."""

from __future__ import annotations

import click

from ibdata.cli._shared import json_option, print_json, print_list


@click.command("configs")
@json_option
def command(as_json: bool) -> None:
    """List the experiments that come with ibdata, with their rows and a description.

    A name that ends with / is that of a folder of experiments.

    \b
    ibdata configs
    ibdata generate random.yaml
    """
    from ibdata.experiment.catalogue import catalogue

    found = catalogue()
    if as_json:
        print_json({"configs": [each._asdict() for each in found]})
        return
    print_list(("config", "rows", ""), [(each.name, f"{each.rows:,}", each.description) for each in found])
