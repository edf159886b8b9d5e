"""Policies that act through an object of a user: of a Python session, or made by code that a block names."""

from __future__ import annotations

import inspect
import json
import os
import re
import sys
from collections.abc import Iterator
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import (
    AfterValidator,
    Field,
    PlainSerializer,
    PrivateAttr,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic.functional_validators import ModelWrapValidatorHandler

from ibdata._numerics.arguments import can_act, has_method, native
from ibdata.errors import PolicyError, Problems, UsageError, excerpt, printable, suggestion
from ibdata.policies.adapter import EXPECTED, Adapter, needs_of, refuse_other_form
from ibdata.policies.base import (
    FROM_FLOAT,
    OBSERVATION,
    Decision,
    Needs,
    Observed,
    Policy,
    is_deterministic,
    other_density,
)
from ibdata.policies.checked import refuse_impure
from ibdata.policies.code import (
    Acting,
    Places,
    apart_from_results,
    error_line,
    file_of,
    loading,
    located,
    two_places,
)
from ibdata.policies.libraries import environment_note, is_torch_module
from ibdata.views.options import PLAIN, ViewOptions

if TYPE_CHECKING:
    from typing_extensions import Self

LIVE = "live:"  # begins the name of an object in a record of code
MOST_CLIPPED = 0.2  # share of the numbers of actions


class UserObject(Policy):
    """A policy that acts through an object of a user, see `Adapter`."""

    history: Annotated[int, Field(strict=True, ge=1, le=10_000), FROM_FLOAT] = Field(
        default=1, description="number of observations that it sees"
    )
    draws: Annotated[int, Field(strict=True, ge=0, le=10_000), FROM_FLOAT] = Field(
        default=0, description="number of uniform random numbers per step for act and decide"
    )
    deterministic: bool = Field(
        default=False, strict=True, description="promise that it draws no random numbers of any kind"
    )

    _adapter: Adapter | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _refuse_draws(self) -> UserObject:
        if self.deterministic and self.draws:
            problem = f"found {self.draws} and deterministic: true, expected 0, or no such promise"
            raise Problems([(("draws",), problem)])
        return self

    @property
    def code_target(self) -> str:
        """What names the object in records and messages."""
        raise NotImplementedError

    @property
    def needs(self) -> Needs:
        """The options; a loaded object with `decide` also says what it remembers and draws for an episode."""
        needs = needs_of(self._adapter and self._adapter.target)
        return needs._replace(history=self.history, draws=self.draws)

    def loaded(self, acting: Acting) -> Self:
        acting.callback(os.chdir, acting.folder)  # the object may go elsewhere
        copy = self.__copy__()
        target = copy._made(acting)
        refuse_other_form(target, self.code_target, self.history, self.draws)
        copy._adapter = Adapter(target.loaded(acting) if isinstance(target, Policy) else target)
        return copy

    def _made(self, acting: Acting) -> Any:
        """The object, which is found or made."""
        raise NotImplementedError

    def files_used(self) -> dict[str, Path]:
        """The files that it reads, by their names in a record."""
        return {}

    def target_file(self) -> Path | None:
        """The file of its code, if one is known."""
        return None

    @property
    def adapter(self) -> Adapter:
        """The object as it is asked, which is loaded."""
        if self._adapter is None:
            raise PolicyError(
                f"{self.code_target}: found a policy that is not loaded, as evaluate and generate load it"
            )
        return self._adapter

    def decide(self, observed: Observed) -> Decision:
        answer = self.adapter.ask(observed)
        return Decision(answer.action, answer.memory)

    def refuse_impure(self, columns: int = len(OBSERVATION)) -> None:
        """Raise PolicyError if it remembers or draws in secret. It sees so many columns of an observation."""
        refuse_impure(self, columns, exact=False)
        self.adapter.clipped[:] = 0  # what was asked here is made up

    def notes(self, view: ViewOptions = PLAIN) -> Iterator[str]:
        """What somebody should know who uses the object with a view, in lines without its name."""
        if note := environment_note(self.adapter.target, view):
            yield note
        clipped, total = self.adapter.clipped.tolist()
        if clipped > MOST_CLIPPED * total:
            share = clipped / total
            yield f"{share:.0%} of the numbers of its actions are clipped: actions are changes in [-1, 1]"


def remembers(policy: Policy) -> bool:
    """Whether a policy must be asked about the steps of an episode one by one."""
    return policy.needs.memory > 0 or any(part.adapter.remembers for part in policy.everywhere(UserObject))


def refuse_shared(policy: Policy) -> None:
    """Raise PolicyError for a policy in which an object that remembers acts in two places."""
    parts = [part for part in policy.everywhere(UserObject) if part.adapter.remembers]
    if len({id(part.adapter.target) for part in parts}) < len(parts):
        raise PolicyError(
            f"policy {policy.label}: found {parts[0].code_target} in two places, expected an object for "
            "each, because it remembers the episodes in which it acts"
        )


def name_of(target: Any) -> str:
    """The name of a function, or of an object's class; that of an object in a record is the target."""
    return target if isinstance(target, str) else getattr(target, "__name__", type(target).__name__)


class ObjectPolicy(UserObject):
    """Acts through an object of a Python session, and in that session only.

    Python makes it of a function, a torch module or any other object among the policies. Its code is not
    recorded, so nobody can make the dataset again.
    """

    inner: ClassVar[tuple[Policy, ...]] = ()  # also if the object is a policy: only its name is said

    kind: Literal["live"] = "live"
    target: Annotated[Any, PlainSerializer(name_of, str), WithJsonSchema({"type": "string"})] = Field(
        description="the object; in a record the name of its class, or of the function"
    )

    @model_validator(mode="before")
    @classmethod
    def _as_it_needs(cls, data: Any) -> Any:
        """Let an object set its needs and a policy also its name and promise, unless they are given."""
        target = data.get("target", "") if isinstance(data, dict) else ""
        if isinstance(target, str):
            return data
        fault = other_density(target) if can_act(target) else f"found {excerpt(target)}, expected {EXPECTED}"
        if fault:
            raise Problems([(("target",), fault)])
        needs = needs_of(target)
        own: dict[str, Any] = {"history": max(1, needs.history), "draws": needs.draws}
        if isinstance(target, Policy):
            own |= {"name": target.name, "deterministic": bool(is_deterministic(target)) and not needs.draws}
        return {**own, **data}

    def form(self) -> dict[str, Any]:
        """The kind and the options, with the name of the object in its place."""
        return {**super().form(), "target": name_of(self.target)}

    @property
    def label(self) -> str:
        """The policy's label in the data, by default made of the object's name."""
        name = re.sub("[^a-z0-9]", "-", name_of(self.target).lower()).strip("-")[:64]
        return self.name or name or "object"

    @property
    def code_target(self) -> str:
        """The object's name, as that of an object of a session."""
        return LIVE + name_of(self.target)

    @property
    def is_here(self) -> bool:
        """Whether the object itself is here, and not only its record."""
        return not isinstance(self.target, str)

    def _made(self, acting: Acting) -> Any:
        if isinstance(self.target, str):
            raise PolicyError(f"{self.code_target}: found no such object in this Python session")
        return self.target


NAME = "[A-Za-z_][A-Za-z0-9_]*"
FILE = r"[^/:\\\x00-\x1f][^:\\\x00-\x1f]*\.py"  # a relative path
TARGET = rf"^({NAME}(\.{NAME})*|{FILE}):{NAME}$"
TARGET_MEANT = "package.module:name, or file.py:name with a path relative to the YAML file"


def _as_json(params: dict[str, Any]) -> Any:
    """Parameters as JSON and YAML give them back, so that they are the same in every process."""
    try:
        return json.loads(json.dumps(native(params), allow_nan=False))
    except (TypeError, ValueError, RecursionError) as error:
        raise ValueError(
            f"found what JSON cannot hold ({error}), expected finite numbers, texts, lists and mappings"
        ) from None


class Custom(UserObject):
    """Acts through code of your own.

    The target is an object with `decide(observed)`, `act(history, u)` or `predict(observations)`, a torch
    module, or a function whose first parameter is `observations`; any other function, and a class, makes such
    an object from `params`. It must act in each episode as if it were alone, and draw random numbers from `u`
    or `draws` only: ibdata checks that before a run. With `deterministic: true`, you promise that it draws
    none of any kind. Then `action_log_prob` is known, and the policy may be the `base` of `gaussian`.
    """

    kind: Literal["custom"] = "custom"
    target: Annotated[str, Field(pattern=TARGET)] = Field(description=TARGET_MEANT)
    params: Annotated[dict[str, Any], AfterValidator(_as_json)] = Field(
        default={}, description="keyword arguments for a class or a function"
    )
    files: list[str] | None = Field(
        default=None,
        description="paths of other files that it reads, such as weights.pt, beside the YAML file or in the "
        "current folder; they are hashed like its code",
    )
    _folder: Path | None = PrivateAttr(None)  # of the YAML file
    _places: Places = PrivateAttr(())  # in which the code, and the files that it reads, are looked for

    @model_validator(mode="wrap")
    @classmethod
    def _of_file(cls, data: Any, handler: ModelWrapValidatorHandler[Custom], info: ValidationInfo) -> Custom:
        """Keep the folder of a block, beside which its file must be; a policy that is given has its own."""
        policy = handler(data)
        if not isinstance(data, Policy):
            policy._folder = folder = (info.context or {}).get("folder")
            if folder is not None and policy.source.endswith(".py"):
                try:
                    located(policy.source, "", two_places(Path.cwd(), folder))
                except UsageError as error:
                    raise Problems([(("target",), str(error))]) from None
        return policy

    @property
    def checked_with(self) -> dict[str, Any]:
        """The folder of the YAML file of the block, if it is from one."""
        return {**super().checked_with, "folder": self._folder}

    @property
    def code_target(self) -> str:
        """The target."""
        return self.target

    def form(self) -> dict[str, Any]:
        """The kind and the options, without the files, which are recorded with the run like the code."""
        return {key: value for key, value in super().form().items() if key != "files"}

    def files_used(self) -> dict[str, Path]:
        """The paths of the declared files by their names. Raises UsageError if one is not found."""
        return {name: located(name, f"{self.target}: files: ", self._places) for name in self.files or ()}

    @property
    def source(self) -> str:
        """The file, or the module, that the target names."""
        return self.target.partition(":")[0]

    def target_file(self) -> Path | None:
        """The file of the target, which may be that of an imported module; None if none is known."""
        return self.file() or file_of(sys.modules.get(self.source))

    def file(self) -> Path | None:
        """The file that the target names, or None if it names a module. UsageError if it is not found."""
        return located(self.source, f"{self.target}: ", self._places) if self.source.endswith(".py") else None

    def _made(self, acting: Acting) -> Any:
        self._places = two_places(acting.folder, self._folder)
        file, name = self.file(), self.target.partition(":")[2]
        acting.add_to_path(map(str, [*([] if file is None else [file.parent]), *self._places]))
        try:
            with loading(self.target), apart_from_results():
                module = acting.imported(self.source, file)
                if not hasattr(module, name):
                    names = [known for known in vars(module) if not known.startswith("_")]
                    hint = "; give the object" if self.source == "__main__" else suggestion(name, names)
                    raise PolicyError(f"{self.target}: found no {name!r} in the module{hint}")
                actor = self._object_of(getattr(module, name))
        except (PolicyError, UsageError, KeyboardInterrupt):
            raise
        except BaseException as error:
            line = f"{self.target}: cannot be loaded: {error_line(error)}"
            if isinstance(error, ModuleNotFoundError) and error.name == self.source.partition(".")[0]:
                folders = " or ".join(map(str, self._places))
                line += f"; expected the module in {printable(folders)}, or installed"
            raise PolicyError(line) from error
        if not can_act(actor):
            raise PolicyError(f"{self.target}: found {type(actor).__name__}, expected {EXPECTED}")
        return actor

    def _object_of(self, target: Any) -> Any:
        """What the target is, or makes of `params`."""
        params = deepcopy(self.params)  # which the object may change
        if inspect.isfunction(target):
            parameters = inspect.signature(target).parameters.values()
            first = next((parameter.name for parameter in parameters), "")
            if first == "observations":
                return partial(target, **params) if params else target
            positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
            needed = [x.name for x in parameters if x.kind in positional and x.default is x.empty]
            if not params and needed:
                raise PolicyError(
                    f"{self.target}: found a function of {', '.join(needed)}, expected one whose first "
                    "parameter is `observations`, or params for one that makes a policy"
                )
        acts = not isinstance(target, type) and (has_method(target) or is_torch_module(target))
        return target(**params) if callable(target) and not acts else target
