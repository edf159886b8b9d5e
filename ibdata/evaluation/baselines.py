"""Results of offline algorithms on shipped experiments, and how an evaluation compares with them.

`studies/baselines` and `studies/prototypes` make the results.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ibdata._numerics.arguments import public
from ibdata._numerics.arrays import Floats
from ibdata._numerics.confidence import mean_estimate
from ibdata._numerics.naming import exact
from ibdata.dataset.models import JsonObject, Sha256
from ibdata.dataset.reference_returns import EXPERT, HUNDRED
from ibdata.errors import UsageError, parameter
from ibdata.evaluation.algorithms import BEHAVIOUR as BEHAVIOUR
from ibdata.evaluation.algorithms import KNOWN, LineReturns
from ibdata.evaluation.results import overall, scores
from ibdata.experiment.catalogue import full_name
from ibdata.experiment.scenario import scenario_of
from ibdata.policies.weights_file import SHIPPED, shipped_names, weights_at
from ibdata.views.options import ViewOptions

if TYPE_CHECKING:
    import pandas as pd

FILE = Path(__file__).with_name("baselines.jsonl")
PROTOTYPES = FILE.with_name("prototypes.jsonl")
PUBLISHED = FILE.with_name("published.csv")  # a row per set, a column per algorithm
NO_CHANGE = "constant"  # the policy that changes nothing
# The settings of an evaluation, with what `evaluate` takes where none is given.
DEFAULTS: dict[str, Any] = {"setpoint": 70.0, "start": "default", "dynamics": "siemens"}
DEFAULTS |= {"steps": 100, "discount": 0.97, "episodes": 100, "seed": 0}
WHOLE, NOTHING = "whole set", "nothing"  # parts of a set, on which a policy is trained


class Evaluated(JsonObject):
    """The returns of a policy in the episodes that `ibdata.evaluate` plays with these settings.

    `mean_return`, `standard_error` and `p10` are those of `returns`, which are None if the policy failed.
    """

    setpoint: Any  # as in an experiment
    start: Any
    dynamics: str
    steps: int
    discount: float
    episodes: int  # at each setpoint
    seed: int
    mean_return: float | None = None
    standard_error: float | None = None
    p10: float | None = None
    failure: str | None = None
    returns: str | None = None  # (setpoints, episodes): base64 of little-endian float32

    @property
    def settings(self) -> dict[str, Any]:
        """The arguments of `evaluate`."""
        return self.model_dump(include=set(DEFAULTS))

    @property
    def values(self) -> Floats | None:
        """The returns (setpoints, episodes)."""
        if self.returns is None:
            return None
        values = np.frombuffer(base64.b64decode(self.returns), "<f4").astype(np.float64)
        return values.reshape(-1, self.episodes)


class ModelErrors(JsonObject):
    """Root mean square errors of a model of the dynamics after some steps, and those of the noise floor."""

    setpoint: float
    steps: int
    fatigue: float
    consumption: float
    floor_fatigue: float
    floor_consumption: float


class Baseline(JsonObject):
    """A line of a file: a policy learned from the data of a shipped experiment, or one that is known.

    `trained_on` says which part of the data: "10 episodes each", at each setpoint, or "2 at 75".
    """

    set: str  # the name of the shipped experiment
    trained_on: str
    algorithm: str
    seed: int | None  # of the training; None for a policy that is not trained
    evaluations: list[Evaluated]
    model_errors: list[ModelErrors] | None = None  # of the model of the dynamics, if one is scored
    training_steps: int
    seconds: float  # of training
    cpu_seconds: float
    content_root: Sha256 | None  # of the dataset
    hyperparameters: dict[str, Any]
    versions: dict[str, str]
    weights: Sha256 | None = None  # of the network that played, if it is shipped

    @property
    def key(self) -> tuple[str, str, str, int | None]:
        """The set, the data, the algorithm and the seed."""
        return self.set, self.trained_on, self.algorithm, self.seed


def measured(settings: Mapping[str, Any], returns: Floats | None, failure: str | None = None) -> Evaluated:
    """The returns (setpoints, episodes) in an evaluation, rounded to float32; None if the policy failed."""
    if returns is None:
        return Evaluated(**settings, failure=failure)
    kept = returns.astype("<f4")
    values = kept.astype(np.float64)
    mean, error, _ = mean_estimate(list(values))
    return Evaluated(
        **settings,
        mean_return=mean,
        standard_error=error,
        p10=float(np.quantile(values, 0.1)),
        returns=base64.b64encode(kept.tobytes()).decode(),
    )


def shipped_baselines(files: Sequence[Path] = (FILE, PROTOTYPES)) -> list[Baseline]:
    """The lines of some files, in their order."""
    texts = [file.read_text(encoding="utf-8") for file in files if file.exists()]
    return [Baseline.model_validate_json(line) for text in texts for line in text.splitlines()]


def shipped_networks() -> list[dict[str, Any]]:
    """The networks by name with their origin and, if they have results, the score in the first evaluation."""
    lines = {line.key: line for line in shipped_baselines([PROTOTYPES])}
    by_weights = {line.weights: line for line in lines.values()}
    found: list[dict[str, Any]] = []
    for name in shipped_names():
        weights = weights_at(name, None, SHIPPED, {})
        found.append({"name": name, "provenance": weights.metadata.provenance})
        if (line := by_weights.get(weights.sha256)) is not None:
            known = [line, *(lines[line.set, NOTHING, kind, None] for kind in (BEHAVIOUR, HUNDRED, EXPERT))]
            returns = np.array([each.evaluations[0].values for each in known])
            [scored] = scores(returns[:1], returns[1:])
            score = overall(scored).score
            found[-1] |= {"set": line.set, "algorithm": line.algorithm, "seed": line.seed, "score": score}
    return found


@public
def baselines(published: bool = False) -> pd.DataFrame:
    """Results of offline algorithms on shipped experiments: one row per run and evaluation.

    Rows whose algorithm is "behaviour" are those of the policies that made a set, and rows whose `trained_on`
    is "nothing" those of other known policies. All policies of a set were evaluated in the same episodes:
    `ibdata.evaluate(policy, against=set)` plays them too, so that its returns and those here can be compared
    episode by episode. The pages "Baselines" and "The paper's prototypes" describe the training.

    Args:
        published: give the literature's results on `siemens-offline` instead, beside those of this training.

    Returns:
        A DataFrame with the columns `set`, `trained_on` (the part of the set), `algorithm`, `seed` (missing
        for policies that are not trained); the settings `setpoint`, `start`, `dynamics`, `steps`, `discount`,
        `episodes` of the evaluation; `mean_return`, `standard_error` and `p10` (unscaled; missing where the
        policy failed), `failure` (the reason), `returns` (an array (setpoints, episodes) each);
        `training_steps`, `seconds` and `cpu_seconds` of training, `content_root` of the dataset,
        `hyperparameters` and `versions` (a dict each). With `published`, one row per set and algorithm:
        `set`, `algorithm`, `published_p10`, `p10` (the mean of the seeds here, missing where none was
        trained) and `difference`, the second less the first.
    """
    return _beside_published() if published else _trained()


RUN = {"set", "trained_on", "algorithm", "seed"}


def _trained() -> pd.DataFrame:
    import pandas as pd

    rows = []
    for line in shipped_baselines():
        run = line.model_dump(include=RUN)
        training = line.model_dump(exclude={*RUN, "evaluations", "model_errors"})
        for evaluated in line.evaluations:
            result = evaluated.model_dump(exclude={"seed"})
            rows.append({**run, **result, "returns": evaluated.values, **training})
    measures = ("mean_return", "standard_error", "p10")
    frame = pd.DataFrame(rows).astype({"seed": "Int64", **dict.fromkeys(measures, "float64")})
    names = sorted(frame.columns, key=lambda name: name not in {*RUN, "setpoint", *measures})
    return frame[names]  # a notebook leaves out those in the middle


def _beside_published() -> pd.DataFrame:
    """The 10th percentiles of Swazinna et al. (2022, arXiv 2201.05433), as the code of LION has them."""
    import pandas as pd

    known = pd.read_csv(PUBLISHED).melt("set", var_name="algorithm", value_name="published_p10")
    known["published_p10"] = known["published_p10"].astype("float64")
    trained = _trained().groupby(["set", "algorithm"], as_index=False)["p10"].mean()
    beside = known.merge(trained, on=["set", "algorithm"], how="left")
    return beside.assign(difference=beside["p10"] - beside["published_p10"])


class Against(NamedTuple):
    """The baselines of a set with their evaluation that has some settings."""

    set: str | None
    settings: dict[str, Any]
    evaluated: list[tuple[Baseline, Evaluated]]

    def protocol(self, settings: Mapping[str, Any]) -> str:
        """The settings of the evaluation, as a line."""
        return f"{f'against {self.set}: ' if self.set else ''}{_text(form_of(settings))}"

    def lines(self, played: Iterable[str]) -> Iterator[LineReturns]:
        """What is stored: the known policies, without those that were played again, and the algorithms."""
        runs: dict[tuple[str, str, bool], list[Floats]] = {}
        for line, evaluated in self.evaluated:
            returns = runs.setdefault((line.algorithm, line.trained_on, line.seed is not None), [])
            if evaluated.values is not None:
                returns.append(evaluated.values)
        for (algorithm, trained_on, is_trained), returns in runs.items():
            label, _, without = algorithm.partition(" ")
            source = f"{trained_on} {without}".strip() if is_trained else KNOWN
            if is_trained or algorithm not in {NO_CHANGE, *played}:
                yield LineReturns(label, source, is_trained, np.array(returns))


def baselines_of(name: str, chosen: Mapping[str, Any], view: ViewOptions) -> Against:
    """The shipped baselines of a set, given with or without its suite, in the first evaluation that agrees.

    Raises UsageError if there are none, or if no evaluation of the set has the chosen settings.
    """
    lines = shipped_baselines()
    path = full_name(parameter("against"), name, list(dict.fromkeys(line.set for line in lines)))
    if view.reward.kind != "classic":
        found = f"{parameter('reward')}: found {view.reward.kind}"
        raise UsageError(f"{found}, expected classic: {parameter('against')} compares with it")
    of_set = [(line, evaluated) for line in lines if line.set == path for evaluated in line.evaluations]
    settings = _agreeing(name, [evaluated.settings for _, evaluated in of_set], chosen)
    return Against(path, settings, [pair for pair in of_set if pair[1].settings == settings])


def _agreeing(name: str, evaluations: Sequence[dict[str, Any]], chosen: Mapping[str, Any]) -> dict[str, Any]:
    """The first settings that agree with the chosen ones. Raises UsageError if there are none."""
    different = {repr(settings): settings for settings in evaluations}  # which are few
    forms = [form_of(settings) for settings in different.values()]
    differences = []
    for settings, form in zip(different.values(), forms, strict=True):
        asked = form_of({**settings, **chosen})
        differences.append({key: value for key, value in asked.items() if value != form[key]})
        if not differences[-1]:
            return settings
    fewest, nearest = min(zip(differences, forms, strict=True), key=lambda pair: len(pair[0]))
    key, value = next(iter(fewest.items()))
    known = dict.fromkeys(_shown(form[key]) for form in forms)
    raise UsageError(
        f"{parameter(key)}: found {_shown(value)}, expected {' or '.join(known)}: "
        f"{parameter('against')} {name} compares with the returns of {_text(nearest)}"
    )


def form_of(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings in one form, so that equal ones are equal."""
    scenario = scenario_of(**{key: value for key, value in settings.items() if key != "discount"})
    points = scenario.points if len(scenario.points) > 1 else scenario.points[0]
    dynamics = scenario.model_dump(mode="json", include={"dynamics"}, exclude_none=True)["dynamics"]
    setpoint = {"drifting": points} if scenario.drifting else points
    return {**settings, "setpoint": setpoint, "start": scenario.start_form, "dynamics": dynamics}


def _text(settings: Mapping[str, Any]) -> str:
    """Settings in a line."""
    return ", ".join(f"{name} {_shown(value)}" for name, value in settings.items())


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_shown, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{name}: {_shown(each)}' for name, each in value.items())}}}"
    return exact(value) if isinstance(value, float) else str(value)
