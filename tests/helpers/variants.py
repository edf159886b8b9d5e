"""The fields of a variant, a row each, and variants that differ from a published one in a single field."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

from ibdata.dynamics import VARIANTS, Variant

NAN = math.nan


class Field(NamedTuple):
    """What a field is, and what moves and breaks it."""

    paper: Any
    siemens: Any
    rule: str
    refused: tuple[Any, ...]
    moved: tuple[Any, ...]  # its ends among them, by which what assumes a published value would be wrong


FIELDS = {
    "eta_mean": Field(0.05, 0.1, "in (0, 10]", refused=(0.0, 10.5, NAN), moved=(0.01, 1.0, 1.5, 10.0)),
    "eta_squash": Field(
        (1.0, 0.0),
        (2.0, 0.5),
        "keep scale · (σ - shift) in [0, 1] for σ in [½, 1]",
        refused=((3.0, 0.5), (1.0, 0.6), (1.0, NAN)),  # up to 3 · ½; from 0.5 - 0.6
        moved=((1.25, 0.2),),  # 1/scale + shift is 1, as the law of the noise needs it
    ),
    "effective_velocity_ends": Field(
        ((0.0, 100.0), (100.0, 0.0)),
        ((100.0, 0.0), (0.0, 100.0)),
        "be (0, 100) and (100, 0) in one order or the other",
        refused=(
            ((0.0, 100.0), (0.0, 100.0)),
            ((0.0, 0.0), (100.0, 100.0)),
            ((0.0, 100.0), (100.0, NAN)),
        ),
        moved=(((0.0, 100.0), (100.0, 0.0)), ((100.0, 0.0), (0.0, 100.0))),
    ),
    "bernoulli_bounds": Field(
        (0.0, 1.0),
        (0.001, 0.999),
        "ordered in [0, 1]",
        refused=((0.9, 0.1), (-0.1, 1.0), (0.0, 1.1), (NAN, 1.0)),
        moved=((0.2, 0.6), (1.0, 1.0)),
    ),
    "alpha_threshold": Field(1.2, 5.0, "in [0, 5]", refused=(-0.1, 5.1, NAN), moved=(0.0, 0.4)),
    "convolution_weights": Field(
        (1 / 9, 2 / 9, 3 / 9, 2 / 9, 1 / 9),
        (0.11111, 0.22222, 0.33333, 0.22222, 0.11111),
        "in [0, 1] and sum to 1 within 1e-4",
        refused=(
            (0.2, 0.2, 0.2, 0.2, 0.1998),
            (1.0, 2.0, 3.0, 2.0, 1.0),
            (-0.1, 0.3, 0.6, 0.3, -0.1),
            (NAN,) * 5,
        ),
        moved=((1.0, 0.0, 0.0, 0.0, 0.0),),
    ),
    "consumption_offset": Field(0.0, 1.0, "in [-100, 100]", refused=(100.5, NAN), moved=(-100.0, 100.0)),
    "consumption_noise": Field(0.02, 0.005, "in [0, 0.04]", refused=(-0.001, 0.041, NAN), moved=(0.0, 0.04)),
    "drift_rate": Field(
        (0.0, 1.0),
        (-1.0, 1.0),
        "ordered in [-100, 100]",
        refused=((1.0, -1.0), (-101.0, 1.0), (0.0, 100.5), (0.0, NAN)),
        moved=((-5.0, 5.0),),
    ),
    "drift_length": Field(
        100, 99, "a whole number in [1, 1e6]", refused=(0, 2.5, 1_000_001, math.inf, NAN), moved=(3,)
    ),
    "drift_flip": Field(
        (0.5, 0.0),
        (0.0, 0.5),
        "two probabilities, one of them 0",
        refused=((0.0, 1.5), (-0.5, 0.0), (0.5, 0.5), (0.0, NAN)),
        moved=((1.0, 0.0),),
    ),
}
assert list(FIELDS) == [field.name for field in dataclasses.fields(Variant)], "a field has no row here"
VARIANTS_MOVED = dict(VARIANTS) | {
    f"{base}, {name} {value}": dataclasses.replace(variant, **{name: value})
    for base, variant in VARIANTS.items()
    for name, field in FIELDS.items()
    for value in field.moved
}
