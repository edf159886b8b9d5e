"""The evaluations of policies: the settings of `ibdata.evaluate`, by set."""

from __future__ import annotations

from typing import Any

# The literature's evaluation (Hein et al., 2021 and later), of the sets at setpoint 70.
LITERATURE: dict[str, Any] = {
    "setpoint": 70.0,
    "start": "default",
    "dynamics": "siemens",
    "steps": 100,
    "discount": 0.97,
    "episodes": 200,
    "seed": 0,
}
LONG: dict[str, Any] = {"steps": 1000, "discount": 1.0}
TEN = [10.0 * i for i in range(1, 11)]
AT_TEN: dict[str, Any] = {**LITERATURE, "setpoint": TEN, "episodes": 100}
AFTER_BURN_IN: dict[str, Any] = {**AT_TEN, "start": {"burn_in": [15, 64]}}
LONG_AT_TEN: dict[str, Any] = {**AT_TEN, **LONG, "episodes": 20}
DRIFTING: dict[str, Any] = {**AT_TEN, "setpoint": {"drifting": [10.0, 30.0, 50.0, 70.0, 90.0]}}
# Published references for in-context learning have 250 steps, at these setpoints.
EVERY_FIVE = [5.0 * i for i in range(21)]
SHORT_EPISODES: dict[str, Any] = {**AT_TEN, "setpoint": EVERY_FIVE, "steps": 250, "discount": 1.0}

EVALUATIONS: dict[str, list[dict[str, Any]]] = {
    "random": [AT_TEN, AFTER_BURN_IN, LONG_AT_TEN],
    "safe": [AT_TEN, AFTER_BURN_IN, LONG_AT_TEN],
    "transfer": [{**LITERATURE, "setpoint": 75.0}],
    "drifting": [DRIFTING, {**DRIFTING, **LONG, "episodes": 20}],
    "random-paper": [{**AT_TEN, "dynamics": "paper"}, {**LONG_AT_TEN, "dynamics": "paper"}],
    "setpoints/random": [SHORT_EPISODES],
    "setpoints/expert": [SHORT_EPISODES],
}
