"""Variants of the dynamics: the published ones, and those that differ from one of them in a single field."""

from __future__ import annotations

import dataclasses

from ibdata.dynamics import VARIANTS, Variant

# Values of each field, its ends among them, by which what assumes a published value would be wrong.
MOVED = {
    "eta_mean": (0.01, 1.0, 1.5, 10.0),
    "eta_squash": ((1.25, 0.2),),  # 1/scale + shift is 1, as the law of the noise needs it
    "effective_velocity_ends": (((0.0, 100.0), (100.0, 0.0)), ((100.0, 0.0), (0.0, 100.0))),
    "bernoulli_bounds": ((0.2, 0.6), (1.0, 1.0)),
    "alpha_threshold": (0.0, 0.4),
    "convolution_weights": ((1.0, 0.0, 0.0, 0.0, 0.0),),
    "consumption_offset": (-100.0, 100.0),
    "consumption_noise": (0.0, 0.04),
    "drift_rate": ((-5.0, 5.0),),
    "drift_length": (3,),
    "drift_flip": ((1.0, 0.0),),
}
assert set(MOVED) == {field.name for field in dataclasses.fields(Variant)}, "a field has no values"
VARIANTS_MOVED = dict(VARIANTS) | {
    f"{base}, {field} {value}": dataclasses.replace(variant, **{field: value})
    for base, variant in VARIANTS.items()
    for field, values in MOVED.items()
    for value in values
}
