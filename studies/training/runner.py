"""Long runs on shipped sets, one after another, each of which adds a line to a file.

What the file lacks is made. The datasets are made once and kept.
"""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import ibdata

PLACE = Path(os.environ.get("IBDATA_BASELINES") or Path.home() / ".cache" / "ibdata" / "baselines")


@dataclass(frozen=True)
class Runner:
    """The runs of a script. `make` and `describe` take a key and the folder of the datasets, and a result."""

    text: str  # the docstring of the script
    plan: list[Any]  # the keys of the runs, tuples, in an order which makes a part of them useful
    kind: type[Any]  # of the results, with `key` and `model_validate_json`
    file: Path
    make: Callable[[Any, Path], Any]
    describe: Callable[[Any], str]
    write_page: Callable[[list[Any]], None]

    def known(self, file: Path) -> dict[Any, Any]:
        """The results in a file by their keys, in the order of the plan."""
        lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
        results = {line.key: line for line in map(self.kind.model_validate_json, lines)}
        return {key: results[key] for key in self.plan if key in results}

    def main(self) -> None:
        """Do what the arguments say."""
        options = self.options()
        if options.page:
            known = self.known(options.out)
            options.out.write_text(
                "".join(f"{line.model_dump_json(exclude_unset=True)}\n" for line in known.values())
            )
            self.write_page(list(known.values()))
            return
        chosen = [key for key in self.plan if all(word in words_of(key) for word in options.words)]
        if not chosen:
            sys.exit(f"{sys.argv[0]}: found no run with {options.words}, expected words that --list prints")
        failures = 0
        for number, key in enumerate(chosen, 1):
            name = " ".join([f"{number}/{len(chosen)}", *(str(x) for x in key if x is not None)])
            failures += not self.done(key, name, options)
        if failures:
            sys.exit(f"failed: {failures} of {len(chosen)} runs, which left no results; see above")

    def options(self) -> argparse.Namespace:
        """The arguments of the command."""
        head, _, rest = self.text.partition("\n\n")
        form = argparse.RawDescriptionHelpFormatter
        parser = argparse.ArgumentParser(description=head, epilog=rest, formatter_class=form)
        parser.add_argument("words", nargs="*", metavar="WORD", help="only runs with it, such as bad-40")
        parser.add_argument("--data", type=Path, default=PLACE, help="the folder of datasets and policies")
        parser.add_argument("--out", type=Path, default=self.file, help="the file of the results")
        parser.add_argument("--again", action="store_true", help="make known results too, and compare")
        parser.add_argument("--list", action="store_true", help="print the runs and what is known of them")
        parser.add_argument("--page", action="store_true", help="sort the results, and write their page")
        return parser.parse_args()

    def done(self, key: Any, name: str, options: argparse.Namespace) -> bool:
        """Make a result, unless it is known. Return False if that failed; the other runs go on."""
        known = self.known(options.out).get(key)
        if options.list:
            print(name, self.describe(known) if known else "missing", sep=": ")
        elif known is None or options.again:
            try:
                line = self.make(key, options.data)
            except Exception:
                print(f"{name}: failed\n{traceback.format_exc()}", file=sys.stderr, flush=True)
                return False
            print(f"{name}: {self.describe(line)}", flush=True)
            if known:
                print(f"{name}, in {options.out.name}: {self.describe(known)}", flush=True)
            else:
                with options.out.open("a", encoding="utf-8") as file:
                    file.write(line.model_dump_json(exclude_unset=True) + "\n")
        return True


def words_of(key: Any) -> set[str]:
    """The words that choose a run: its parts, and the name of its set without the folder."""
    return {word for part in map(str, key) for word in (part, part.rpartition("/")[2])}


@lru_cache(maxsize=2)
def dataset(name: str, data: Path, steps: int | None = None) -> ibdata.Dataset:
    """The dataset of a shipped experiment, or the first steps of its episodes, without splits."""
    folder = data / (name.replace("/", "-") + (f"-{steps}-steps" if steps else ""))
    changes: dict[str, Any] = {"splits": {}, **({"steps": steps} if steps else {})}
    generated: ibdata.Dataset = ibdata.generate(name, folder, overrides=changes, workers=1)
    return generated


@lru_cache(maxsize=1)
def rows(name: str, data: Path) -> Any:
    """Its rows as the algorithms take them."""
    from training.offline import rows_of

    return rows_of(dataset(name, data))
