"""Views: each option in one that the environment replays."""

from __future__ import annotations

from typing import Any

VIEWS: list[dict[str, Any]] = [
    {"observe": "markov", "reward_scale": 0.01, "cost": "runaway"},
    {"observe": ["latent_mu_g", "obs_fatigue"], "reward": {"consumption": 1, "fatigue": 1}},
    {
        "actions": True,
        "cost": {"fatigue": 40},
        "reward": "delta",
        "reward_scale": 0.1,
        "imperfections": {
            "delay": {"obs_fatigue": 3},
            "noise": {"obs_consumption": 5.0},
            "missing": {"obs_consumption": 0.3, "obs_gain": 0.1},
            "mask": True,
            "seed": 4,
        },
    },
]
