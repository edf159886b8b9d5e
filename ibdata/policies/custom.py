"""`kind: custom` of an experiment: a policy whose code is not part of ibdata."""

from __future__ import annotations

import inspect
import json
import sys
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, PrivateAttr, ValidationInfo, model_validator

from ibdata.errors import PolicyError, UsageError, printable, suggestion
from ibdata.policies.adapter import EXPECTED, can_act, has_method, needs_of
from ibdata.policies.base import refuse_density
from ibdata.policies.code import (
    Acting,
    Places,
    apart_from_results,
    error_line,
    file_of,
    imported,
    loading,
    located,
    two_places,
)
from ibdata.policies.libraries import is_torch_module
from ibdata.policies.user_object import UserObject

NAME = "[A-Za-z_][A-Za-z0-9_]*"
FILE = r"[^/:\\\x00-\x1f][^:\\\x00-\x1f]*\.py"  # a relative path
TARGET = rf"^({NAME}(\.{NAME})*|{FILE}):{NAME}$"
TARGET_MEANT = "package.module:name, or file.py:name with a path relative to the YAML file"


def _as_json(params: dict[str, Any]) -> Any:
    """Parameters as JSON and YAML give them back, so that they are the same in every process."""
    try:
        return json.loads(json.dumps(params, allow_nan=False))
    except (TypeError, ValueError) as error:
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

    @model_validator(mode="after")
    def _of_file(self, info: ValidationInfo) -> Custom:
        self._folder = (info.context or {}).get("folder")
        return self

    @property
    def context(self) -> dict[str, Any]:
        """The folder of the YAML file."""
        return {"folder": self._folder}

    @property
    def code_target(self) -> str:
        """The target."""
        return self.target

    def form(self) -> dict[str, Any]:
        """The kind and the options, without the files, which are recorded with the run like the code."""
        return {key: value for key, value in super().form().items() if key != "files"}

    def files_used(self) -> dict[str, Path]:
        """The paths of the declared files by their names. Raises UsageError if one is not found."""
        return {name: located(name, f"{self.target}: files", self._places) for name in self.files or ()}

    def target_file(self) -> Path | None:
        """The file of the target, which may be that of an imported module; None if none is known."""
        return self.file() or file_of(sys.modules.get(self.target.partition(":")[0]))

    def file(self) -> Path | None:
        """The file that the target names, or None if it names a module. UsageError if it is not found."""
        source, _, _ = self.target.partition(":")
        return located(source, self.target, self._places) if source.endswith(".py") else None

    def _made(self, acting: Acting) -> Any:
        self._places = two_places(acting.folder, self._folder)
        file, (source, _, name) = self.file(), self.target.partition(":")
        acting.add_to_path(map(str, [*([] if file is None else [file.parent]), *self._places]))
        try:
            with loading(self.target), apart_from_results():
                module = imported(source, file)
                if not hasattr(module, name):
                    names = [known for known in vars(module) if not known.startswith("_")]
                    raise PolicyError(
                        f"{self.target}: found no {name!r} in the module{suggestion(name, names)}"
                    )
                actor = self._object_of(getattr(module, name))
        except (PolicyError, UsageError, KeyboardInterrupt):
            raise
        except BaseException as error:
            line = f"{self.target}: cannot be loaded: {error_line(error)}"
            if isinstance(error, ModuleNotFoundError) and error.name == source.partition(".")[0]:
                folders = " or ".join(map(str, self._places))
                line += f"; expected the module in {printable(folders)}, or installed"
            raise PolicyError(line) from error
        if not can_act(actor):
            raise PolicyError(f"{self.target}: found {type(actor).__name__}, expected {EXPECTED}")
        self._refuse_other_form(actor)
        return actor

    def _object_of(self, target: Any) -> Any:
        """What the target is, or makes of `params`."""
        if inspect.isfunction(target):
            parameters = inspect.signature(target).parameters.values()
            first = next((parameter.name for parameter in parameters), "")
            if first == "observations":
                return partial(target, **self.params) if self.params else target
            positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
            needed = [x.name for x in parameters if x.kind in positional and x.default is x.empty]
            if not self.params and needed:
                raise PolicyError(
                    f"{self.target}: found a function of {', '.join(needed)}, expected one whose first "
                    "parameter is `observations`, or params for one that makes a policy"
                )
        acts = not isinstance(target, type) and (has_method(target) or is_torch_module(target))
        return target(**self.params) if callable(target) and not acts else target

    def _refuse_other_form(self, actor: Any) -> None:
        """PolicyError for an object that needs more than the options say, or states a density itself."""
        try:
            refuse_density(actor)
        except TypeError as error:
            raise PolicyError(f"{self.target}: {error}") from None
        needs = needs_of(actor, self.history, self.draws)
        for option, number, least in (
            ("history", self.history, needs.history),
            ("draws", self.draws, needs.draws),
        ):
            if number < least:
                raise PolicyError(
                    f"{self.target}: found {option}: {number}, expected at least the needs of "
                    f"{type(actor).__name__}; write {option}: {least}"
                )
