"""Results show as text in a terminal and as tables in a notebook, and become DataFrames."""

import json
import math
import pickle
import re

import numpy as np
import pytest

import ibdata
from ibdata.dataset.tabular import MOST_ROWS, Table, as_html, as_text, column_texts


def cells(html):
    """The texts of the cells of all tables in HTML."""
    return re.findall(r"<td[^>]*>(.*?)</td>", html)


def test_a_long_table_is_cut_and_says_so():
    table = Table(("n", "values"), [(i, list(range(i))) for i in range(MOST_ROWS + 1234)], ["a note"])
    lines = as_text(table).split("\n")
    assert len(lines) == 1 + MOST_ROWS + 2
    assert lines[-2:] == ["and 1,234 more", "a note"]
    assert lines[12].endswith("[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, … 11 in all]")
    assert len(cells(as_html([table]))) == 2 * MOST_ROWS
    assert "<p>and 1,234 more</p>" in as_html([table])


NUMBERS = [(92 / 3, -1e-9, 50.0), (-11 / 13, 0.0, 12.5), (None, math.nan, 7)]


def test_the_numbers_of_a_column_have_the_same_decimals():
    """A setpoint is shown in full, and no zero has a sign."""
    table = Table(("score", "nothing", "setpoint"), NUMBERS)
    expected = [["30.6667", "-1e-09", "50.0"], ["-0.8462", "0", "12.5"], ["–", "nan", "7"]]
    assert [line.split() for line in as_text(table).split("\n")[1:]] == expected
    assert cells(as_html([table])) == [text for row in expected for text in row]
    assert as_html([table]).count("text-align: right") == 3 * 4
    assert column_texts([4e5 / 3, -1e-5 / 3]) == ["133,333.3333", "0.0000"]


@pytest.mark.parametrize("high", [1e-5, 1.0, 1e3, 1e9])
def test_no_digit_of_the_largest_number_is_lost(high):
    numbers = [high * x for x in (1 / 3, -2 / 7, 1e-3 / 3)]
    assert all(abs(float(text.replace(",", "")) - x) <= 1e-6 * high
               for text, x in zip(column_texts(numbers), numbers, strict=True))  # fmt: skip


def test_texts_of_a_dataset_can_forge_neither_lines_nor_html():
    table = Table(("name",), [("<b>\n\x1b[1m",)], ["<i>\nsafe"])
    assert as_text(table) == "name\n<b>\\n\\x1b[1m\n<i>\\nsafe"
    assert cells(as_html([table])) == ["&lt;b&gt;\\n\\x1b[1m"]
    assert "<i>" not in as_html([table])


def test_statistics_of_a_column_say_of_how_many_rows_they_are(describe, made_at, tmp_path):
    """The density of a function is not known."""
    policies = [lambda seen: seen[:, 1:4] / 100.0, {"kind": "random"}, {"kind": "safe"}]
    dataset = made_at(describe(policies=policies, output={"shard_rows": 40}), tmp_path / "made")
    assert ibdata.validate(dataset) == []
    known = dataset.table(["action_log_prob"], policy=["random", "safe"])["action_log_prob"].to_numpy()
    for columns in (dataset.statistics(), dataset.select(episodes=range(18)).statistics()):
        found = columns["action_log_prob"]
        assert (found["count"], found["min"], found["max"]) == (480, known.min(), known.max())
        assert found["mean"] == pytest.approx(known.mean(dtype=float), rel=1e-12)
        assert found["quantiles"]["0.5"] == np.quantile(known, 0.5, method="inverted_cdf")
        assert columns["reward"]["count"] == 720
        assert repr(columns).endswith("\naction_log_prob: of the 480 of 720 rows that have a number")


def test_a_dataset_shows_what_it_holds_and_its_splits(dataset, moving):
    shown = cells(dataset._repr_html_())
    assert shown[:5] == ["small", "480", "12", "[random, calm]", "[20, 70]"]
    assert shown[5] == f"{dataset.content_root[:12]}…"
    assert shown[7:] == ["source", "6", "240", "whole files", "target", "4", "160", "whole files"]
    assert dataset.splits == {
        "source": {"episodes": 6, "rows": 240, "declared": True},
        "target": {"episodes": 4, "rows": 160, "declared": True},
    }
    assert repr(dataset.splits).split("\n")[0].split() == ["split", "episodes", "rows", "kind"]
    assert dataset.splits.to_pandas()["rows"].tolist() == [240, 160]
    assert "<p>no splits</p>" in moving._repr_html_()
    assert (repr(moving.splits), moving.splits) == ("no splits", {})


def test_an_estimate_is_a_dict_and_a_table(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    guessed = ibdata.estimate("random")
    assert json.loads(json.dumps(guessed)) == dict(guessed)
    assert guessed["rows"] == guessed.to_pandas().loc[0, "rows"] == 10_000
    assert cells(guessed._repr_html_())[:4] == ["random", "data/random", "10", "10,000"]
    assert repr(guessed).startswith("out       data/random (nothing is written)\nepisodes  10\n")


def test_the_problems_are_a_list_and_a_table(copied):
    fine = ibdata.validate(copied)
    assert (fine, repr(fine)) == ([], "no problems")
    assert list(fine.to_pandas().columns) == ["path", "row", "rule", "message"]
    (copied / "meta/statistics.json").write_text("other")
    found = ibdata.validate(copied)
    assert isinstance(found, list)
    assert found.to_pandas()["rule"].tolist() == [problem.rule for problem in found] == ["hash"]
    assert cells(found._repr_html_())[:3] == ["meta/statistics.json", "–", "hash"]
    assert "meta/statistics.json" in repr(found)
    assert pickle.loads(pickle.dumps(found)) == found


@pytest.fixture(scope="module")
def evaluation():
    return ibdata.evaluate(["optimized", "safe"], setpoint=[50, 70], steps=100, episodes=2)


def test_an_evaluation_shows_results_differences_and_scale(evaluation):
    text = repr(evaluation)
    assert evaluation.scale in text
    rows = [line.split() for line in text.split("\n")]
    named = [[policy, place] for policy in ("optimized", "safe") for place in ("50", "70", "all")]
    assert [row[:2] for row in rows[1:7]] == named
    assert ["safe", "optimized", "all"] in [row[:3] for row in rows]
    assert "all" in cells(evaluation._repr_html_())
    frame = evaluation.to_pandas()
    assert frame["mean_return"].tolist() == [result.mean_return for result in evaluation.results]
    assert frame["setpoint"].isna().tolist() == [False, False, True] * 2


def test_a_single_episode_has_neither_error_nor_score():
    alone = repr(ibdata.evaluate("safe", steps=3, episodes=1, discount=1))
    assert len(alone.split("\n")) == 4  # a row, and why
    assert "–" in alone
