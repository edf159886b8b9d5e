"""Results of offline algorithms on shipped experiments, and how an evaluation compares with them.

`studies/baselines` makes the results.
"""

from __future__ import annotations

import base64
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ibdata.arguments import public
from ibdata.dataset.models import JsonObject, Sha256
from ibdata.numerics.confidence import estimate

if TYPE_CHECKING:
    import pandas as pd
from typing import NamedTuple

from ibdata.errors import UsageError, suggestion
from ibdata.experiment.scenario import Scenario
from ibdata.numerics.naming import exact
from ibdata.views.options import ViewOptions

Floats = npt.NDArray[np.float64]
FILE = Path(__file__).with_name("baselines.jsonl")
PUBLISHED = FILE.with_name("published.csv")  # a row per set, a column per algorithm
BEHAVIOUR = "behaviour"
# The literature's evaluation (Hein et al., 2021 and later): these episodes, the same for all results.
SETTINGS: dict[str, Any] = {
    "setpoint": 70.0,
    "steps": 100,
    "discount": 0.97,
    "episodes": 200,
    "start": "default",
    "dynamics": "siemens",
    "seed": 0,
}


class Baseline(JsonObject):
    """A line of the file: a policy learned from the dataset of a shipped experiment, or its behaviour.

    `mean_return`, `standard_error` and `p10` are those of `returns`, which are None if the policy failed.
    """

    set: str  # the name of the shipped experiment
    algorithm: str
    seed: int | None  # of the training; None for the behaviour
    mean_return: float | None
    standard_error: float | None
    p10: float | None
    failure: str | None = None
    training_steps: int
    seconds: float  # of training
    cpu_seconds: float
    content_root: Sha256
    hyperparameters: dict[str, Any]
    versions: dict[str, str]
    returns: str | None  # of the shared episodes in their order: base64 of little-endian float32

    @property
    def key(self) -> tuple[str, str, int | None]:
        """The set, the algorithm and the seed."""
        return self.set, self.algorithm, self.seed

    @property
    def label(self) -> str:
        """The algorithm and the seed."""
        return self.algorithm if self.seed is None else f"{self.algorithm} seed {self.seed}"

    @property
    def values(self) -> Floats | None:
        """The returns (episodes,)."""
        if self.returns is None:
            return None
        return np.frombuffer(base64.b64decode(self.returns), "<f4").astype(np.float64)


def measured(returns: Floats | None) -> dict[str, Any]:
    """The fields of a baseline that its returns give, after rounding to float32."""
    if returns is None:
        return dict.fromkeys(("mean_return", "standard_error", "p10", "returns"))
    kept = returns.astype("<f4")
    values = kept.astype(np.float64)
    mean, error, _ = estimate([values])
    return {
        "mean_return": mean,
        "standard_error": error,
        "p10": float(np.quantile(values, 0.1)),
        "returns": base64.b64encode(kept.tobytes()).decode(),
    }


def shipped_baselines(file: Path = FILE) -> list[Baseline]:
    """The lines of a file, in its order."""
    if not file.exists():
        return []
    return [Baseline.model_validate_json(line) for line in file.read_text(encoding="utf-8").splitlines()]


@public
def baselines(published: bool = False) -> pd.DataFrame:
    """Results of offline algorithms on shipped experiments: one row per set, algorithm and seed.

    The rows whose algorithm is "behaviour" are those of the policies that made the sets. All policies were
    evaluated in the same 200 episodes: `ibdata.evaluate(policy, episodes=200)` plays them too, so that its
    returns and those here can be compared episode by episode. docs/baselines.md describes the training.

    Args:
        published: give the literature's results on `siemens-offline` instead, beside those of this training.

    Returns:
        A DataFrame with the columns `set`, `algorithm`, `seed` (missing for the behaviour), `mean_return`,
        `standard_error` and `p10` (discounted and unscaled; missing where the policy failed), `failure` (the
        reason), `training_steps`, `seconds` and `cpu_seconds` of training, `content_root` of the dataset,
        `hyperparameters` and `versions` (a dict each) and `returns` (an array (200,) each). With `published`,
        one row per set and algorithm: `set`, `algorithm`, `published_p10`, `p10` (the mean of the seeds here,
        missing where none was trained) and `difference`, the second less the first.
    """
    return _beside_published() if published else _trained()


def _trained() -> pd.DataFrame:
    import pandas as pd

    lines = shipped_baselines()
    frame = pd.DataFrame([dict(line) for line in lines], columns=list(Baseline.model_fields))
    frame["returns"] = pd.Series([line.values for line in lines], dtype=object)
    return frame.astype(
        {"seed": "Int64", "mean_return": "float64", "standard_error": "float64", "p10": "float64"}
    )


def _beside_published() -> pd.DataFrame:
    """The 10th percentiles of Swazinna et al. (2022, arXiv 2201.05433), as the code of LION has them."""
    import pandas as pd

    known = pd.read_csv(PUBLISHED).melt("set", var_name="algorithm", value_name="published_p10")
    known["published_p10"] = known["published_p10"].astype("float64")
    trained = _trained().groupby(["set", "algorithm"], as_index=False)["p10"].mean()
    beside = known.merge(trained, on=["set", "algorithm"], how="left")
    return beside.assign(difference=beside["p10"] - beside["published_p10"])


class Comparison(NamedTuple):
    """A policy against those that an algorithm learned from a set, or the set's behaviour.

    `mean_return` is over the seeds whose policy did not fail, `lowest` and `highest` are the mean returns of
    single seeds; all are discounted and unscaled. `mean_difference` is the return of `policy` minus the mean
    over the seeds, paired by episodes; its errors are those of the episodes, for these trained policies.
    """

    set: str
    algorithm: str
    seeds: int
    mean_return: float | None
    lowest: float | None
    highest: float | None
    policy: str
    mean_difference: float | None
    standard_error: float | None
    interval: tuple[float, float] | None


def baselines_of(name: str, scenario: Scenario, discount: float, view: ViewOptions) -> list[Baseline]:
    """The shipped baselines of a set, given with or without its suite.

    Raises UsageError if there are none, or if they were not evaluated in the episodes of this scenario.
    """
    lines = shipped_baselines()
    sets = list(dict.fromkeys(line.set for line in lines))
    last = [path.partition("/")[2] for path in sets]
    short = {path: end if last.count(end) == 1 else path for path, end in zip(sets, last, strict=True)}
    chosen = next((path for path in sets if name in (path, short[path])), None)
    if chosen is None:
        known = ", ".join(short.values())
        raise UsageError(
            f"--against: found {name!r}, expected one of {known}{suggestion(name, short.values())}"
        )
    if view.reward.kind != "classic":
        raise UsageError(f"--reward: found {view.reward.kind}, expected classic: --against compares with it")
    _refuse_other_episodes(scenario, discount)
    return [line for line in lines if line.set == chosen]


def compared(lines: list[Baseline], labels: list[str], returns: Floats) -> list[Comparison]:
    """Compare policies, by their returns (policies, episodes), with each algorithm in the lines of a set."""
    algorithms = dict.fromkeys(line.algorithm for line in lines)
    return [
        _comparison([line for line in lines if line.algorithm == algorithm], label, of_policy)
        for label, of_policy in zip(labels, returns, strict=True)
        for algorithm in algorithms
    ]


def _comparison(lines: list[Baseline], policy: str, returns: Floats) -> Comparison:
    """Compare a policy with one algorithm, whose seeds have these lines."""
    name, algorithm = lines[0].set, lines[0].algorithm
    values = [line.values for line in lines if line.values is not None]
    if not values:
        return Comparison(name, algorithm, 0, None, None, None, policy, None, None, None)
    means = [float(of_seed.mean()) for of_seed in values]
    mean, difference = sum(means) / len(means), estimate([returns - np.mean(values, axis=0)])
    return Comparison(name, algorithm, len(values), mean, min(means), max(means), policy, *difference)


def _refuse_other_episodes(scenario: Scenario, discount: float) -> None:
    [point, *others] = scenario.points
    settings = {
        "setpoint": "drifting" if scenario.drifting else scenario.points if others else point,
        "steps": scenario.steps,
        "discount": discount,
        "episodes": scenario.episodes,
        "start": scenario.start_form,
        "dynamics": scenario.dynamics,
        "seed": scenario.seed,
    }
    for name, expected in SETTINGS.items():
        if settings[name] != expected:
            every = ", ".join(f"{key} {_shown(value)}" for key, value in SETTINGS.items())
            raise UsageError(
                f"--{name}: found {_shown(settings[name])}, expected {_shown(expected)}: --against compares "
                f"with the returns of {every}"
            )


def _shown(value: object) -> str:
    return exact(value) if isinstance(value, float) else str(value)
