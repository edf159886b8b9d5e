"""`kind: custom` of an experiment: a policy whose code is not part of ibdata."""

from __future__ import annotations

import inspect
import json
import sys
from contextlib import suppress
from functools import cached_property, partial
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, PrivateAttr

from ibdata.errors import PolicyError, UsageError, printable, suggestion
from ibdata.policies.adapter import EXPECTED, can_act, has_method, needs_of
from ibdata.policies.base import refuse_density
from ibdata.policies.code import (
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
    or `uniforms` only: ibdata checks that before a run. With `deterministic: true`, you promise that it draws
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
    _places: Places = PrivateAttr(())  # by default the current folder

    @property
    def code_target(self) -> str:
        """The target."""
        return self.target

    def form(self) -> dict[str, Any]:
        """The kind and the options, without the files, which are recorded with the run like the code."""
        return {key: value for key, value in super().form().items() if key != "files"}

    def look_in(self, places: Places) -> None:
        """Look for the code, and the files that it reads, in these folders and no others."""
        self._places = places

    @property
    def places(self) -> Places:
        """The folders in which the code and the files that it reads are looked for."""
        return self._places or two_places(None)

    def files_used(self) -> dict[str, Path]:
        """The paths of the declared files by their names. Raises UsageError if one is not found."""
        return {name: located(name, f"{self.target}: files", self.places) for name in self.files or ()}

    def target_file(self) -> Path | None:
        """The file of the target, which may be that of an imported module; None if none is known."""
        return self.file() or file_of(sys.modules.get(self.target.partition(":")[0]))

    def file(self) -> Path | None:
        """The file that the target names, or None if it names a module. UsageError if it is not found."""
        source, _, _ = self.target.partition(":")
        return located(source, self.target, self.places) if source.endswith(".py") else None

    def forget(self) -> None:
        """Forget the object, so that it is created anew on its next use, and its folders in Python's path."""
        if "adapted" in self.__dict__:
            self._leave_path()
        super().forget()

    @cached_property
    def adapted(self) -> Any:
        """The object, which is imported or created on first use."""
        sys.path[:0] = self._folders()  # before all others, as `python -m` does
        try:
            return self._loaded()
        except BaseException:
            self._leave_path()
            raise

    def _folders(self) -> list[str]:
        """The folders in which the code finds other modules."""
        file = self.file()
        return list(dict.fromkeys(map(str, [*([] if file is None else [file.parent]), *self.places])))

    def _leave_path(self) -> None:
        for folder in self._folders():
            with suppress(ValueError):
                sys.path.remove(folder)

    def _loaded(self) -> Any:
        source, _, name = self.target.partition(":")
        try:
            with loading(self.target), apart_from_results():
                actor = self._object_of(self._attribute(imported(source, self.file()), name))
        except (PolicyError, UsageError, KeyboardInterrupt):
            raise
        except BaseException as error:
            line = f"{self.target}: cannot be loaded: {error_line(error)}"
            if isinstance(error, ModuleNotFoundError) and error.name == source.partition(".")[0]:
                folders = " or ".join(map(str, self.places))
                line += f"; expected the module in {printable(folders)}, or installed"
            raise PolicyError(line) from error
        if not can_act(actor):
            raise PolicyError(f"{self.target}: found {type(actor).__name__}, expected {EXPECTED}")
        self._refuse_other_form(actor)
        return actor

    def _attribute(self, module: ModuleType, name: str) -> Any:
        """What the module has under this name."""
        if not hasattr(module, name):
            names = [known for known in vars(module) if not known.startswith("_")]
            raise PolicyError(f"{self.target}: found no {name!r} in the module{suggestion(name, names)}")
        return getattr(module, name)

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
        needs = needs_of(actor, self.history, self.uniforms)
        for option, number, least in (
            ("history", self.history, needs.history),
            ("uniforms", self.uniforms, needs.step_draws),
        ):
            if number < least:
                raise PolicyError(
                    f"{self.target}: found {option}: {number}, expected at least the needs of "
                    f"{type(actor).__name__}; write {option}: {least}"
                )
