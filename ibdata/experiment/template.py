"""The experiment that `ibdata init` writes: small, with every option and what it may be."""

from __future__ import annotations

import os
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from ibdata.errors import IbdataError, UsageError
from ibdata.experiment.scalars import FileName
from ibdata.numerics.naming import yaml_name

TEXT = """\
# An experiment of ibdata: everything that decides what is in a dataset.
name: {name}

# siemens: what the authors' code computes, and nearly all published results rest on.
# paper: the equations as printed. Or single fields replaced: {{base: siemens, eta_mean: 0.05}}
dynamics: siemens

# In [0, 100]: one number, a list, a range with its stop, or moving ones: drifting, {{drifting: [10, 50]}}
setpoints: {{start: 10, stop: 100, step: 10}}

# Each policy is combined with each setpoint; `ibdata policies` lists them with their options.
policies:
  - kind: random
  - kind: epsilon_greedy
    base: {{kind: optimized}}
    epsilon: 0.4
    name: explored              # its label in the data; without one, its kind

episodes: 2                     # of each setpoint and policy
steps: 1000                     # rows of an episode

# default: velocity = gain = shift = 50; uniform: anywhere; {{burn_in: [15, 64]}}: random steps before it
start: default
seed: 0

output:
  dtype: float32                # or float64
  latent: true                  # the hidden state at t; false; full: with derived values; next: also at t + 1

# Named sets of episodes, each of whole files: by setpoint, policy, and episodes of each combination.
splits:
  source: {{setpoint: 50}}
  target: {{setpoint: 70, episodes: 1}}
"""


def template(name: str) -> str:
    """The text of the experiment under a name."""
    return TEXT.format(name=yaml_name(name))


def write_template(file: str | os.PathLike[str]) -> None:
    """Write it, named as the file. UsageError where the file exists, IbdataError where the system refuses."""
    path = Path(file)
    try:
        name = TypeAdapter(FileName).validate_python(path.stem)
    except ValidationError:
        name = "experiment"
    try:
        with path.open("x", encoding="utf-8") as new:
            new.write(template(name))
    except FileExistsError:
        raise UsageError(f"{path}: exists already; choose another name") from None
    except OSError as error:
        raise IbdataError(f"{path}: cannot be written: {error.strerror}") from None
